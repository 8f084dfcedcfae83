"""What layers, reports and the viewer look at: a model, its capture if there is one, and what both share."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float32

from relight3d.errors import InputError
from relight3d.io.capture import read_photograph
from relight3d.lights import Light
from relight3d.records import Capture, Frame, Observations, Photograph, RelightModel
from relight3d.recover import visibility
from relight3d.recover.training import average_repeats, under_same_lights
from relight3d.relight.relighter import Relighter
from relight3d.shading import ray_scene
from relight3d.tracing import RayScene
from relight3d.views import View, build_view

Lights = tuple[Light, ...]
Options = TypeVar("Options")


@dataclass(frozen=True, eq=False)
class Subject:
    """A model and its capture. Everything derived from them is made when it is first asked for, and kept."""

    model: RelightModel
    capture: Capture | None = None
    _last: tuple[Lights, Frame] | None = field(default=None, init=False, repr=False)

    @cached_property
    def relighter(self) -> Relighter:
        """Relights the captured view."""
        return Relighter(self.model)

    @cached_property
    def scene(self) -> RayScene:
        return ray_scene(self.model.mesh)

    @cached_property
    def view(self) -> View:
        """What each pixel of the captured view shows, mirrors followed."""
        return build_view(self.scene, self.model, self.model.camera)

    @cached_property
    def default_lights(self) -> Lights:
        """The lights to show a scene in when none are asked for: the photographed ones nearest to their middle."""
        candidates = [lights for lights in self.model.lights if lights]
        if not candidates:
            return ()
        middle = self.model.mesh.center[None]
        toward = np.array([lights[0].incident(middle).to_light[0] for lights in candidates])
        # A little off the middle: straight light hides shadows and relief.
        aim = toward.mean(axis=0)
        aim = aim / max(float(np.linalg.norm(aim)), 1e-9)
        return candidates[int(np.argmin(np.abs(toward @ aim - np.cos(np.radians(35.0)))))]

    @cached_property
    def photographs(self) -> tuple[Photograph, ...]:
        """The training photographs, of several under the same lights the first: the recovery makes one of them.

        Raises InputError without a capture, or with one that is not the model's.
        """
        if self.capture is None:
            raise InputError("capture", "none", "the capture that the model was recovered from")
        training = self.capture.split("train")
        training = tuple(training[group[0]] for group in under_same_lights(tuple(p.lights for p in training)))
        if len(training) != len(self.model.lights) or not self.capture.camera.same_as(self.model.camera):
            got = f"training photographs under {len(training)} sets of lights, of another scene or version of it"
            raise InputError("capture", got, "the capture that the model was recovered from")
        return training

    @cached_property
    def measured(self) -> tuple[Float32[np.ndarray, "photo height width 3"], Bool[np.ndarray, "photo height width"]]:
        """Linear radiance of `photographs`, each the mean of all under its lights, and where any of these is valid."""
        assert self.photographs and self.capture is not None
        training = self.capture.split("train")
        radiance, is_valid = zip(*(read_photograph(self.capture, photograph) for photograph in training))
        mean, is_known, _ = average_repeats(np.stack(radiance), np.stack(is_valid), tuple(p.lights for p in training))
        return mean, is_known

    def render(self, lights: Lights) -> Frame:
        """The captured view under lights; the last frame is kept, since several layers show parts of one."""
        if self._last is None or self._last[0] is not lights:
            object.__setattr__(self, "_last", (lights, self.relighter.render(list(lights))))
        assert self._last is not None
        return self._last[1]

    @cached_property
    def predicted(self) -> tuple[Frame, ...]:
        """What the model makes of each training photograph's lights."""
        return tuple(self.relighter.render(list(lights)) for lights in self.model.lights)

    @cached_property
    def observed(self) -> Observations:
        """The training photographs as the recovery saw them: shadows, borders and possible highlights by geometry."""
        model, points = self.model, self.model.pixels.points
        radiance, is_valid = self.measured
        lights = tuple(tuple(light.translated(-model.mesh.center) for light in each) for each in model.lights)
        return visibility.observe(
            self.scene,
            model.mesh,
            points,
            model.camera,
            radiance.reshape(len(radiance), -1, 3)[:, points.pixel],
            is_valid.reshape(len(is_valid), -1)[:, points.pixel],
            lights,
            options_of(model, "visibility", visibility.VisibilityOptions),
            model.mirrors,
            model.surfaces.surface_of_face,
            model.pixels.surface,
        )


def options_of(model: RelightModel, stage: str, kind: type[Options]) -> Options:
    """The options that a stage of the model's recovery had; the defaults where the model does not say."""
    recovered = model.settings.get("recover")
    told = recovered.get(stage) if isinstance(recovered, Mapping) else None
    names = {each.name for each in fields(kind)}  # pyright: ignore[reportArgumentType]
    return kind(**{key: value for key, value in told.items() if key in names} if isinstance(told, Mapping) else {})

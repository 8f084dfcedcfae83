"""The viewer's settings of speed: a preset or a budget, effects switched off, and what each effect is worth."""

from dataclasses import dataclass

import numpy as np

from relight3d.camera import Camera
from relight3d.display.subject import Lights
from relight3d.effects import SCENE, SCENE_EFFECTS, SURFACE_EFFECTS
from relight3d.records import Frame, RelightModel
from relight3d.relight.force import apply_plan, forced_options, has_effect
from relight3d.relight.options import RelightOptions, preset_options
from relight3d.relight.relighter import Relighter

PRESETS = ("fast", "balanced", "exact")
_CLOCKS = {"shadows": "shadow", "thrown": "thrown", "indirect": "indirect", "residual": "residual"}
_COUNTERS = {"shadows": "shadow", "borders": "border", "thrown": "thrown"}


@dataclass(frozen=True)
class Speed:
    """How frames are made: by a preset, or by a budget where one is given, without the effects in `off`."""

    preset: str = "exact"
    budget_ms: float | None = None
    off: frozenset[str] = frozenset()


@dataclass(frozen=True, eq=False)
class FrameMaker:
    """A relighter of the captured view and the model and options that it was made of, for other views."""

    model: RelightModel
    options: RelightOptions
    notes: tuple[str, ...]
    captured: Relighter

    def seen_from(self, camera: Camera) -> Relighter:
        """A relighter with the same settings and another camera."""
        return Relighter(self.model, camera, self.options)


def make_frame_maker(model: RelightModel, speed: Speed) -> FrameMaker:
    """The relighter that a speed asks for. With a budget, what it chose and gave up is in the notes."""
    force: dict[tuple[str, int | str], bool] = {(effect, SCENE): False for effect in speed.off}
    restricted = apply_plan(model, force) if speed.off else model
    options, notes = preset_options(speed.preset), ()
    if speed.budget_ms is not None:
        chosen = Relighter(restricted, budget_ms=speed.budget_ms)
        options, notes = chosen.options, chosen.render([]).stats.notes
    options = forced_options(options, force)
    captured = Relighter(restricted, options=options)
    # The first frame compiles kernels and fills tables, which is no frame's price.
    captured.render(next((lights for lights in model.lights if lights), ()))
    return FrameMaker(restricted, options, notes, captured)


def effects_of(model: RelightModel) -> tuple[str, ...]:
    """The effects that a model has, which are those that can be switched off."""
    surfaces = range(model.surfaces.num_surfaces)
    found = [name for name in SURFACE_EFFECTS if any(has_effect(model, name, surface) for surface in surfaces)]
    found += [name for name in SCENE_EFFECTS if has_effect(model, name, SCENE)]
    rays = ["shadows", "borders", "outlines"] + (["second mirror"] if len(model.mirrors) > 1 else [])
    return (*rays, *found)


def share_of_effect(
    model: RelightModel, speed: Speed, effect: str, camera: Camera, lights: Lights, full: Frame
) -> float:
    """By how much the frame changes without the effect, in percent of all its light."""
    without = make_frame_maker(model, Speed(speed.preset, None, speed.off | {effect}))
    relighter = without.captured if camera.same_as(model.camera) else without.seen_from(camera)
    changed = np.abs(relighter.render(list(lights)).radiance - full.radiance)
    return 100.0 * float(changed.sum()) / max(float(full.radiance.sum()), 1e-30)


def effect_line(effect: str, share: float | None, frame: Frame) -> str:
    """What an effect is worth and what it costs, in words."""
    stats = frame.stats
    parts = [] if share is None else [f"{share:.2g} % of the light"]
    if _CLOCKS.get(effect) in stats.milliseconds:
        parts.append(f"{stats.milliseconds[_CLOCKS[effect]]:.1f} ms")
    if stats.rays.get(_COUNTERS.get(effect, "")):
        parts.append(f"{stats.rays[_COUNTERS[effect]]:,} rays")
    return ", ".join(parts)

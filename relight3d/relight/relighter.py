"""The relighter: everything that does not depend on the light is made once, then each frame is lights only."""

import logging
import time
from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import asdict, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from relight3d.camera import Camera
from relight3d.forward import gather_pixels, shade_points
from relight3d.lights import Light
from relight3d.records import Frame, PatchMesh, RelightModel, Stats, Terms
from relight3d.relight.options import RelightOptions
from relight3d.relight.restrict import restrict
from relight3d.shading import ray_scene
from relight3d.tracing import RayScene
from relight3d.views import View, ViewOptions, build_view

if TYPE_CHECKING:
    from relight3d.relight.plan import Plan

logger = logging.getLogger(__name__)

# A mesh's ray scene serves every relighter of it: a path of cameras builds it once.
_scenes: "WeakKeyDictionary[PatchMesh, RayScene]" = WeakKeyDictionary()


class Relighter:
    """Relights a model from one viewpoint: the captured one, or `camera`.

    Settings come from `options`, or from a `preset` ("exact", "balanced", "fast", or "baked", which takes some seconds to
    make), or from the model's price list: the most accurate whose frame takes `budget_ms` on this machine, or the cheapest
    that loses no more than `max_error_db`, or the cheapest of those within the budget. Raises InputError for two of these
    at once.
    """

    def __init__(
        self,
        model: RelightModel,
        camera: Camera | None = None,
        options: RelightOptions | None = None,
        budget_ms: float | None = None,
        preset: str | None = None,
        max_error_db: float | None = None,
    ) -> None:
        from relight3d.relight.budget import check_wish, preset_for, within

        check_wish(options, preset, budget_ms, max_error_db)
        self.given_model = model
        self._notes: tuple[str, ...] = ()
        self._apply(options or preset_for(model, preset or "exact"), camera or model.camera)
        if budget_ms is not None or max_error_db is not None:
            chosen, self._notes = within(self, budget_ms, max_error_db)
            self._apply(chosen, self.camera)

    def with_options(self, options: RelightOptions) -> "Relighter":
        """A relighter of the same model and camera with other options, made sooner: what they leave as it is, is shared."""
        other = copy(self)
        other._notes = ()
        if _view_settings(options) == _view_settings(self.options):
            other.options, other.model = options, restrict(self.given_model, options)
            other._pack()
            other._bake_if_asked()
        else:
            other._apply(options, self.camera)
        return other

    def _apply(self, options: RelightOptions, camera: Camera) -> None:
        self.options, self.model = options, restrict(self.given_model, options)
        mesh = self.model.mesh
        if mesh not in _scenes:
            _scenes[mesh] = ray_scene(mesh)
        self._scene = _scenes[mesh]
        self.set_camera(camera)
        self._bake_if_asked()

    def _bake_if_asked(self) -> None:
        if self.options.shadows == "table":
            self.bake_shadows()

    def set_camera(self, camera: Camera) -> None:
        """Look from elsewhere: trace the view and pack it anew. Its shadows are not baked."""
        start = time.perf_counter()
        self.camera = camera
        self.view = _view(self._scene, self.model, camera, self.options)
        self._pack()
        self.view_ms = 1e3 * (time.perf_counter() - start)

    def _pack(self) -> None:
        options = self.options
        if len(self.view.surface) == 0:  # nothing is in view, and a lattice of nothing has no slots
            options = replace(options, shading="exact", shadows="exact")
        engine = _engine_class(options)
        self._engine = None if engine is None else engine(self._scene, self.model, self.view, options)

    def render(self, lights: Iterable[Light]) -> Frame:
        """Linear radiance under the lights (world coordinates)."""
        from relight3d.relight.light_rows import expanded

        center = self.model.mesh.center
        centred, effects = expanded([light.translated(-center) for light in lights], self.options.light_samples)
        if self._engine is not None:
            radiance, milliseconds, rays = self._engine.render(centred, effects)
        else:
            radiance, milliseconds, rays = self._render_with_numpy(centred)
        height, width = self.camera.height, self.camera.width
        settings = _settings(self.options) | {"view_ms": self.view_ms, "view_rays": self.view.num_rays}
        return Frame(
            radiance.reshape(height, width, 3),
            self.view.is_hit,
            self.model.exposure,
            Stats(milliseconds, rays, settings, self._notes),
            partial(_terms, self._scene, self.model, self.view, self.options, centred),
        )

    def bake_shadows(self, progress: Callable[[float], object] = lambda part: None) -> float:
        """Cast ahead the shadows of lights at infinity, from all around, so that frames look them up (shading "half" alone).

        Returns what part of it there is room for (`table_mb`); lights from elsewhere are cast as before, and so are lamps.
        Some seconds, once a viewpoint (docs/performance.md); `shadows="table"` does it by itself for the first one.
        `progress` is called with the part done, 0 to 1.
        """
        start = time.perf_counter()
        part = 1.0 if self._engine is None else self._engine.bake_shadows(progress)
        if part < 1.0:
            logger.warning(
                "table_mb holds %.0f %% of the lights' directions: lower lights are cast in each frame", 100 * part
            )
        logger.info("shadows baked in %.1f s", time.perf_counter() - start)
        return part

    @property
    def plan(self) -> "Plan":
        """Which effects run on which surfaces, and why: the evidence, then what options and view leave out."""
        from relight3d.relight.plan import plan_of

        return plan_of(self.given_model, self)

    def _render_with_numpy(self, lights: list[Light]) -> tuple[np.ndarray, dict[str, float], dict[str, int]]:
        start = time.perf_counter()
        options = self.options
        shaded = shade_points(self._scene, self.model, self.view, lights, options.shadows != "off", options.borders)
        picture = gather_pixels(self.model, self.view, lights, shaded)
        rays = {"shadow": shaded.num_rays, "border": shaded.num_border_rays, "thrown": shaded.num_thrown_rays}
        return np.maximum(sum(picture), 0.0), {"shade": 1e3 * (time.perf_counter() - start)}, rays


@lru_cache(maxsize=8)
def _settings(options: RelightOptions) -> dict[str, Any]:
    """asdict takes longer than a tile."""
    return asdict(options)


def _view_settings(options: RelightOptions) -> tuple:
    """What a view depends on, beside the model and the camera."""
    return options.edge_samples, options.max_bounces, options.detail, options.backend


def _view(scene: RayScene, model: RelightModel, camera: Camera, options: RelightOptions) -> View:
    follow = ViewOptions(options.edge_samples, options.max_bounces)
    compiled = scene.packets is not None and _engine_class(options) is not None
    if camera.same_as(model.camera) or not compiled:
        return build_view(scene, model, camera, follow)
    from relight3d.relight.fast_view import build_fast_view

    return build_fast_view(scene, model, camera, follow)


def _engine_class(options: RelightOptions):
    """The compiled engine; None for the NumPy reference, which also serves where numba is missing."""
    if options.backend == "numpy":
        return None
    try:
        from relight3d.relight.engine import Engine
        from relight3d.relight.fill_engine import FillEngine
        from relight3d.relight.half_engine import HalfEngine
    except ImportError:
        if options.backend == "numba":
            raise
        logger.info("no numba: frames come from the NumPy reference")
        return None
    return {"exact": Engine, "adaptive": FillEngine, "half": HalfEngine}[options.shading]


def _terms(scene: RayScene, model: RelightModel, view: View, options: RelightOptions, lights: list[Light]) -> Terms:
    """The frame's parts, by the readable reference: traced shadows, whatever the frame's own were."""
    shaded = shade_points(scene, model, view, lights, options.shadows != "off", options.borders)
    picture = gather_pixels(model, view, lights, shaded)
    shape = (view.camera.height, view.camera.width, 3)
    has_mirror = bool(view.is_mirrored.any()) or len(view.miss_pixel) > 0
    return Terms(
        direct=picture.direct.reshape(shape),
        specular=picture.specular.reshape(shape) if any(model.lobes) else None,
        indirect=picture.indirect.reshape(shape) if model.indirect or model.residual else None,
        mirror=picture.mirror.reshape(shape) if has_mirror else None,
    )

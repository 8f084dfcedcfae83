"""The compiled engine: a frame is shadow rays, one small indirect product, and one fused shading pass."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32

from relight3d.forward import background_radiance, dark_residual
from relight3d.lights import DirectionalLight, Light
from relight3d.records import RelightModel, Residual
from relight3d.relight import kernels, pixel_kernels
from relight3d.relight.anchors import Anchors, find_anchors
from relight3d.relight.buffers import Sites, pack_view
from relight3d.relight.light_rows import light_row
from relight3d.relight.lobe_kernels import NUM_ROWS
from relight3d.relight.modes import LANES, NO_ROWS
from relight3d.relight.options import RelightOptions
from relight3d.relight.residual_kernels import NUM_PIXEL_ROWS
from relight3d.relight.shadows import Shadows
from relight3d.relight.site_light import SiteLight
from relight3d.relight.tiles import counting
from relight3d.shading import mirrored_light, residual_kernel
from relight3d.tracing import RayScene
from relight3d.views import View

EMPTY = np.zeros((0, 3), np.float32)
NO_IMAGES, NONE_MADE = np.zeros((0, 2, 0, 4), np.float32), np.zeros((0, 2, 0), np.uint8)
NO_WEIGHTS = np.zeros((0, 0), np.float32)
NO_MODES = (NO_ROWS, NO_WEIGHTS)
NO_SOURCE, NO_SHARE = np.zeros((0, 4), np.int32), np.zeros((0, 4), np.float32)


class Result(NamedTuple):
    """A frame's radiance, milliseconds and rays by effect."""

    radiance: Float32[np.ndarray, "pixel 3"]
    milliseconds: dict[str, float]
    rays: dict[str, int]


class Engine:
    """One view of a model, ready for any lights."""

    def __init__(self, scene: RayScene, model: RelightModel, view: View, options: RelightOptions) -> None:
        self.model, self.view, self.options = model, view, options
        self.buffers = pack_view(model, view, options.precision)
        self.anchors = None
        if options.shadows == "adaptive":
            self.anchors = self._anchors(options.lattice_px)
        self.shadows = Shadows(scene, model, self.buffers, options, self.anchors)
        self.sites = self.buffers.sites
        self.site_light = None if model.indirect is None else SiteLight(model.indirect)
        self.num_points = len(self.buffers)  # that a frame evaluates light at
        self.num_readings = 0 if self.sites is None else self.sites.source.size  # of indirect light, in a frame
        starts = np.append(self.buffers.point_start[: -1 : pixel_kernels.CHUNK], self.buffers.point_start[-1])
        self._chunk_points = int(np.diff(starts).max(initial=0))
        self._thrown = [k for k, mirror in enumerate(model.mirrors) if mirror.throws_light]

    def _anchors(self, spacing: int) -> Anchors:
        shared_rays = self.options.shared_rays
        return find_anchors(self.view, self.buffers, spacing, pixel_kernels.CHUNK, shared_rays)

    def render(self, lights: list[Light], effects: list[str] | None = None) -> Result:
        """Radiance under lights in centred coordinates, each with some power and none of them extended.

        `effects` names what each light's shadow rays count as: "shadow", or "soft" for a sample of an extended light.
        """
        clock = Clock()
        self.shadows.start_frame(len(lights) * (1 + len(self._thrown)))
        effects = ["shadow"] * len(lights) if effects is None else effects
        seen = [self.shadows.seen(light, effect) for light, effect in zip(lights, effects)]
        rows = [light_row(light) for light in lights]
        clock.lap("shadow")
        for k in self._thrown:
            virtual = [self._virtual_row(light, k) for light in lights]
            seen += [self.shadows.thrown(light, row, k) for light, row in zip(lights, virtual)]
            rows += virtual
            clock.lap("thrown")
        irradiance = EMPTY if self.sites is None else self._irradiance(self.sites, lights)
        clock.lap("indirect")
        weights = self._residual_weights(lights)
        clock.lap("residual")
        out = self._behind_mirrors(lights)
        all_seen = seen[0][None] if len(seen) == 1 else np.array(seen, np.uint8).reshape(len(seen), len(self.buffers))
        self._shade(np.array(rows, np.float32).reshape(-1, kernels.ROW), all_seen, weights, irradiance, out)
        clock.lap("shade")
        return Result(out, clock.milliseconds, dict(self.shadows.rays))

    def bake_shadows(self, progress: Callable[[float], object]) -> float:
        """Relighter.bake_shadows: nothing here is looked up."""
        return 1.0

    @property
    def num_bytes(self) -> int:
        """Memory of what is held for the view."""
        return self.buffers.num_bytes

    def _virtual_row(self, light: Light, mirror_index: int) -> np.ndarray:
        """The light behind the mirror that its reflection seems to come from."""
        mirror = self.model.mirrors[mirror_index]
        if isinstance(light, DirectionalLight):  # without a light that checks itself
            row, way = light_row(light), np.asarray(light.to_light)
            row[kernels.PLACE : kernels.PLACE + 3] = way - 2 * (way @ mirror.normal) * mirror.normal
        else:
            row = light_row(mirrored_light(light, mirror))
        row[kernels.COLOR : kernels.COLOR + 3] *= mirror.reflectance.astype(np.float32)
        return row

    def _shade(self, rows, seen, weights, irradiance, out) -> None:
        b, sites, residual, flat = self.buffers, self.sites, self._residual(weights), out.reshape(-1)
        site = (NO_SOURCE, NO_SHARE) if sites is None else (sites.source, sites.share)
        points = (b.position, b.normal, b.to_viewer, b.tangent, b.diffuse, b.gloss, b.surface, b.lobe_start, b.lobes)

        def shade(counter: np.ndarray) -> None:
            pixel_kernels.shade(
                counter, b.point_start, b.pixel_of_rank, rows, seen, *points, *site, irradiance, *residual,
                np.empty((NUM_ROWS, self._chunk_points), np.float32), scratch(), flat,
            )  # fmt: skip

        counting(shade)

    def _residual(self, weights: tuple[np.ndarray, np.ndarray]) -> tuple[Any, Any, Any, Any, Any, Any]:
        """The residual as the kernels read it: source and share, images to be made and which blocks are, and the lit and the
        dark modes, each rows and weights by light. No images at the captured view.
        """
        modes = self.buffers.modes
        if modes is None:
            return NO_SOURCE, NO_SHARE, NO_IMAGES, NONE_MADE, NO_MODES, NO_MODES
        images, made = NO_IMAGES, NONE_MADE
        if len(modes.source):
            num_lights, num_captured = len(weights[0]), len(self.model.pixels.points)
            images = np.empty((num_lights, 2, num_captured, 4), np.float32)
            made = np.zeros((num_lights, 2, -(-num_captured // LANES)), np.uint8)
        return modes.source, modes.share, images, made, (modes.lit, weights[0]), (modes.dark, weights[1])

    # ------------------------------------------------------------------------------------- indirect

    def _irradiance(self, sites: Sites, lights: list[Light]) -> Float32[np.ndarray, "site 4"]:
        assert self.site_light is not None
        return self.site_light.irradiance(sites, lights)

    # ------------------------------------------------------------------------------------- residual

    def _residual_weights(self, lights: list[Light]) -> tuple[np.ndarray, np.ndarray]:
        residual, indirect = self.model.residual, self.model.indirect
        if residual is None:
            return NO_WEIGHTS, NO_WEIGHTS
        softening = indirect.softening if indirect is not None else 0.5 * self.model.mesh.radius
        pairs = [self._residual_kernel(residual, light, softening) for light in lights]
        lit = np.array([p[0] for p in pairs], np.float32).reshape(len(pairs), len(residual.lit_weights))
        dark = np.array([p[1] for p in pairs], np.float32).reshape(len(pairs), len(residual.dark_weights))
        return lit, dark

    @staticmethod
    def _residual_kernel(residual: Residual, light: Light, softening: float) -> tuple[np.ndarray, np.ndarray]:
        """shading.residual_kernel, in fewer steps of Python for a light at infinity."""
        if not isinstance(light, DirectionalLight):
            return residual_kernel(residual, light, softening)
        cosine = residual.anchors @ np.asarray(light.to_light)
        angle = np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0))
        lit, dark = np.exp(angle / -residual.lit_length_rad), np.exp(angle / -residual.dark_length_rad)
        return residual.lit_weights @ lit, residual.dark_weights @ dark

    def _behind_mirrors(self, lights: list[Light]) -> Float32[np.ndarray, "pixel 3"]:
        """What pixels show before any point: the surroundings that mirrors show, where they do."""
        view, model = self.view, self.model
        out = np.zeros((view.camera.num_pixels, 3), np.float32)
        if len(view.miss_pixel) and (model.background is not None or model.residual is not None):
            radiance = background_radiance(model, view, lights) + dark_residual(model, view, lights)
            np.add.at(out, view.miss_pixel, radiance * view.miss_throughput[:, None])
            alone = np.ones(len(out), bool)
            alone[self.buffers.pixel_of_rank] = False
            out[alone] = np.maximum(out[alone], 0.0)  # the others are clamped when their points are in
        return out


def scratch() -> Float32[np.ndarray, "row lane"]:
    """What a kernel works in for a block of pixels."""
    return np.zeros((NUM_PIXEL_ROWS, LANES), np.float32)


class Clock:
    """Milliseconds between laps, added up by name."""

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.milliseconds[name] = self.milliseconds.get(name, 0.0) + 1e3 * (now - self._last)
        self._last = now

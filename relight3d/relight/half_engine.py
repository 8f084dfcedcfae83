"""Frames at half resolution: light at every second pixel each way, read at all of them along their surfaces."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from relight3d.lights import Light
from relight3d.records import RelightModel
from relight3d.relight import half_kernels, kernels
from relight3d.relight.buffers import pack_view
from relight3d.relight.engine import NO_SHARE, NO_SOURCE, Clock, Engine, Result
from relight3d.relight.half_lattice import find_half_lattice
from relight3d.relight.half_shadows import NOWHERE, HalfShadows
from relight3d.relight.half_shine_kernels import NUM_HALF_ROWS
from relight3d.relight.half_view import aligned, pack_items, pack_slots
from relight3d.relight.highlights import bright_lobes
from relight3d.relight.light_rows import light_row
from relight3d.relight.modes import LANES
from relight3d.relight.options import RelightOptions
from relight3d.relight.site_light import SiteLight
from relight3d.relight.tiles import counting
from relight3d.tracing import RayScene
from relight3d.views import View

FAINT = 1e-2  # of white: a highlight that would add less is left out
TILE = 2048  # slots that a thread takes at once
NO_LIGHT = np.zeros((0, 4), np.float32)


class HalfEngine(Engine):
    """One view of a model, ready for any lights."""

    def __init__(self, scene: RayScene, model: RelightModel, view: View, options: RelightOptions) -> None:
        self.model, self.view, self.options = model, view, options
        self.buffers = pack_view(replace(model, residual=None), view)  # items have the residual
        self.anchors, self._rooms = None, {}
        self.site_light = None if model.indirect is None else SiteLight(model.indirect)
        self._last_lobes: tuple[float | None, np.ndarray] = (None, self.buffers.lobes)
        self.lattice = find_half_lattice(view, self.buffers)
        self.slots = pack_slots(self.lattice, self.buffers)
        self.items = pack_items(self.lattice, model, model.residual, view, self.buffers, options.precision)
        self.shadows = HalfShadows(scene, model, self.lattice, self.slots, options)
        at = np.maximum(self.lattice.point, 0)
        self.sites = self.buffers.sites
        self._read = (NO_SOURCE, NO_SHARE)
        if self.sites is not None:
            self._read = (np.ascontiguousarray(self.sites.source[at]), np.ascontiguousarray(self.sites.share[at]))
        self.num_points = len(self.lattice.point)
        self.num_readings = self._read[0].size + self.lattice.corner.size
        self._longest = int(np.diff(self.lattice.row_start).max(initial=LANES))
        self._most_gloss = float(self.buffers.gloss.max(initial=0.0))
        self._thrown = [k for k, mirror in enumerate(model.mirrors) if mirror.throws_light]

    def render(self, lights: list[Light], effects: list[str] | None = None) -> Result:
        """Engine.render."""
        clock = Clock()
        self.shadows.start_frame(len(lights) * (1 + len(self._thrown)))
        effects = ["shadow"] * len(lights) if effects is None else effects
        far = [self.shadows.distance(light, effect) for light, effect in zip(lights, effects)]
        rows = [light_row(light) for light in lights]
        clock.lap("shadow")
        for k in self._thrown:
            virtual = [self._virtual_row(light, k) for light in lights]
            patches = [self.shadows.thrown(light, row, k) for light, row in zip(lights, virtual)]
            lit = [i for i, patch in enumerate(patches) if patch is not NOWHERE]
            far += [patches[i] for i in lit]
            rows += [virtual[i] for i in lit]
            clock.lap("thrown")
        at_sites = NO_LIGHT if self.sites is None else self._irradiance(self.sites, lights)
        clock.lap("indirect")
        adds = len(self.view.miss_pixel) > 0
        out = self._behind_mirrors(lights) if adds else np.empty((self.view.camera.num_pixels, 3), np.float32)
        self._fill(
            np.array(rows, np.float32).reshape(-1, kernels.ROW), far, at_sites, self._residual_weights(lights), out
        )
        clock.lap("shade")
        return Result(out, clock.milliseconds, dict(self.shadows.rays))

    def bake_shadows(self, progress: Callable[[float], object]) -> float:
        """Relighter.bake_shadows."""
        return self.shadows.bake(progress)

    @property
    def num_bytes(self) -> int:
        """Engine.num_bytes, with what is kept of lights' directions."""
        parts = [
            part for held in (self.slots, self.items) for part in vars(held).values() if isinstance(part, np.ndarray)
        ]
        rows = sum(part.nbytes for part in (*self.items.lit, *self.items.dark))
        directions = 0 if self.shadows.directions is None else self.shadows.directions.num_bytes
        return super().num_bytes + self.lattice.num_bytes + rows + sum(part.nbytes for part in parts) + directions

    def _bright_lobes(self, rows: np.ndarray) -> np.ndarray:
        """The last ones where lights at infinity did but turn."""
        key = (
            None
            if (rows[:, kernels.KIND] != kernels.AT_INFINITY).any()
            else float(rows[:, kernels.COLOR :][:, :3].max(initial=0))
        )
        if key is None or key != self._last_lobes[0]:
            most, radius = self._most_gloss * self.model.exposure, self.model.mesh.radius
            self._last_lobes = (key, bright_lobes(self.buffers.lobes, rows, most, radius, FAINT))
        return self._last_lobes[1]

    def _room(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """Memory of the frame before, where it is enough; rows begin on cache lines."""
        wide = (*shape[:-1], -(-shape[-1] // LANES) * LANES)
        if name not in self._rooms or self._rooms[name].shape != wide:
            self._rooms[name] = aligned(wide)
        return self._rooms[name]

    def _fill(self, rows, far, at_sites, weights, out) -> None:
        lattice, slots, items, num = self.lattice, self.slots, self.items, len(self.lattice.point)
        has_lamps = bool((rows[:, kernels.KIND] != kernels.AT_INFINITY).any())
        irradiance = self._room("irradiance", (3 if len(at_sites) else 0, num))
        toward = self._room("toward", (len(rows) if len(self.buffers.lobes) else 0, num))
        ways = self._room("ways", (len(rows) if has_lamps else 0, 4, num))
        source, share = self._read

        def light(counter: np.ndarray) -> None:
            given = (rows, slots.position, slots.viewer, source, share, at_sites)
            half_kernels.light_slots(counter, TILE, *given, irradiance, toward, ways)

        counting(light)
        distance = far[0][None] if len(far) == 1 else np.array(far, np.float32).reshape(len(rows), num)
        lobes = self._bright_lobes(rows)
        camera, adds = self.view.camera, len(self.view.miss_pixel) > 0
        flat = out.reshape(-1)

        def fill(counter: np.ndarray) -> None:
            half_kernels.fill(
                counter, (lattice.columns, lattice.rows), (camera.width, camera.height), lattice.row_start,
                lattice.loose_start, lattice.corner, lattice.share, lattice.pixel, rows, distance, ways, toward, irradiance,
                items.normal, items.diffuse, items.facing, items.tangent, items.surface, items.shining, items.gloss,
                items.steps, self.buffers.lobe_start, lobes, (items.lit, weights[0]), (items.dark, weights[1]), adds,
                aligned((NUM_HALF_ROWS, self._longest)), flat,
            )  # fmt: skip

        counting(fill)
        if adds:
            np.maximum(out, 0.0, out=out)

"""Shadows at half resolution: rays from slots and edges placed between them, or looked up; the last lights' answers kept."""

from collections.abc import Callable
from functools import partial

import numpy as np
from jaxtyping import Float32, Int32

from relight3d.lights import DirectionalLight, Light
from relight3d.records import RelightModel
from relight3d.relight import half_cast_kernels, ray_kernels
from relight3d.relight.casting import cast_listed, place_borders
from relight3d.relight.ground import ground_of
from relight3d.relight.half_lattice import HalfLattice
from relight3d.relight.half_view import Slots, aligned
from relight3d.relight.kept_answers import KeptAnswers
from relight3d.relight.kernels import PLACE
from relight3d.relight.light_rows import geometry_key, light_row
from relight3d.relight.options import RelightOptions
from relight3d.relight.shadow_table import Distance, KeptDirections, ShadowTable, Way
from relight3d.relight.thrown import Thrown
from relight3d.relight.tiles import counters, counting
from relight3d.shading import mirrored_light
from relight3d.tracing import RayScene, over_threads

TILE, ROWS = 1024, 8  # lanes, and rows of the grid, that a thread takes at once

STRAIGHT = -1  # of tables: not by a mirror

NOWHERE: Distance = np.zeros(0, np.float32)  # of a patch that no slot is in


class HalfShadows(KeptAnswers[Distance]):
    """The shadow rays of one view's slots, or what is looked up instead once they are baked.

    `rays` counts those of the lights asked for since `start_frame`.
    """

    def __init__(
        self, scene: RayScene, model: RelightModel, lattice: HalfLattice, slots: Slots, options: RelightOptions
    ) -> None:
        super().__init__(options.keep_lights)
        self._scene, self._lattice, self._slots, self._options = scene, lattice, slots, options
        self._offset, self._ground = np.float32(scene.offset_distance), ground_of(model.mesh)
        num = len(lattice.point)
        self._state, self._of_lane = np.zeros(num, np.uint8), np.zeros(len(slots.lane), np.uint8)
        self._of_cell = np.empty(len(lattice.cell), np.uint8)
        padding = len(slots.lane) - slots.num_first - len(lattice.later)
        self._cells_of = np.concatenate([lattice.later_cell, np.repeat(lattice.later_cell[-1:], padding, axis=0)])
        self._turn = np.zeros(num, np.int32)
        self._turn[slots.lane] = np.arange(len(slots.lane), dtype=np.int32)
        self._edges = np.full((2, lattice.num_grid), half_cast_kernels.NO_EDGE, np.float32)
        geometry = (slots.lane_position, slots.lane_geometric)
        self._thrown = Thrown(scene, model, *geometry, slots.lane_geometric)
        self._mirrors = model.mirrors
        self.directions: KeptDirections | None = None  # that tables know, once they are baked
        self._tables: dict[int, ShadowTable] = {}  # by the mirror that turns the light, or STRAIGHT
        self._part_baked = 0.0  # of all directions

    def distance(self, light: Light, effect: str = "shadow") -> Distance:
        """How far slots are from the edge of the light's shadow. Rays are counted as `effect`."""
        return self.keep(geometry_key(light), partial(self._make, light, effect))

    def thrown(self, light: Light, virtual: Float32[np.ndarray, " row"], mirror_index: int) -> Distance:
        """The same of the patch that a mirror throws, as if from a `virtual` light behind it: its edge is half-way.

        NOWHERE where no slot is in it.
        """
        return self.keep((*geometry_key(light), mirror_index), partial(self._make_thrown, light, virtual, mirror_index))

    def bake(self, progress: Callable[[float], object]) -> float:
        """Cast ahead the directions that lights at infinity may come from, high ones first, as far as there is room.

        Returns what part of them is there. From now on shadows are looked up where their directions are.
        """
        if self._options.shadows == "off":
            return 1.0
        if self._tables:  # they stay as they are
            return self._part_baked
        options, num = self._options, len(self._lattice.point)
        has_ground = len(self._ground) > 0
        pole = self._ground[1] if has_ground else np.array([0.0, 0.0, 1.0])
        directions = KeptDirections(num, options.table_mb)
        side = round(options.table_directions**0.5)
        given = (self._lattice, self._slots.geometric, side, pole, has_ground, directions)
        vias = [STRAIGHT, *(k for k, mirror in enumerate(self._mirrors) if mirror.throws_light)]
        tables = {via: ShadowTable(*given, via) for via in vias}
        least = 0.0 if has_ground else -1.0
        wanted = [(h, via, k) for via, table in tables.items() for k, h in enumerate(table.heights()) if h >= least]
        wanted.sort(key=lambda each: -each[0])
        self.start_frame(0)
        for done, (_, via, k) in enumerate(wanted, start=1):
            tables[via].learn(k, partial(self._cast_way, via))
            progress(done / len(wanted))
            if directions.is_full:
                break
        self.directions, self._tables, self._part_baked = directions, tables, len(directions) / len(wanted)
        self.forget()
        return self._part_baked

    def _make(self, light: Light, effect: str) -> Distance:
        if self._tables and isinstance(light, DirectionalLight) and self._is_above(light):
            found = self._tables[STRAIGHT].look_up(np.asarray(light.to_light, np.float64))
            if found is not None:
                return found[0]
        return self._cast(light_row(light)[None], effect)

    def _make_thrown(self, light: Light, virtual: Float32[np.ndarray, " row"], mirror_index: int) -> Distance:
        if self._tables and isinstance(light, DirectionalLight):
            way = np.asarray(light.to_light, np.float64)
            if way @ self._mirrors[mirror_index].normal <= 0:
                return NOWHERE
            found = self._tables[mirror_index].look_up(way, virtual[PLACE : PLACE + 3])
            if found is not None:
                return found[0] if found[1] else NOWHERE
        return self._cast_thrown(light, virtual[None], mirror_index)

    def _is_above(self, light: DirectionalLight) -> bool:
        """From under the ground no slot is lit, but beside it: too sharp a change to be kept by directions."""
        return len(self._ground) == 0 or bool(self._ground[1] @ light.to_light > 0)

    def _cast_way(self, via: int, way: Way) -> Distance:
        """A direction's shadow: straight, or by a mirror."""
        light = DirectionalLight(tuple(way), 1.0)
        if via == STRAIGHT:
            return self._cast(light_row(light)[None], "shadow")
        return self._cast_thrown(light, light_row(mirrored_light(light, self._mirrors[via]))[None], via)

    def _cast(self, light: Float32[np.ndarray, "1 row"], effect: str) -> Distance:
        has_shadows = self._options.shadows != "off"
        num = self._cast_lanes(light) if has_shadows else self._face(light)
        self.rays[effect] = self.rays.get(effect, 0) + (num if has_shadows else 0)
        distance, num_border = self._distances(light, has_shadows and self._options.borders)
        self.rays["border"] += num_border
        return distance

    def _cast_lanes(self, light: np.ndarray) -> int:
        packets, slots, cells_of = self._scene.packets, self._slots, self._cells_of
        geometry = (slots.lane_position, slots.lane_geometric)
        if packets is None:
            return self._cast_in_steps(light)
        addresses = (packets.occluded, packets.scene, packets.arguments)
        given = (addresses, light, self._ground, *geometry, self._offset, slots.lane)
        states, num = (self._of_lane, self._state), slots.num_first
        rays = sum(counting(lambda counter: half_cast_kernels.cast_lanes(counter, TILE, num, *given, *states)))
        half_cast_kernels.agree(self._lattice.cell, self._state, self._of_cell)
        of_cells = (cells_of, self._of_cell)
        return rays + sum(
            counting(lambda counter: half_cast_kernels.cast_later(counter, TILE, *given, *of_cells, *states))
        )

    def _cast_in_steps(self, light: np.ndarray) -> int:
        """The same where Embree's packets cannot be had."""
        slots, of_lane, first = self._slots, self._of_lane, self._slots.num_first
        geometry = (slots.lane_position, slots.lane_geometric)
        half_cast_kernels.face_lanes(light, self._ground, *geometry, 0, first, of_lane)
        index = np.flatnonzero(of_lane[:first] == ray_kernels.ASKS).astype(np.int32)
        cast_listed(self._scene, light, *geometry, index, of_lane, np.empty_like(of_lane))
        self._state[slots.lane[:first]] = of_lane[:first]
        half_cast_kernels.agree(self._lattice.cell, self._state, self._of_cell)
        later, ends = np.empty(len(of_lane) + 1, np.int32), (first, len(of_lane))
        given = (*geometry, *ends, slots.lane, self._cells_of, self._of_cell, of_lane, self._state, later)
        later = later[: half_cast_kernels.read_cells(light, self._ground, *given)]
        cast_listed(self._scene, light, *geometry, later, of_lane, np.empty_like(of_lane))
        self._state[slots.lane[later]] = of_lane[later]
        return len(index) + len(later)

    def _face(self, light: np.ndarray) -> int:
        """States without a ray: everything that faces the light is lit."""
        slots, of_lane = self._slots, self._of_lane
        geometry = (slots.lane_position, slots.lane_geometric)
        half_cast_kernels.face_lanes(light, self._ground, *geometry, 0, len(of_lane), of_lane)
        of_lane[of_lane == ray_kernels.ASKS] = ray_kernels.LIT
        self._state[slots.lane] = of_lane
        return len(of_lane)

    def _distances(self, light: np.ndarray | None, has_rays: bool) -> tuple[Distance, int]:
        """Distances to edges from the slots' states, and the number of rays that placed edges."""
        lattice, edges, state = self._lattice, self._edges, self._state
        grid = state[: lattice.num_grid]

        def place(counter: np.ndarray) -> int:
            pairs = np.empty((2 * lattice.num_grid if has_rays else 1, 3), np.int32)
            pairs = pairs[
                : half_cast_kernels.find_edges(
                    counter, ROWS, lattice.columns, lattice.is_joined, grid, has_rays, edges, pairs
                )
            ]
            if len(pairs):
                pairs = pairs[np.argsort(self._turn[pairs[:, 0]])]
                self._place(light, pairs)
            return len(pairs)

        num = sum(over_threads(place, counters()))
        distance = aligned((len(state),))
        half_cast_kernels.edge_distances(np.zeros(1, np.int64), lattice.columns, lattice.rows, state, edges, distance)
        return distance, 3 * num

    def _place(self, light, pairs: Int32[np.ndarray, "pair 3"]) -> None:
        slots = self._slots
        geometry = (slots.position, slots.geometric, slots.step[pairs[:, 0]])
        half_cast_kernels.write_edges(pairs, place_borders(self._scene, light, *geometry, pairs), self._edges)

    def _cast_thrown(self, light: Light, virtual: Float32[np.ndarray, "1 row"], mirror_index: int) -> Distance:
        seen, num = self._thrown.cast(light, virtual, mirror_index)
        self.rays["thrown"] += num
        if not seen.any():
            return NOWHERE
        self._state[self._slots.lane] = np.where(seen > 0, np.uint8(ray_kernels.LIT), np.uint8(ray_kernels.AWAY))
        return self._distances(None, False)[0]

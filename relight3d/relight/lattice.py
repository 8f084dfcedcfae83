"""Shadows on a lattice: rays for anchors, then for the points between anchors that disagree, then along the edges."""

import numpy as np
from jaxtyping import Int32, UInt8

from relight3d.relight import lattice_kernels
from relight3d.relight.anchors import Anchors
from relight3d.relight.borders import Borders, Pairs
from relight3d.relight.buffers import Buffers
from relight3d.relight.casting import cast_listed
from relight3d.relight.tiles import tiles
from relight3d.tracing import RayScene, over_threads

MIN_LISTED = 1024  # a smaller tile of anchors is not worth a thread


class Lattice:
    """The shadow rays of one view on its anchors."""

    def __init__(
        self, scene: RayScene, buffers: Buffers, anchors: Anchors, ground: np.ndarray, borders: Borders
    ) -> None:
        self._scene, self._buffers, self._anchors, self._ground = scene, buffers, anchors, ground
        self._borders = borders
        self._state = np.zeros(len(buffers), np.uint8)
        self._geometry = (buffers.position, buffers.geometric_normal, buffers.normal)
        at = anchors.traced
        position, geometric, normal = (np.ascontiguousarray(plane[:, at]) for plane in self._geometry)
        self._near = (position, geometric, normal)  # of traced points alone
        self._of_traced, self._seen_of_traced = np.zeros(len(at), np.uint8), np.zeros(len(at), np.uint8)
        place = np.zeros(len(buffers) + 1, np.int32)  # the last one for no witness
        place[at] = np.arange(len(at), dtype=np.int32)
        self._cell_witness = place[anchors.point[anchors.cell_corner]]
        self._witness = place[anchors.witness]

    def cast(self, light: np.ndarray, seen: UInt8[np.ndarray, " point"], has_borders: bool) -> tuple[int, int]:
        """How far each point sees the light, written to `seen`; the number of shadow rays and of those at edges."""
        a = self._anchors
        num = sum(over_threads(lambda part: self._cast_traced(light, part, seen), tiles(len(a.traced), MIN_LISTED)))
        states = (self._of_traced, self._state)
        work = [(a.cell, part) for part in tiles(len(a.cell), MIN_LISTED)]
        work += [(a.loose, part) for part in tiles(len(a.loose), MIN_LISTED)]
        traced = over_threads(lambda task: self._spread(light, task[0], task[1], states, seen), work)
        lattice_kernels.follow(a.loose, a.lead, self._state, seen)
        num += sum(len(index) for index in traced)
        return num, self._borders.cast(light, self._find_borders, traced, seen) if has_borders else 0

    def _cast_traced(self, light: np.ndarray, part: slice, seen: np.ndarray) -> int:
        index, ends = np.empty(part.stop - part.start + 1, np.int32), (part.start, part.stop)
        count = lattice_kernels.face_traced(light, self._ground, self._near, *ends, self._of_traced, index)
        position, geometric, _ = self._near
        cast_listed(self._scene, light, position, geometric, index[:count], self._of_traced, self._seen_of_traced)
        lattice_kernels.scatter(self._anchors.traced, self._of_traced, *ends, self._state, seen)
        return count

    def _spread(self, light: np.ndarray, listed: np.ndarray, part: slice, states, seen) -> Int32[np.ndarray, " ray"]:
        a, light_on = self._anchors, (light, self._ground, self._geometry)
        if listed is a.cell:
            index = np.empty(16 * (part.stop - part.start) + 1, np.int32)
            given = (a.cell, self._cell_witness, part.start, part.stop)
            count = lattice_kernels.spread_cells(*light_on, *given, states, seen, index)
        else:
            index = np.empty(part.stop - part.start + 1, np.int32)
            given = (a.loose, self._witness, a.lead, a.is_sure, part.start, part.stop)
            count = lattice_kernels.spread_loose(*light_on, *given, states, seen, index)
        b, index = self._buffers, index[:count]
        cast_listed(self._scene, light, b.position, b.geometric_normal, index, self._state, seen)
        return index

    def _find_borders(self, index: Int32[np.ndarray, " ray"]) -> Pairs:
        pairs = np.empty((4 * len(index) + 1, 3), np.int32)
        return pairs[: lattice_kernels.find_borders_among(self._buffers.neighbour, self._state, index, pairs)]

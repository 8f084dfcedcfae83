"""Precomputed shadows: a view's shadows under directions all around, and any direction's from the three about it.

What is kept of a direction is how far each slot is from the shadow's edge, in pixels of the picture, positive where it
is lit: one byte. As the light turns an edge moves across the slots, and that number changes steadily. So the number
for a direction in between is the blend of its three neighbours', and where it passes 0 is the edge: as sharp as a cast
one, off by the bend of its way between the neighbours (a second-order term). Blending the shadows themselves would
show three faint ones. What is lost are shadows narrower than the step from one direction to the next, and sharp corners.

Nothing is cast ahead of its use unless asked for (`fill`): a direction is cast in the first frame that needs it, and
those not used for longest make room.
"""

from collections import OrderedDict
from collections.abc import Callable

import numpy as np
from jaxtyping import Float32, Float64, Int8

from relight3d.maths.octahedral import directions_about, octahedral_directions
from relight3d.relight import table_kernels
from relight3d.relight.half_lattice import HalfLattice
from relight3d.relight.half_view import aligned

Distance = Float32[np.ndarray, " slot"]
Way = Float64[np.ndarray, "3"]
Cast = Callable[
    [Way], Distance
]  # distances to edges, half_cast_kernels.edge_distances; of length 0 where no slot is lit


class ShadowTable:
    """Of one view and one way that light takes: straight, or by one mirror. `pole`: the map's middle, a unit vector."""

    def __init__(
        self, lattice: HalfLattice, geometric: Float32[np.ndarray, "3 slot"], side: int, megabytes: int, pole: Way
    ) -> None:
        self._lattice, self._geometric, self._side = lattice, geometric, side
        self._room = max(3, megabytes * 1_000_000 // max(len(lattice.point), 1))  # directions that are kept
        self._axes = np.stack([*_across(pole), pole])  # to the map's own
        self._ways = octahedral_directions(side) @ self._axes
        self._kept: OrderedDict[int, Int8[np.ndarray, " slot"]] = OrderedDict()
        self._far = np.empty(lattice.num_grid, np.float32)
        self._dark = np.full(len(lattice.point), -127, np.int8)

    @property
    def num_bytes(self) -> int:
        """Memory of the directions that it holds now."""
        return sum(each.nbytes for each in self._kept.values() if each is not self._dark)

    def look_up(self, way: Way, cast: Cast, arrival: Way | None = None) -> tuple[Distance, int]:
        """Distances to the edge of the shadow of a light at infinity, and how many slots are lit, or near it.

        `cast` is asked for directions that are not there yet. `arrival`: where the light comes from in the end, if a
        mirror turned it.
        """
        at, shares = directions_about(self._axes @ way, self._side)
        one, two, three = (self._entry(k, cast) for k in at)
        out = aligned((len(self._dark),))
        facing = np.asarray(way if arrival is None else arrival, np.float32)
        num_lit = table_kernels.blend(one, two, three, np.array(shares, np.float32), self._geometric, facing, out)
        return out, num_lit

    def fill(self, cast: Cast, height: float, progress: Callable[[float], object] = lambda part: None) -> None:
        """Cast everything ahead, as far as there is room: directions at least so high over the pole's plane."""
        wanted = np.flatnonzero(self._ways @ self._axes[2] >= height)[: self._room]
        for done, k in enumerate(wanted):
            self._entry(int(k), cast)
            progress((done + 1) / len(wanted))

    @property
    def step(self) -> float:
        """The angle from one direction to the next, about, in radians."""
        return float(np.sqrt(4 * np.pi) / self._side)

    def _entry(self, k: int, cast: Cast) -> Int8[np.ndarray, " slot"]:
        if k in self._kept:
            self._kept.move_to_end(k)
            return self._kept[k]
        distance = cast(self._ways[k])
        entry = self._dark
        if len(distance):
            entry, lattice = np.empty(len(distance), np.int8), self._lattice
            table_kernels.grow(distance, lattice.is_joined, lattice.columns, lattice.rows, self._far, entry)
        while len(self._kept) >= self._room:
            self._kept.popitem(last=False)
        self._kept[k] = entry
        return entry


def _across(pole: Way) -> tuple[Way, Way]:
    """Two axes that make a frame with a unit vector."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(pole))], pole)
    x /= np.linalg.norm(x)
    return x, np.cross(pole, x)

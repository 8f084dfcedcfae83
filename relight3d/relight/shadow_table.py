"""Precomputed shadows: a view's shadows under directions all around, and any direction's from the three about it.

What is kept of a direction is how far each slot is from the shadow's edge, in pixels of the picture, positive where it
is lit: one byte. As the light turns an edge moves across the slots, and that number changes steadily. So the number
for a direction in between is the blend of its three neighbours', and where it passes 0 is the edge: as sharp as a cast
one, off by the bend of its way between the neighbours (a second-order term). Blending the shadows themselves would
show three faint ones. What is lost are shadows narrower than the step from one direction to the next, and sharp corners.

Nothing is cast ahead of its use unless asked for: a direction is cast in the first frame that needs it, and
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

LIFT = 2e-3

Distance = Float32[np.ndarray, " slot"]
Way = Float64[np.ndarray, "3"]
Cast = Callable[
    [Way], Distance
]  # distances to edges, half_cast_kernels.edge_distances; of length 0 where no slot is lit


class KeptDirections:
    """What is kept of a view's directions, for all its tables; those not used for longest make room."""

    def __init__(self, num_slots: int, megabytes: int) -> None:
        self.dark = np.full(num_slots, -127, np.int8)  # stands for every direction that lights nothing
        self._room = max(6, megabytes * 1_000_000 // max(num_slots, 1))
        self._entries: OrderedDict[tuple[int, int], Int8[np.ndarray, " slot"]] = OrderedDict()
        self._num_dark = 0

    def __len__(self) -> int:
        """How many have memory of their own."""
        return len(self._entries) - self._num_dark

    @property
    def num_bytes(self) -> int:
        """Memory that they take now."""
        return len(self) * self.dark.nbytes

    @property
    def is_full(self) -> bool:
        return len(self) >= self._room

    def get(self, key: tuple[int, int]) -> Int8[np.ndarray, " slot"] | None:
        entry = self._entries.get(key)
        if entry is not None:
            self._entries.move_to_end(key)
        return entry

    def put(self, key: tuple[int, int], entry: Int8[np.ndarray, " slot"]) -> None:
        while self.is_full and entry is not self.dark:
            _, oldest = self._entries.popitem(last=False)
            self._num_dark -= oldest is self.dark
        self._entries[key] = entry
        self._num_dark += entry is self.dark


class ShadowTable:
    """Of one view and one way that light takes, `name`: straight, or by a mirror.

    `pole`: the map's middle, which stands upright on the ground where there is one.
    """

    def __init__(
        self,
        lattice: HalfLattice,
        geometric: Float32[np.ndarray, "3 slot"],
        side: int,
        pole: Way,
        is_on_ground: bool,
        kept: KeptDirections,
        name: int,
    ) -> None:
        self._lattice, self._geometric, self._side = lattice, geometric, side
        self._kept, self._name = kept, name
        self._axes = np.stack([*_across(pole), pole])  # to the map's own
        self._ways = octahedral_directions(side) @ self._axes
        if is_on_ground:  # light along it comes from nowhere: those on the horizon stand for what is just above
            self._ways += LIFT * (np.abs(self._ways @ pole) < LIFT / 2)[:, None] * pole
            self._ways /= np.linalg.norm(self._ways, axis=1, keepdims=True)
        self._far = np.empty(lattice.num_grid, np.float32)

    def look_up(self, way: Way, cast: Cast, arrival: Way | None = None) -> tuple[Distance, int]:
        """Distances to the edge of the shadow of a light at infinity, and how many slots are lit, or near it.

        `cast` is asked for directions that are not there yet. `arrival`: where the light comes from in the end, if a
        mirror turned it.
        """
        at, shares = directions_about(self._axes @ way, self._side)
        one, two, three = (self._entry(k, cast) for k in at)
        out = aligned((len(self._lattice.point),))
        facing = np.asarray(way if arrival is None else arrival, np.float32)
        num_lit = table_kernels.blend(one, two, three, np.array(shares, np.float32), self._geometric, facing, out)
        return out, num_lit

    def heights(self) -> Float64[np.ndarray, " direction"]:
        """How high over the pole's plane each direction is that can be asked for: its sine."""
        return self._ways @ self._axes[2]

    def learn(self, k: int, cast: Cast) -> None:
        """Cast direction k, unless it is there."""
        self._entry(k, cast)

    def _entry(self, k: int, cast: Cast) -> Int8[np.ndarray, " slot"]:
        entry = self._kept.get((self._name, k))
        if entry is None:
            distance, entry = cast(self._ways[k]), self._kept.dark
            if len(distance):
                entry, lattice = np.empty(len(distance), np.int8), self._lattice
                table_kernels.grow(distance, lattice.is_joined, lattice.columns, lattice.rows, self._far, entry)
            self._kept.put((self._name, k), entry)
        return entry


def _across(pole: Way) -> tuple[Way, Way]:
    """Two axes that make a frame with a unit vector."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(pole))], pole)
    x /= np.linalg.norm(x)
    return x, np.cross(pole, x)

"""Precomputed shadows: a view's shadows under directions all around, and any direction's from the three about it.

What is kept of a direction is how far each slot is from the shadow's edge, in pixels of the picture, positive where it
is lit: one byte. As the light turns an edge moves across the slots, and that number changes steadily. So the number
for a direction in between is the blend of its three neighbours', and where it passes 0 is the edge: as sharp as a cast
one, off by the bend of its way between the neighbours (a second-order term). Blending the shadows themselves would
show three faint ones. What is lost are shadows narrower than the step from one direction to the next, and sharp corners.

Directions are cast ahead, all of them (`Relighter.bake_shadows`): a frame casts its own light, or looks it up, whatever
frames came before it.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float32, Float64, Int8

from relight3d.maths.octahedral import directions_about, octahedral_directions
from relight3d.relight import table_kernels
from relight3d.relight.half_lattice import HalfLattice
from relight3d.relight.half_view import aligned

LIFT = 2e-3  # radians above the ground

Distance = Float32[np.ndarray, " slot"]  # to the shadow's edge, in pixels, at most SPACING; positive where lit
Way = Float64[np.ndarray, "3"]
# Distances to edges of a direction, half_cast_kernels.edge_distances; of length 0 where no slot is lit.
Cast = Callable[[Way], Distance]


class KeptDirections:
    """What is kept of a view's directions, for all its tables, up to so many megabytes."""

    def __init__(self, num_slots: int, megabytes: int) -> None:
        self.dark = np.full(num_slots, -127, np.int8)  # stands for every direction that lights nothing
        self._room = megabytes * 1_000_000 // max(num_slots, 1)
        self._entries: dict[tuple[int, int], Int8[np.ndarray, " slot"]] = {}  # by table and direction
        self._num_own = 0

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def num_bytes(self) -> int:
        """Memory that they take."""
        return self._num_own * self.dark.nbytes

    @property
    def is_full(self) -> bool:
        return self._num_own >= self._room

    def get(self, key: tuple[int, int]) -> Int8[np.ndarray, " slot"] | None:
        return self._entries.get(key)

    def put(self, key: tuple[int, int], entry: Int8[np.ndarray, " slot"]) -> None:
        self._entries[key] = entry
        self._num_own += entry is not self.dark


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

    def look_up(self, way: Way, arrival: Float32[np.ndarray, "3"] | None = None) -> tuple[Distance, int] | None:
        """Distances to the edge of the shadow of a light at infinity, and how many slots are lit, or near it.

        None where a direction about it is not there. `arrival`: where the light comes from in the end, after a mirror.
        """
        at, shares = directions_about(self._axes @ way, self._side)
        one, two, three = (self._kept.get((self._name, k)) for k in at)
        if one is None or two is None or three is None:
            return None
        out = aligned((len(self._lattice.point),))
        facing = np.asarray(way if arrival is None else arrival, np.float32)
        num_lit = table_kernels.blend(one, two, three, np.array(shares, np.float32), self._geometric, facing, out)
        return out, num_lit

    def heights(self) -> Float64[np.ndarray, " direction"]:
        """How high over the pole's plane each direction is that can be asked for: its sine."""
        return self._ways @ self._axes[2]

    def learn(self, k: int, cast: Cast) -> None:
        """Cast direction k, and keep it."""
        distance, entry = cast(self._ways[k]), self._kept.dark
        if len(distance):
            entry, lattice = np.empty(len(distance), np.int8), self._lattice
            table_kernels.grow(distance, lattice.is_joined, lattice.columns, lattice.rows, self._far, entry)
        self._kept.put((self._name, k), entry)


def _across(pole: Way) -> tuple[Way, Way]:
    """Two axes that make a frame with a unit vector."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(pole))], pole)
    x /= np.linalg.norm(x)
    return x, np.cross(pole, x)

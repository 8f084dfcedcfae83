"""The soft borders of a view's shadows: forward.border_fractions, compiled and over threads."""

from collections.abc import Callable, Iterable

import numpy as np
from jaxtyping import Int32, UInt8

from relight3d.maths.pixel_parts import BESIDE_LINE, HALVINGS
from relight3d.relight import ray_kernels
from relight3d.relight.buffers import Buffers
from relight3d.relight.casting import place_borders
from relight3d.tracing import RayScene, over_threads

Pairs = Int32[np.ndarray, "pair 3"]  # a lit point, a dark one, and which neighbour of the lit one that is


class Borders:
    """The rays between lit and dark neighbours, and what of their pixels is lit."""

    def __init__(self, scene: RayScene, buffers: Buffers) -> None:
        self._scene, self._buffers = scene, buffers
        self._edges = np.zeros((len(buffers), 4), np.uint8)

    def cast(
        self, light: np.ndarray, find: Callable[..., Pairs], parts: Iterable, seen: UInt8[np.ndarray, " point"]
    ) -> int:
        """Soften the borders in `seen`; find(part) tells their pairs in each part. Returns the number of rays."""
        b = self._buffers

        def place(part) -> tuple[np.ndarray, np.ndarray]:
            pairs = find(part)
            steps = b.steps(pairs[:, 0])
            return pairs, place_borders(self._scene, light, b.position, b.geometric_normal, steps, pairs)

        found = over_threads(place, parts)
        if not found:
            return 0
        # All at once: a pixel's two edges may come from two threads.
        pairs, places = (np.concatenate(each) for each in zip(*found))
        ray_kernels.settle_borders(pairs, places, BESIDE_LINE, self._edges, seen)
        return HALVINGS * len(pairs)

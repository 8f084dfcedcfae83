"""In which order pixels are walked, and how points are dealt to threads."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Int32, Int64

from relight3d.tracing import num_threads, over_threads

TILES_PER_THREAD = 4  # so that a thread that is held up leaves its work to the others
MIN_TILE = 4096


def tiles(num: int, multiple: int = 16) -> list[slice]:
    """Slices that cover range(num), each beginning at a multiple."""
    size = max(MIN_TILE, -(-num // (TILES_PER_THREAD * num_threads())))
    size = -(-size // multiple) * multiple
    return [slice(first, min(first + size, num)) for first in range(0, num, size)]


def counters() -> list[Int64[np.ndarray, "1"]]:
    """For every thread the same counter, by which loops take tile after tile (kernels.take)."""
    return [np.zeros(1, np.int64)] * num_threads()


def counting(work: Callable[[Int64[np.ndarray, "1"]], Any]) -> list:
    """work(counter) on every thread: they meet at the interpreter's lock once, not at every tile."""
    return over_threads(work, counters())


@lru_cache(maxsize=8)
def rank_of_pixel(width: int, height: int) -> Int32[np.ndarray, " pixel"]:
    """Where each pixel stands when the picture is walked in blocks of 4 x 4; with gaps where blocks stick out."""
    y, x = np.divmod(np.arange(width * height, dtype=np.int32), np.int32(width))
    return (((y // 4) * -(-width // 4) + x // 4) * 16 + (y % 4) * 4 + x % 4).astype(np.int32)


@lru_cache(maxsize=8)
def pixel_of_seat(width: int, height: int) -> Int32[np.ndarray, " seat"]:
    """The pixels in that order, without gaps."""
    return np.argsort(rank_of_pixel(width, height), kind="stable").astype(np.int32)

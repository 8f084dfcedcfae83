"""How points are dealt to threads."""

from relight3d.tracing import num_threads

TILES_PER_THREAD = 4  # so that a thread that is held up leaves its work to the others
MIN_TILE = 4096


def tiles(num: int, multiple: int = 16) -> list[slice]:
    """Slices that cover range(num), each beginning at a multiple."""
    size = max(MIN_TILE, -(-num // (TILES_PER_THREAD * num_threads())))
    size = -(-size // multiple) * multiple
    return [slice(first, min(first + size, num)) for first in range(0, num, size)]

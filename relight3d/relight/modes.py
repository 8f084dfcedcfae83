"""The residual's modes, packed for vector registers, and how a view reads them."""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float32, Int32

from relight3d.records import RelightModel, Residual
from relight3d.relight.tiles import tiles
from relight3d.relight.view_kernels import fade_shares
from relight3d.tracing import over_threads
from relight3d.views import View

LANES = 16  # pixels side by side in a block

# A residual's blocks serve every viewpoint; they go when the residual does.
_blocks: "WeakKeyDictionary[Residual, dict[tuple[bool, str], tuple]]" = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Modes:
    """The residual's modes in blocks, float32 or int16 in steps of `lit_step` and `dark_step`.

    At the captured view block rows are ranks, and `source` is empty; elsewhere they are the captured points, which each
    point of the view reads by `source` and `share`.
    """

    lit: np.ndarray  # block x mode x (3 LANES)
    dark: np.ndarray
    lit_step: Float32[np.ndarray, " lit"]
    dark_step: Float32[np.ndarray, " dark"]
    source: Int32[np.ndarray, "point 4"]
    share: Float32[np.ndarray, "point 4"]

    @property
    def num_bytes(self) -> int:
        return self.lit.nbytes + self.dark.nbytes


def pack_modes(
    model: RelightModel, residual: Residual, view: View, order: np.ndarray, pixel_of_rank: np.ndarray, precision: str
) -> Modes:
    """The modes in the order in which the view walks its pixels, or the captured points theirs."""
    captured = view.camera.same_as(model.camera)
    if captured:
        row_of_pixel = np.full(view.camera.num_pixels, -1, np.int32)
        row_of_pixel[model.pixels.points.pixel] = np.arange(len(model.pixels.points), dtype=np.int32)
        rows = row_of_pixel[pixel_of_rank]
        source, share = np.zeros((0, 4), np.int32), np.zeros((0, 4), np.float32)
    else:
        rows = np.arange(len(model.pixels.points), dtype=np.int32)
        source, share = _faded(model, view, order)
    kept = _blocks.setdefault(residual, {})
    key = (captured, precision)  # the captured view has one order, all others share another
    if key not in kept:
        lit, lit_step = _in_blocks(residual.lit_modes, rows, precision)
        dark, dark_step = _in_blocks(residual.dark_modes, rows, precision)
        kept[key] = (lit, dark, lit_step, dark_step)
    lit, dark, lit_step, dark_step = kept[key]
    return Modes(lit, dark, lit_step, dark_step, source, share)


def _faded(model: RelightModel, view: View, order: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """forward.residual_source for a view that is not the captured one, over the points of each pixel."""
    counts = np.bincount(view.points.pixel, minlength=view.camera.num_pixels).astype(np.int32)
    source, share = np.empty((len(order), 4), np.int32), np.empty((len(order), 4), np.float32)
    captured = model.pixels.points.to_viewer

    def fade(part: slice) -> None:
        given = (order, view.source, view.share, captured, view.points.to_viewer, view.is_mirrored, view.points.pixel)
        fade_shares(part.start, part.stop, *given, counts, source, share)

    over_threads(fade, tiles(len(order)))
    return source, share


def _in_blocks(modes: np.ndarray, rows: np.ndarray, precision: str) -> tuple[np.ndarray, np.ndarray]:
    """modes[rows] as block x mode x (3 LANES), and the step of each mode; rows below 0 and the padding are zero."""
    num_blocks, num_modes = -(-len(rows) // LANES), modes.shape[1]
    step = np.ones(num_modes, np.float32)
    if precision == "int16" and modes.size:
        step = (np.maximum(np.abs(modes).max(axis=(0, 2)), 1e-30) / 32767).astype(np.float32)
    out = np.zeros((num_blocks, num_modes, 3 * LANES), np.int16 if precision == "int16" else np.float32)
    for first in range(0, num_blocks, 256):  # in parts, so that no second copy of everything is held
        part = rows[first * LANES : (first + 256) * LANES]
        values = np.where((part >= 0)[:, None, None], modes[np.maximum(part, 0)], 0)
        if precision == "int16":
            values = np.rint(values / step[None, :, None]).astype(np.int16)
        padded = np.zeros((-(-len(part) // LANES) * LANES, num_modes, 3), out.dtype)
        padded[: len(part)] = values
        out[first : first + 256] = (
            padded.reshape(len(padded) // LANES, LANES, num_modes, 3)
            .transpose(0, 2, 3, 1)
            .reshape(len(padded) // LANES, num_modes, 3 * LANES)
        )
    return out, step

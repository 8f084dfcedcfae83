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

LANES = 64  # pixels side by side in a block

# A residual's blocks serve every viewpoint; they go when the residual does.
_blocks: "WeakKeyDictionary[Residual, dict[tuple[bool, str], tuple]]" = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Modes:
    """The residual's modes in blocks, float32, or int16 in steps of 1/32767 of each mode's peak in its block.

    At the captured view block rows are ranks, and `source` is empty; elsewhere they are the captured points, which each
    point of the view reads by `source` and `share`.
    """

    lit: np.ndarray  # block x mode x (3 LANES)
    dark: np.ndarray
    lit_step: Float32[np.ndarray, "block lit"]
    dark_step: Float32[np.ndarray, "block dark"]
    source: Int32[np.ndarray, "point 4"]
    share: Float32[np.ndarray, "point 4"]

    @property
    def num_bytes(self) -> int:
        return sum(each.nbytes for each in (self.lit, self.dark, self.lit_step, self.dark_step))


def pack_modes(
    model: RelightModel,
    residual: Residual,
    view: View,
    order: np.ndarray,
    pixel_of_rank: np.ndarray,
    start: np.ndarray,
    to_viewer: Float32[np.ndarray, "3 point"],
    precision: str,
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
        counts = np.diff(start)
        part = np.repeat((1 / counts).astype(np.float32), counts)
        source, share = _faded(model, view, order, part, to_viewer)
    kept = _blocks.setdefault(residual, {})
    key = (captured, precision)  # the captured view has one order, all others share another
    if key not in kept:
        lit, lit_step = _in_blocks(residual.lit_modes, rows, precision)
        dark, dark_step = _in_blocks(residual.dark_modes, rows, precision)
        kept[key] = (lit, dark, lit_step, dark_step)
    lit, dark, lit_step, dark_step = kept[key]
    return Modes(lit, dark, lit_step, dark_step, source, share)


def _faded(
    model: RelightModel, view: View, order: np.ndarray, part: np.ndarray, to_viewer: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """forward.residual_source for a view that is not the captured one; each point has a part of its pixel's."""
    source, share = np.empty((len(order), 4), np.int32), np.empty((len(order), 4), np.float32)
    given = (order, view.source, view.share, model.pixels.points.to_viewer, to_viewer, view.is_mirrored, part)

    def fade(piece: slice) -> None:
        fade_shares(piece.start, piece.stop, *given, source, share)

    over_threads(fade, tiles(len(order)))
    return source, share


def _in_blocks(modes: np.ndarray, rows: np.ndarray, precision: str) -> tuple[np.ndarray, np.ndarray]:
    """modes[rows] as block x mode x (3 LANES), and the steps; rows below 0 and the padding are zero."""
    num_blocks, num_modes, short = -(-len(rows) // LANES), modes.shape[1], precision == "int16"
    out = np.empty((num_blocks, num_modes, 3 * LANES), np.int16 if short else np.float32)
    step = np.ones((num_blocks, num_modes), np.float32)
    for first in range(0, num_blocks, 256):  # in parts, so that no second copy of everything is held
        part = rows[first * LANES : (first + 256) * LANES]
        padded = np.zeros((-(-len(part) // LANES) * LANES, num_modes, 3), np.float32)
        padded[: len(part)] = np.where((part >= 0)[:, None, None], modes[np.maximum(part, 0)], 0)
        count = len(padded) // LANES  # said outright: a state without modes leaves nothing to infer it from
        blocks = padded.reshape(count, LANES, num_modes, 3).transpose(0, 2, 3, 1).reshape(count, num_modes, 3 * LANES)
        if short:
            peak = np.maximum(np.abs(blocks).max(axis=2), np.float32(1e-30))
            step[first : first + 256] = peak / np.float32(32767)
            blocks = np.rint(blocks / step[first : first + 256, :, None])
        out[first : first + 256] = blocks
    return out, step

"""The residual's modes, packed for vector registers, and how a view reads them."""

from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float32, Float64, Int32

from relight3d.records import RelightModel, Residual
from relight3d.relight.pack_kernels import fade_shares
from relight3d.relight.residual_kernels import LANES
from relight3d.relight.tiles import tiles
from relight3d.shading import residual_kernel
from relight3d.tracing import over_threads
from relight3d.views import View

UNSEEN = 1e-6  # of white: what a mode may be off by
FAINT = 3e-3  # of white: what a mode makes of a block in int8 is left out below it

# A residual's blocks serve every viewpoint; they go when the residual does.
_blocks: "WeakKeyDictionary[Residual, dict[tuple[bool, str], tuple]]" = WeakKeyDictionary()


class Rows(NamedTuple):
    """One state's modes: rows of values, a few for each block of pixels; value = entry * step.

    Whole numbers are cut into bytes, each a row of its own with 256 times the step of the one before: most blocks of
    most modes fill one byte, and what is all 0 has no row.
    """

    entries: np.ndarray  # row x (3 LANES), float32 or int8
    step: Float32[np.ndarray, " row"]
    mode: Int32[np.ndarray, " row"]  # whose weight the row has
    start: Int32[np.ndarray, " block_and_end"]  # the rows of block b: start[b] to start[b + 1]


NO_ROWS = Rows(np.zeros((0, 3 * LANES), np.int8), np.zeros(0, np.float32), np.zeros(0, np.int32), np.zeros(1, np.int32))


@dataclass(frozen=True, eq=False)
class Modes:
    """The residual's modes. At the captured view blocks are of ranks, and `source` is empty; elsewhere they are of
    captured points, which each point of the view reads by `source` and `share`.
    """

    lit: Rows
    dark: Rows
    source: Int32[np.ndarray, "point 4"]
    share: Float32[np.ndarray, "point 4"]

    @property
    def num_bytes(self) -> int:
        return sum(part.nbytes for part in (*self.lit, *self.dark, self.source, self.share))


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
    if view.camera.same_as(model.camera):
        row_of_pixel = np.full(view.camera.num_pixels, -1, np.int32)
        row_of_pixel[model.pixels.points.pixel] = np.arange(len(model.pixels.points), dtype=np.int32)
        rows = row_of_pixel[pixel_of_rank]
        source, share = np.zeros((0, 4), np.int32), np.zeros((0, 4), np.float32)
        return Modes(*_kept_blocks(model, residual, rows, True, precision), source, share)
    counts = np.diff(start)
    part = np.repeat((1 / counts).astype(np.float32), counts)
    return modes_elsewhere(model, residual, *read_shares(model, view, order, part, to_viewer), precision)


def modes_elsewhere(
    model: RelightModel, residual: Residual, source: np.ndarray, share: np.ndarray, precision: str
) -> Modes:
    """The modes of the captured points, which a view reads by `source` and `share`."""
    rows = np.arange(len(model.pixels.points), dtype=np.int32)
    return Modes(*_kept_blocks(model, residual, rows, False, precision), source, share)


def _kept_blocks(
    model: RelightModel, residual: Residual, rows: np.ndarray, captured: bool, precision: str
) -> tuple[Rows, Rows]:
    """The lit and the dark modes in blocks, made once: the captured view has one order, all others share another."""
    kept = _blocks.setdefault(residual, {})
    key = (captured, precision)
    if key not in kept:
        lit_loudness, dark_loudness = loudness_of(model, residual)
        unseen = unseen_part(model)
        kept[key] = (
            in_blocks(residual.lit_modes, rows, precision, lit_loudness / unseen),
            in_blocks(residual.dark_modes, rows, precision, dark_loudness / unseen),
        )
    return kept[key]


def unseen_part(model: RelightModel) -> float:
    """What a mode may be off by, in radiance."""
    return UNSEEN / model.exposure


def loudness_of(model: RelightModel, residual: Residual) -> tuple[np.ndarray, np.ndarray]:
    """The most that a light of the capture makes of each mode, lit and dark; the weights' own size without lights."""
    softening = model.indirect.softening if model.indirect is not None else 0.5 * model.mesh.radius
    lights = [light for photograph in model.lights for light in photograph if np.any(light.power > 0)]
    if not lights:
        return np.abs(residual.lit_weights).sum(axis=1), np.abs(residual.dark_weights).sum(axis=1)
    each = [(residual_kernel(residual, light, softening), float(np.max(light.power))) for light in lights]
    lit, dark = (np.max([np.abs(pair[k]) * power for pair, power in each], axis=0) for k in (0, 1))
    return lit, dark


def read_shares(
    model: RelightModel, view: View, order: np.ndarray, part: np.ndarray, to_viewer: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """forward.residual_source for a view that is not the captured one; each point has a part of its pixel's."""
    source, share = np.empty((len(order), 4), np.int32), np.empty((len(order), 4), np.float32)
    given = (order, view.source, view.share, model.pixels.points.to_viewer, to_viewer, view.is_mirrored, part)

    def fade(piece: slice) -> None:
        fade_shares(piece.start, piece.stop, *given, source, share)

    over_threads(fade, tiles(len(order)))
    return source, share


def in_blocks(modes: np.ndarray, rows: np.ndarray, precision: str, loudness: Float64[np.ndarray, " mode"]) -> Rows:
    """modes[rows] by blocks; rows below 0 and the padding are zero. Modes in whole steps stay as they are but in int8; of
    others what is below 1 / loudness cannot be seen.
    """
    num_blocks, num_modes, is_whole = -(-len(rows) // LANES), modes.shape[1], modes.dtype.kind == "i"
    parts: list[tuple[np.ndarray, ...]] = []
    for first in range(0, num_blocks, 256):  # in parts, so that no second copy of everything is held
        part = rows[first * LANES : (first + 256) * LANES]
        count = -(-len(part) // LANES)
        padded = np.zeros((count * LANES, num_modes, 3), np.float32)
        padded[: len(part)] = np.where((part >= 0)[:, None, None], modes[np.maximum(part, 0)], 0)
        blocks = padded.reshape(count, LANES, num_modes, 3).transpose(0, 2, 3, 1).reshape(count, num_modes, 3 * LANES)
        if precision == "int16":
            parts.append(_in_bytes(blocks, np.ones(num_modes) if is_whole else 2.0 / np.maximum(loudness, 1e-30)))
        elif precision == "int8":
            parts.append(_rounded(blocks, loudness))
        else:
            steps, kept = np.ones((count, num_modes), np.float32), np.ones((count, num_modes), bool)
            parts.append((blocks[kept], steps[kept], np.nonzero(kept)[1], kept.sum(axis=1)))
    if not parts:
        return NO_ROWS
    entries, step, mode, counts = (np.concatenate(each) for each in zip(*parts))
    return Rows(entries, step, mode.astype(np.int32), np.append(0, np.cumsum(counts)).astype(np.int32))


def _in_bytes(blocks: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rows of the bytes of `blocks` in whole steps of each mode, their steps and modes, and how many each block has."""
    step, rest = step.astype(np.float32), np.rint(blocks / step[:, None].astype(np.float32)).astype(np.int32)
    entries, steps = [np.zeros((len(blocks), 0, blocks.shape[2]), np.int8)], [np.zeros((len(blocks), 0), np.float32)]
    while rest.any():
        low = ((rest + 128) & 255) - 128
        entries.append(low.astype(np.int8))
        steps.append(np.broadcast_to(step, rest.shape[:2]))
        step, rest = step * np.float32(256), (rest - low) >> 8
    both, steps = np.concatenate(entries, axis=1), np.concatenate(steps, axis=1)
    kept = both.any(axis=2)
    return both[kept], steps[kept], np.nonzero(kept)[1] % max(blocks.shape[1], 1), kept.sum(axis=1)


def _rounded(blocks: np.ndarray, loudness: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The same in int8, in steps of 1/127 of a mode's peak in the block; faint modes have no row."""
    peak = np.abs(blocks).max(axis=2)
    step = np.maximum(peak, np.float32(1e-30)) / np.float32(127)
    entries = np.rint(blocks / step[..., None]).astype(np.int8)
    kept = peak * loudness * UNSEEN > FAINT
    return entries[kept], step[kept], np.nonzero(kept)[1], kept.sum(axis=1)

"""What frames at half resolution read of a view and no light changes: planes of slots and of items, packed once."""

import math
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float32, Int32, Num

from relight3d.records import RelightModel, Residual
from relight3d.relight.buffers import Buffers, Sites
from relight3d.relight.half_lattice import HalfLattice
from relight3d.relight.lazy_view import LazyView
from relight3d.relight.modes import LANES, NO_ROWS, Rows, in_blocks, loudness_of, read_shares, unseen_part
from relight3d.relight.pack_kernels import blend_modes
from relight3d.relight.tiles import tiles
from relight3d.tracing import over_threads
from relight3d.views import View

FAINT = 1e-2  # of white: a mode that adds less to a block in int8 is left out there
PART = 256 * LANES  # slots whose modes are in memory at once


@dataclass(frozen=True, eq=False)
class Slots:
    """Where light is evaluated: planes of lanes, which are the slots that somebody reads, neighbours of one surface together.

    Lanes that always cast rays come first, then those that cast where cells disagree; both end in a whole block of LANES.
    """

    slot: Int32[np.ndarray, " lane"]
    num_first: int  # lanes that always cast
    position: Float32[np.ndarray, "3 lane"]
    geometric: Float32[np.ndarray, "3 lane"]
    normal: Float32[np.ndarray, "3 lane"]
    viewer: Float32[np.ndarray, "3 lane"]  # the direction to the viewer
    gloss: Float32[np.ndarray, "3 lane"]  # lobe gain * what mirrors on the way leave
    surface: Int32[np.ndarray, " lane"]
    source: Int32[np.ndarray, "lane share"]  # the sites of indirect light that a lane reads; of length 0 without
    share: Float32[np.ndarray, "lane share"]
    step: Float32[np.ndarray, "slot 2 3"]  # how a point slides to the next slot, to the right and below
    lane_of_slot: Int32[np.ndarray, " slot"]  # 0 for a slot that nobody reads
    lit: Rows  # the residual's modes, by blocks of lanes
    dark: Rows


@dataclass(frozen=True, eq=False)
class Items:
    """What is shown, in the order of HalfLattice: zero where a row has no item. In float32, or int16 times `steps`."""

    normal: Num[np.ndarray, "3 item"]
    diffuse: Num[np.ndarray, "3 item"]  # albedo / pi * throughput
    steps: Float32[np.ndarray, "4"]  # of the normal, three of diffuse


def num_bytes(*parts: Slots | Items) -> int:
    """Memory that they take."""
    values = [getattr(part, field.name) for part in parts for field in fields(part)]
    arrays = [a for value in values for a in (value if isinstance(value, Rows) else [value]) if isinstance(a, np.ndarray)]
    return sum(array.nbytes for array in arrays)


def aligned(shape: tuple[int, ...], dtype: type = np.float32) -> np.ndarray:
    """An empty array that begins on a cache line, as must its rows (a multiple of 16) for vector registers to be fast."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    room = np.empty(size + 64, np.uint8)
    first = -room.ctypes.data % 64
    return room[first : first + size].view(dtype).reshape(shape)


def _on_line(values: np.ndarray) -> np.ndarray:
    """The same values where a cache line begins."""
    out = aligned(values.shape, values.dtype.type)
    out[...] = values
    return out


# --------------------------------------------------------------------------------------------- slots


def pack_slots(
    lattice: HalfLattice, model: RelightModel, view: View, buffers: Buffers, precision: str, sites: Sites | None
) -> Slots:
    """The points whose light slots have."""
    first, later = _whole_blocks(lattice.lane), _whole_blocks(lattice.later)
    slot = np.concatenate([first, later])
    at, of_slot = lattice.point[slot], np.zeros(len(lattice.point), np.int32)
    of_slot[slot[::-1]] = np.arange(len(slot), dtype=np.int32)[::-1]
    step = np.zeros((len(lattice.point), 2, 3), np.float32)
    if len(slot):
        step[slot] = 2 * buffers.steps(at)
    part = np.repeat(np.diff(buffers.point_start), np.diff(buffers.point_start)).astype(np.float32)
    residual, lit, dark = model.residual, NO_ROWS, NO_ROWS
    if residual is not None:
        source, share = _sources(model, view, buffers)
        read = (np.ascontiguousarray(source[at]), np.ascontiguousarray(share[at] * part[at, None]))
        lit, dark = _modes(model, residual, *read, precision)
    position, geometric, normal, viewer, gloss = (
        _on_line(plane[:, at])
        for plane in (buffers.position, buffers.geometric_normal, buffers.normal, buffers.to_viewer, buffers.gloss * part)
    )
    source, share = np.zeros((0, 4), np.int32), np.zeros((0, 4), np.float32)
    if sites is not None:
        source, share = np.ascontiguousarray(sites.source[at]), np.ascontiguousarray(sites.share[at])
    return Slots(
        slot, len(first), position, geometric, normal, viewer, gloss, buffers.surface[at], source, share, step, of_slot, lit,
        dark,
    )  # fmt: skip


def _whole_blocks(lane: Int32[np.ndarray, " lane"]) -> Int32[np.ndarray, " more"]:
    """The last lane again, up to a whole block."""
    return np.append(lane, np.repeat(lane[-1:], -len(lane) % LANES)).astype(np.int32)


def _modes(
    model: RelightModel, residual: Residual, source: np.ndarray, share: np.ndarray, precision: str
) -> tuple[Rows, Rows]:
    """The residual's modes at lanes, which read captured points."""
    out = []
    for modes, loudness in zip((residual.lit_modes, residual.dark_modes), loudness_of(model, residual)):
        parts = []
        for first in range(0, len(source), PART):
            last = min(first + PART, len(source))
            at_lanes = np.empty((last - first, modes.shape[1], 3), np.float32)

            def blend(part: slice, first=first, at_lanes=at_lanes, modes=modes) -> None:
                blend_modes(part.start, part.stop, first, source, share, modes, at_lanes)

            over_threads(blend, tiles(last - first))
            rows = np.arange(last - first, dtype=np.int32)
            parts.append(in_blocks(at_lanes, rows, precision, loudness / unseen_part(model), FAINT))
        out.append(_joined(parts))
    return out[0], out[1]


def _joined(parts: list[Rows]) -> Rows:
    if not parts:
        return NO_ROWS
    entries, step, mode = (np.concatenate([part[k] for part in parts]) for k in range(3))
    counts = np.concatenate([np.diff(part.start) for part in parts])
    return Rows(_on_line(entries), step, mode, np.append(0, np.cumsum(counts)).astype(np.int32))


def _sources(model: RelightModel, view: View, buffers: Buffers) -> tuple[np.ndarray, np.ndarray]:
    """The captured points whose residual each point shows, and how far; a point has a part of its pixel's."""
    counts = np.diff(buffers.point_start)
    part = np.repeat((1 / counts).astype(np.float32), counts)
    if view.camera.same_as(model.camera):
        row_of_pixel = np.zeros(view.camera.num_pixels, np.int32)
        row_of_pixel[model.pixels.points.pixel] = np.arange(len(model.pixels.points), dtype=np.int32)
        return np.repeat(row_of_pixel[buffers.pixel_of_rank], counts)[:, None], part[:, None]
    if isinstance(view, LazyView) and view.serves(model):
        return view.packed.source, view.packed.source_share
    return read_shares(model, view, buffers.order, part, buffers.to_viewer)


# --------------------------------------------------------------------------------------------- items


def pack_items(lattice: HalfLattice, buffers: Buffers, precision: str) -> Items:
    """Planes of items: what the points of one item reflect added up, their normals' mean."""

    def summed(planes: Float32[np.ndarray, "3 point"]) -> Float32[np.ndarray, "3 item"]:
        return np.stack([np.bincount(lattice.item, plane, lattice.num_items) for plane in planes]).astype(np.float32)

    normal, diffuse, steps = summed(buffers.normal), summed(buffers.diffuse), np.ones(4, np.float32)
    normal /= np.maximum(np.linalg.norm(normal, axis=0), 1e-9)
    if precision != "float32":
        steps[0] = 1.0
        steps[1:] = np.maximum(np.abs(diffuse).max(axis=1, initial=0.0), 1e-30)
        steps /= np.float32(32767)
        normal, diffuse = (np.rint(p / s).astype(np.int16) for p, s in ((normal, steps[0]), (diffuse, steps[1:, None])))
    return Items(_on_line(normal), _on_line(diffuse), steps)

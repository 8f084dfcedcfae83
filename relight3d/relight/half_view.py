"""What frames at half resolution read of a view and no light changes: planes of slots and of items, packed once."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int16, Int32, Num

from relight3d.records import RelightModel, Residual
from relight3d.relight.buffers import Buffers, tangents_of
from relight3d.relight.half_lattice import HalfLattice
from relight3d.relight.lazy_view import LazyView
from relight3d.relight.modes import LANES, NO_ROWS, Rows, in_blocks, loudness_of, read_shares, unseen_part
from relight3d.relight.pack_kernels import blend_modes
from relight3d.relight.tiles import tiles
from relight3d.tracing import over_threads
from relight3d.views import View

WIDTH = 16  # rays of a packet
PART = 256 * LANES  # items whose modes are in memory at once
NO_PLANES = np.zeros((0, 0), np.float32)


@dataclass(frozen=True, eq=False)
class Slots:
    """Where light is evaluated: of slots, and of lanes, which end in whole packets."""

    position: Float32[np.ndarray, "3 slot"]
    geometric: Float32[np.ndarray, "3 slot"]
    viewer: Float32[np.ndarray, "3 slot"]  # the direction to the viewer
    step: Float32[np.ndarray, "slot 2 3"]  # how a point slides to the next slot, to the right and below
    lane: Int32[np.ndarray, " lane"]  # those that always cast, then those that cast where cells disagree
    num_first: int  # lanes that always cast
    lane_position: Float32[np.ndarray, "3 lane"]
    lane_geometric: Float32[np.ndarray, "3 lane"]


@dataclass(frozen=True, eq=False)
class Items:
    """What is shown, in the order of HalfLattice: zero where a row has no item.

    Planes of numbers are float32, or int16 of which `steps` says how much one is.
    """

    normal: Num[np.ndarray, "3 item"]
    diffuse: Num[np.ndarray, "3 item"]  # albedo / pi * throughput
    gloss: Num[np.ndarray, "axis shiny"]  # lobe gain * throughput; of length 0 without lobes, as are the next two
    facing: Num[np.ndarray, " shiny"]  # the cosine between the normal and the direction to the viewer
    tangent: Num[np.ndarray, "plane brushed"]  # of each lobe that is not round: the tangent, and it along the viewer
    steps: Float32[np.ndarray, "9"]  # of the normal, three of diffuse, three of gloss, of facing, of the tangent
    surface: Int16[np.ndarray, " item"]
    shining: Int32[np.ndarray, "block some"]  # the surfaces with lobes in each block of LANES items, then -1
    lit: Rows  # the residual's modes, by blocks of items
    dark: Rows


def aligned(shape: tuple[int, ...], dtype: type = np.float32) -> np.ndarray:
    """An empty array that begins on a cache line, as must its rows (a multiple of LANES) for vector registers to be fast."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    room = np.empty(size + 64, np.uint8)
    first = -room.ctypes.data % 64
    return room[first : first + size].view(dtype).reshape(shape)


def _on_line(values: np.ndarray) -> np.ndarray:
    """The same values where a cache line begins."""
    out = aligned(values.shape, values.dtype.type)
    out[...] = values
    return out


def pack_slots(lattice: HalfLattice, buffers: Buffers) -> Slots:
    """Planes of slots; those that nobody reads stand where the first point is."""
    at, first = np.maximum(lattice.point, 0), _whole_packets(lattice.lane)
    lane = np.concatenate([first, _whole_packets(lattice.later)])
    position, geometric, viewer = (
        np.ascontiguousarray(plane[:, at]) for plane in (buffers.position, buffers.geometric_normal, buffers.to_viewer)
    )
    step = np.zeros((len(at), 2, 3), np.float32)
    if len(buffers):
        step[: lattice.num_grid] = 2 * buffers.steps(at[: lattice.num_grid].astype(np.int32))
    planes = (np.ascontiguousarray(plane[:, lane]) for plane in (position, geometric))
    return Slots(position, geometric, viewer, step, lane, len(first), *planes)


def _whole_packets(lane: Int32[np.ndarray, " lane"]) -> Int32[np.ndarray, " more"]:
    """The last lane again, up to sixteen."""
    return np.append(lane, np.repeat(lane[-1:], -len(lane) % WIDTH)).astype(np.int32)


def pack_items(
    lattice: HalfLattice, model: RelightModel, residual: Residual | None, view: View, buffers: Buffers, precision: str
) -> Items:
    """Planes of items: what the points of one item show added up, their normals' mean."""
    item, num = lattice.item, lattice.num_items

    def summed(planes: Float32[np.ndarray, "3 point"]) -> Float32[np.ndarray, "3 item"]:
        return np.stack([np.bincount(item, plane, num) for plane in planes]).astype(np.float32)

    normal, surface = summed(buffers.normal), np.full(num, -1, np.int16)
    normal /= np.maximum(np.linalg.norm(normal, axis=0), 1e-9)
    surface[item] = buffers.surface
    gloss, facing, tangent, shining = NO_PLANES, np.zeros(0, np.float32), NO_PLANES, np.zeros((0, 0), np.int32)
    if len(buffers.lobes):
        viewer = summed(buffers.to_viewer)
        viewer /= np.maximum(np.linalg.norm(viewer, axis=0), 1e-9)
        gloss, facing = summed(buffers.gloss), np.einsum("cp,cp->p", normal, viewer)
        shining = _shining(surface.reshape(-1, LANES), np.diff(buffers.lobe_start) > 0)
        place = summed(buffers.position) / np.maximum(np.bincount(item, minlength=num), 1).astype(np.float32)
        tangent = _tangents(buffers, surface, place, normal, viewer)
    lit = dark = NO_ROWS
    if residual is not None:
        lit, dark = _modes(lattice, model, residual, view, buffers, precision)
    planes, steps = _in_steps([normal, summed(buffers.diffuse), gloss, facing, tangent], precision)
    planes, surface = [_on_line(plane) for plane in planes], _on_line(surface)
    lit, dark = (rows._replace(entries=_on_line(rows.entries)) for rows in (lit, dark))
    return Items(planes[0], planes[1], planes[2], planes[3], planes[4], steps, surface, shining, lit, dark)


def _tangents(
    buffers: Buffers,
    surface: Int16[np.ndarray, " item"],
    place: Float32[np.ndarray, "3 item"],
    normal: Float32[np.ndarray, "3 item"],
    viewer: Float32[np.ndarray, "3 item"],
) -> Float32[np.ndarray, "plane brushed"]:
    """Items.tangent."""
    given = (buffers.lobes, buffers.lobe_start, np.maximum(surface, 0).astype(np.int32))
    tangents = tangents_of(*given, place, normal).reshape(-1, 3, len(surface))
    along = np.einsum("kcp,cp->kp", tangents, viewer)
    return np.concatenate([tangents, along[:, None]], axis=1).reshape(4 * len(tangents), -1 if len(tangents) else 0)


def _in_steps(planes: list[np.ndarray], precision: str) -> tuple[list[np.ndarray], Float32[np.ndarray, "9"]]:
    """Normals, diffuse, gloss, facing and tangents in int16, and the steps of each; as they are in float32."""
    steps = np.ones(9, np.float32)
    if precision == "float32":
        return planes, steps
    out = []
    for part, plane in zip((slice(0, 1), slice(1, 4), slice(4, 7), slice(7, 8), slice(8, 9)), planes):
        axis = 1 if part in (slice(1, 4), slice(4, 7)) and plane.size else None
        most = np.maximum(np.abs(plane).max(axis=axis, initial=0.0), 1e-30)
        steps[part] = most / np.float32(32767)
        each = steps[part][:, None] if axis else steps[part.start]
        out.append(np.rint(plane / each).astype(np.int16))
    return out, steps


def _shining(surface: Int16[np.ndarray, "block lane"], has_lobes: np.ndarray) -> Int32[np.ndarray, "block some"]:
    """The surfaces with lobes in each block, then -1."""
    present = np.stack([(surface == s).any(axis=1) for s in np.flatnonzero(has_lobes)], axis=1)
    ids = np.where(present, np.flatnonzero(has_lobes), -1)
    return np.ascontiguousarray(-np.sort(-ids, axis=1), np.int32)


def _modes(
    lattice: HalfLattice, model: RelightModel, residual: Residual, view: View, buffers: Buffers, precision: str
) -> tuple[Rows, Rows]:
    """The residual's modes at items, each point's by its part of its pixel."""
    source, share = _sources(model, view, buffers)
    member = np.argsort(lattice.item, kind="stable").astype(np.int32)
    start = np.searchsorted(lattice.item[member], np.arange(lattice.num_items + 1)).astype(np.int32)
    out = []
    for modes, loudness in zip((residual.lit_modes, residual.dark_modes), loudness_of(model, residual)):
        parts = []
        for first in range(0, lattice.num_items, PART):
            last = min(first + PART, lattice.num_items)
            at_items = np.empty((last - first, modes.shape[1], 3), np.float32)

            def blend(
                part: slice, first: int = first, at_items: np.ndarray = at_items, modes: np.ndarray = modes
            ) -> None:
                blend_modes(part.start, part.stop, first, start, member, source, share, modes, at_items)

            over_threads(blend, tiles(last - first))
            rows = np.arange(last - first, dtype=np.int32)
            parts.append(in_blocks(at_items, rows, precision, loudness / unseen_part(model)))
        out.append(_joined(parts))
    return out[0], out[1]


def _joined(parts: list[Rows]) -> Rows:
    if not parts:
        return NO_ROWS
    entries, step, mode = (np.concatenate([part[k] for part in parts]) for k in range(3))
    counts = np.concatenate([np.diff(part.start) for part in parts])
    return Rows(entries, step, mode, np.append(0, np.cumsum(counts)).astype(np.int32))


def _sources(model: RelightModel, view: View, buffers: Buffers) -> tuple[np.ndarray, np.ndarray]:
    """The captured points whose residual each point shows, and how far."""
    counts = np.diff(buffers.point_start)
    part = np.repeat((1 / counts).astype(np.float32), counts)
    if view.camera.same_as(model.camera):
        row_of_pixel = np.zeros(view.camera.num_pixels, np.int32)
        row_of_pixel[model.pixels.points.pixel] = np.arange(len(model.pixels.points), dtype=np.int32)
        source = np.repeat(row_of_pixel[buffers.pixel_of_rank], counts)[:, None]
        return np.ascontiguousarray(source), np.ascontiguousarray(part[:, None])
    if isinstance(view, LazyView) and view.serves(model):
        return view.packed.source, view.packed.source_share
    return read_shares(model, view, buffers.order, part, buffers.to_viewer)

"""What a frame reads and no light changes: one view's points, packed once, in the order in which kernels walk them.

Points stand in blocks of 4 x 4 pixels, so that sixteen neighbours share a packet of rays; the points of one pixel stand
together, so that a pixel is added up where it is shaded. `rank` numbers the pixels in that order. The residual's modes
are stored sixteen pixels side by side: a vector register holds one mode of a whole block.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise

import numpy as np
from jaxtyping import Float32, Float64, Int32

from relight3d.maths.light_basis import BASES, evaluate_basis
from relight3d.records import Indirect, RelightModel
from relight3d.relight.lazy_view import LazyView
from relight3d.relight.lobe_kernels import BRUSHED, LONG, ROUND, ROUND_HALFWAY, write_tangents
from relight3d.relight.modes import Modes, modes_elsewhere, pack_modes
from relight3d.relight.pack_kernels import number_used, pack_reflectance, read_faces, take_sites
from relight3d.relight.tiles import rank_of_pixel, tiles
from relight3d.tracing import over_threads
from relight3d.views import View

Job = Callable[[], object]


@dataclass(frozen=True, eq=False)
class Sites:
    """Where indirect light is kept, and how each point reads it; only the sites that some point reads.

    `to_basis` writes the functions of the basis in monomials of degree 0 to 3; None for a basis that is no polynomial,
    whose functions then come from NumPy.
    """

    source: Int32[np.ndarray, "point share"]
    share: Float32[np.ndarray, "point share"]
    positions: Float32[np.ndarray, "site 3"]
    coefficients: Float32[np.ndarray, "site basis 3"]
    ambient: Float32[np.ndarray, "site 3"]
    all_positions: Float32[np.ndarray, "any 3"]  # a spot's part of the scene is a mean over all sites
    to_basis: Float64[np.ndarray, "basis monomial"] | None


@dataclass(frozen=True, eq=False)
class Buffers:
    """Structure of arrays over the points of a view, and over its pixels by rank."""

    position: Float32[np.ndarray, "3 point"]
    geometric_normal: Float32[np.ndarray, "3 point"]
    normal: Float32[np.ndarray, "3 point"]
    to_viewer: Float32[np.ndarray, "3 point"]
    tangent: Float32[np.ndarray, "plane point"]  # three for each lobe of a surface that is not round
    diffuse: Float32[np.ndarray, "3 point"]  # albedo / pi * throughput
    gloss: Float32[np.ndarray, "3 point"]  # lobe gain * throughput
    surface: Int32[np.ndarray, " point"]
    lobe_start: Int32[np.ndarray, " surface_and_end"]  # the lobes of surface s: lobe_start[s] to lobe_start[s + 1]
    lobes: Float32[np.ndarray, "lobe 15"]
    steps: Callable[[Int32[np.ndarray, " some"]], Float32[np.ndarray, "some 2 3"]]  # View.step of some points
    neighbour: Int32[np.ndarray, "point 4"]
    point_start: Int32[np.ndarray, " rank_and_end"]  # the points of rank r: point_start[r] to point_start[r + 1]
    pixel_of_rank: Int32[np.ndarray, " rank"]
    sites: Sites | None
    modes: Modes | None
    order: Int32[np.ndarray, " point"]  # which point of the view each one is

    def __len__(self) -> int:
        return len(self.order)

    @property
    def num_bytes(self) -> int:
        """Memory that the buffers take."""
        parts = [v for v in vars(self).values() if isinstance(v, np.ndarray)]
        parts += [v for v in vars(self.sites).values() if isinstance(v, np.ndarray)] if self.sites else []
        return sum(part.nbytes for part in parts) + (self.modes.num_bytes if self.modes else 0)


def pack_view(model: RelightModel, view: View, precision: str = "float32") -> Buffers:
    """The view's points in blocks, with everything that a frame reads of them."""
    if isinstance(view, LazyView) and view.serves(model):
        return _packed_already(model, view, precision)
    order, pixel_of_rank, start = _block_order(view)
    num, points = len(order), view.points
    lobes, lobe_start = _lobe_table(model)
    albedo, throughput = np.ascontiguousarray(view.albedo.T), np.ascontiguousarray(view.throughput.T)
    diffuse, gloss = np.empty((3, num), np.float32), np.empty((3, num), np.float32)

    def pack(part: slice) -> None:
        pack_reflectance(part.start, part.stop, order, albedo, throughput, view.lobe_gain, diffuse, gloss)

    over_threads(pack, tiles(num))
    in_order = bool((order == np.arange(num)).all())  # as a view from compiled loops is

    def sorted_rows(values: np.ndarray) -> np.ndarray:
        return values if in_order else values[order]

    to_viewer, residual, neighbour = _planes(sorted_rows(points.to_viewer)), model.residual, view.neighbour
    if not in_order:
        place = np.empty(num + 1, np.int32)
        place[order], place[-1] = np.arange(num, dtype=np.int32), -1
        neighbour = place[neighbour[order]]
    modes = None
    if residual is not None:
        modes = pack_modes(model, residual, view, order, pixel_of_rank, start, to_viewer, precision)
    position, normal = (_planes(sorted_rows(vectors)) for vectors in (points.position, view.normal))
    surface = sorted_rows(view.surface)
    return Buffers(
        position=position,
        geometric_normal=_planes(sorted_rows(points.geometric_normal)),
        normal=normal,
        to_viewer=to_viewer,
        tangent=tangents_of(lobes, lobe_start, surface, position, normal),
        diffuse=diffuse,
        gloss=gloss,
        surface=surface,
        lobe_start=lobe_start,
        lobes=lobes,
        steps=lambda index: view.step[order[index]],
        neighbour=neighbour,
        point_start=start,
        pixel_of_rank=pixel_of_rank,
        sites=None if model.indirect is None else _sites(model, model.indirect, view, order, in_order),
        modes=modes,
        order=order,
    )


def _packed_already(model: RelightModel, view: LazyView, precision: str) -> Buffers:
    """The buffers of a view from compiled loops, which wrote them as they looked."""
    packed, listed, indirect = view.packed, view.looked.listed, model.indirect
    lobes, lobe_start = _lobe_table(model)
    tangent, jobs = _tangent_jobs(lobes, lobe_start, packed.surface, packed.position, packed.normal)
    sites = None
    if indirect is not None:
        reading = (packed.vertex, packed.corner, packed.corner_share)
        sites, more = _site_jobs(indirect, *reading, model.mesh.centered_vertices)
        jobs += more
    _run(jobs)
    return Buffers(
        position=packed.position,
        geometric_normal=packed.geometric,
        normal=packed.normal,
        to_viewer=packed.to_viewer,
        tangent=tangent,
        diffuse=packed.diffuse,
        gloss=packed.gloss,
        surface=packed.surface,
        lobe_start=lobe_start,
        lobes=lobes,
        steps=view.steps,
        neighbour=packed.neighbour,
        point_start=listed.start,
        pixel_of_rank=listed.pixel_of_rank,
        sites=sites,
        modes=None
        if model.residual is None
        else modes_elsewhere(model, model.residual, packed.source, packed.source_share, precision),
        order=np.arange(len(packed.surface), dtype=np.int32),
    )


def _planes(vectors: Float32[np.ndarray, "point 3"]) -> Float32[np.ndarray, "3 point"]:
    """Without a copy for what is stored so already."""
    return np.ascontiguousarray(vectors.T)


def _block_order(view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points by block of 4 x 4 pixels and pixel; the pixels that have points, in that order; where each one's begin."""
    key = rank_of_pixel(view.camera.width, view.camera.height)[view.points.pixel]
    order = np.argsort(key, kind="stable").astype(np.int32)
    pixel = view.points.pixel[order]
    first = np.flatnonzero(np.diff(pixel, prepend=-1) != 0)
    return order, pixel[first], np.append(first, len(pixel)).astype(np.int32)


def _lobe_table(model: RelightModel) -> tuple[np.ndarray, np.ndarray]:
    """Rows of colour, axes, exponent, tangent, form (lobe_kernels.ROUND and on), the base below which a lobe is dark, and
    turn; each surface's first.
    """
    rows, ends = [], [0]
    for lobes in model.lobes:
        for lobe in lobes:
            is_round = lobe.axes[0] == lobe.axes[1]
            form = (ROUND_HALFWAY if is_round else BRUSHED) if lobe.is_halfway else (ROUND if is_round else LONG)
            # exp(-20) = 2e-9 of the peak: below it a power is not worth its logarithm. Never 0, which has none.
            dark = max(np.exp(-20.0 / max(lobe.exponent, 1e-6)), 1e-30)
            rows.append([*lobe.color, *lobe.axes, lobe.exponent, *lobe.tangent, form, dark, *lobe.turn])
        ends.append(len(rows))
    table = np.array(rows, np.float32).reshape(-1, 15)
    return table, np.array(ends, np.int32)


def tangents_of(
    lobes: Float32[np.ndarray, "lobe 15"],
    lobe_start: Int32[np.ndarray, " surface_and_end"],
    surface: Int32[np.ndarray, " point"],
    position: Float32[np.ndarray, "3 point"],
    normal: Float32[np.ndarray, "3 point"],
) -> Float32[np.ndarray, "plane point"]:
    """Of each surface's lobes that are not round, one after the other: the tangents at its points. No planes without any."""
    out, jobs = _tangent_jobs(lobes, lobe_start, surface, position, normal)
    _run(jobs)
    return out


def _tangent_jobs(
    lobes: np.ndarray, lobe_start: np.ndarray, surface: np.ndarray, position: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, list[Job]]:
    has_tangent = (lobes[:, 10] == LONG) | (lobes[:, 10] == BRUSHED)
    most = max((int(has_tangent[a:b].sum()) for a, b in pairwise(lobe_start)), default=0)
    out = np.zeros((3 * most, len(surface)), np.float32)
    given = (surface, lobe_start, lobes, position, normal, out)
    parts = tiles(len(surface)) if most else []
    return out, [partial(write_tangents, part.start, part.stop, *given) for part in parts]


def _run(jobs: list[Job]) -> None:
    """All of them over threads, which wait for each other once."""
    over_threads(lambda job: job(), jobs)


# --------------------------------------------------------------------------------------- indirect light


def _sites(model: RelightModel, indirect: Indirect, view: View, order: np.ndarray, in_order: bool) -> Sites:
    mesh, points = model.mesh, view.points
    if indirect.site == "vertex":
        source, share = (
            np.empty((len(order), 3), np.int32),
            points.barycentric if in_order else points.barycentric[order],
        )
        over_threads(
            lambda part: read_faces(part.start, part.stop, order, points.face, mesh.faces, source), tiles(len(order))
        )
        positions = mesh.centered_vertices
    elif indirect.site == "face":
        source, share = points.face[order, None], np.ones((len(order), 1), np.float32)
        positions = mesh.centered_vertices[mesh.faces].mean(axis=1)
    else:
        source, share = np.maximum(view.source[order], 0), view.share[order]
        positions = model.pixels.points.position
    # Most of a mesh is out of sight, or smaller than a pixel: what no point reads is left out.
    source, new_row = np.ascontiguousarray(source, np.int32), np.zeros(len(positions), np.int32)
    rows = np.empty(len(positions), np.int32)
    rows = rows[: number_used(source, new_row, rows)]
    sites, jobs = _site_jobs(indirect, rows, source, np.ascontiguousarray(share, np.float32), positions)
    _run(jobs)
    return sites


def _site_jobs(
    indirect: Indirect, rows: np.ndarray, source: np.ndarray, share: np.ndarray, places: np.ndarray
) -> tuple[Sites, list[Job]]:
    """The sites of some rows, and what fills them; `source` counts among those."""
    positions = np.empty((len(rows), 3), np.float32)
    coefficients = np.empty((len(rows), *indirect.coefficients.shape[1:]), np.float32)
    ambient = np.empty((len(rows), 3), np.float32)
    given = (rows, places, indirect.coefficients, indirect.ambient, positions, coefficients, ambient)
    sites = Sites(
        source=source,
        share=share,
        positions=positions,
        coefficients=coefficients,
        ambient=ambient,
        all_positions=places,
        to_basis=_polynomial(indirect.basis),
    )
    return sites, [partial(take_sites, part.start, part.stop, *given) for part in tiles(len(rows))]


def monomials(omega: Float64[np.ndarray, "light 3"]) -> Float64[np.ndarray, "light monomial"]:
    """x^i y^j z^k for i + j + k <= 3, in the order that the kernel makes them."""
    x, y, z = omega.T
    powers = [(i, j, k) for i in range(4) for j in range(4 - i) for k in range(4 - i - j)]
    return np.stack([x**i * y**j * z**k for i, j, k in powers], axis=1)


@cache
def _polynomial(basis: str) -> Float64[np.ndarray, "basis monomial"] | None:
    """The basis in monomials; None where it is no polynomial of degree 3 on the sphere."""
    rng = np.random.default_rng(0)
    omega = rng.normal(size=(400, 3))
    omega /= np.linalg.norm(omega, axis=1, keepdims=True)
    wanted, rows = evaluate_basis(basis, omega), monomials(omega)
    # On the sphere x^2 + y^2 + z^2 = 1 ties the monomials: minimum norm picks one of many equal answers.
    matrix = np.linalg.lstsq(rows, wanted, rcond=1e-10)[0]
    assert wanted.shape[1] == BASES[basis]
    return np.ascontiguousarray(matrix.T) if np.abs(rows @ matrix - wanted).max() < 1e-9 else None

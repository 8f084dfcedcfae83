"""What the mesh's own surfaces send one another, computed: the part of the indirect light that asks no photograph.

The mesh and the albedo are known, so light that goes from lamp to surface to surface can be followed (radiosity, by rays
from patches). Written in the functions of eq. (7), it is what the fit starts from: the photographs then only have to
tell what the unknown surroundings add, which is smoother. Costs nothing at relighting, where only the sums are kept.

Differs from the paper: it fits all of the indirect light (1.2.4), which takes as many photographs as functions.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float32, Float64, Int32

from relight3d.errors import InputError
from relight3d.lights import DirectionalLight, Light, PointLight
from relight3d.maths.least_squares import solve_normal
from relight3d.maths.light_basis import BASES, degree_of, embedding, spread_directions
from relight3d.records import Indirect, Mirror, PatchMesh, ShadingPoints
from relight3d.recover.patches import (
    as_points,
    choose_patches,
    hemispheres,
    main_corner,
    turned_to_viewer,
)
from relight3d.recover.sites import of_vertices
from relight3d.shading import cast_light, indirect_design
from relight3d.tracing import RayScene

DAMPING = 1e-4  # of the mean diagonal, times the degree squared: for lights that leave some function untold


@dataclass(frozen=True)
class BounceOptions:
    """How finely light between surfaces is computed."""

    num_rays: int = 128  # from each patch over its hemisphere; 0 leaves all indirect light to the photographs
    bases: tuple[str, ...] = ("linear", "sh2")  # its functions of the light, where those of the indirect light are not
    # given: those with which left-out photographs are predicted best
    num_lights: int = 48  # directions of lamps that are tried, beside the photographed ones
    max_patches: int = 12_000  # a finer mesh sends and gathers at so many of its vertices
    min_gain_db: float = 0.1  # of left-out photographs, for it to be kept

    def __post_init__(self) -> None:
        if not self.bases or not set(self.bases) <= set(BASES):
            raise InputError("bounce.bases", self.bases, f"one of {', '.join(BASES)}, or several")
        if not 0 <= self.num_rays <= 65536:
            raise InputError("bounce.num_rays", self.num_rays, "0 to 65536")
        if self.num_lights < 0:
            raise InputError("bounce.num_lights", self.num_lights, "0 or more")
        if self.max_patches < 1:
            raise InputError("bounce.max_patches", self.max_patches, "1 or more")


@dataclass(frozen=True, eq=False)
class Transport:
    """Which part of each patch's cosine-weighted hemisphere other patches fill, and how lamps light the patches."""

    surface: Int32[np.ndarray, " patch"]
    seen: sp.csr_matrix  # patch x patch
    mirrored: tuple[sp.csr_matrix, ...]  # the same by way of each mirror
    own: Float32[np.ndarray, "patch light"]  # direct irradiance for power 1
    thrown: Float32[np.ndarray, "mirror patch light"]  # by way of the mirrors that throw light
    lights: tuple[Light, ...]
    hear: sp.csr_matrix  # patch x point: whose albedo it has; a row without entries has its surface's
    to_sites: sp.csr_matrix  # site x patch
    positions: Float32[np.ndarray, "patch 3"]


def trace_transport(
    scene: RayScene,
    mesh: PatchMesh,
    surface_of_face: Int32[np.ndarray, " face"],
    points: ShadingPoints,
    is_heard: np.ndarray,
    site_of_vertex: sp.csr_matrix,
    lights: tuple[Light, ...],
    mirrors: tuple[Mirror, ...],
    options: BounceOptions,
) -> Transport | None:
    """Trace between patches; None where it is not asked for, or no surface sees another (convex things in the void).

    `is_heard` are the points whose albedo counts, `site_of_vertex` (site x vertex) says how sites blend vertices.
    """
    if options.num_rays == 0 or not lights:
        return None
    normals, face_normals = turned_to_viewer(mesh, points)
    chosen, nearest, blend = choose_patches(mesh, normals, options.max_patches)
    patches = as_points(mesh, normals, face_normals, chosen)
    seen, mirrored = hemispheres(
        scene, mesh, face_normals, patches, nearest, mirrors, surface_of_face, options.num_rays
    )
    if seen.nnz == 0 and all(m.nnz == 0 for m in mirrored):
        return None
    throwing = [m for m in mirrors if m.throws_light]
    own = np.empty((len(chosen), len(lights)), np.float32)
    thrown = np.zeros((len(throwing), len(chosen), len(lights)), np.float32)
    for column, light in enumerate(lights):
        lit = cast_light(scene, patches, light, None, mirrors, surface_of_face)
        own[:, column] = lit.form
        if lit.thrown is not None:
            thrown[:, :, column] = lit.thrown
    hear = sp.csr_matrix(
        (points.barycentric.max(axis=1) * is_heard,
         (nearest[main_corner(mesh, points.face, points.barycentric)], np.arange(len(points)))),
        shape=(len(chosen), len(points)),
    )  # fmt: skip
    return Transport(
        of_vertices(mesh, surface_of_face)[chosen], seen, mirrored, own, thrown, lights, hear,
        (site_of_vertex @ blend).tocsr(), patches.position,
    )  # fmt: skip


def bounced(
    transport: Transport,
    albedo: Float32[np.ndarray, "point 3"],
    surface_albedo: Float64[np.ndarray, "surface 3"],
    mirrors: tuple[Mirror, ...],
    num_bounces: int = 3,
) -> Float32[np.ndarray, "patch light 3"]:
    """Irradiance that each patch gets from others under each light of power 1, after up to `num_bounces` of them."""
    total = np.asarray(transport.hear.sum(axis=1))
    heard = transport.hear @ albedo
    own = np.where(total > 0, heard / np.maximum(total, 1e-12), surface_albedo[transport.surface])
    own = np.clip(own, 0.0, 0.95)  # sums over bounces must converge
    own = own.astype(np.float32)
    own[np.isin(transport.surface, [m.surface for m in mirrors])] = 0.0  # a mirror sends what others send: traced
    throwing = [m for m in mirrors if m.throws_light]
    out = np.zeros((*transport.own.shape, 3), np.float32)
    for color in range(3):
        direct = transport.own.copy()
        for one, patch in zip(throwing, transport.thrown, strict=True):
            direct += np.float32(one.reflectance[color]) * patch
        passes = transport.seen
        for one, part in zip(mirrors, transport.mirrored, strict=True):
            passes = passes + part * float(one.reflectance[color])
        scale = own[:, color, None]
        arrived = np.zeros_like(direct)
        for _ in range(num_bounces):
            arrived = (passes @ (scale * (direct + arrived))).astype(np.float32)
        out[..., color] = arrived
    return out


def openness(transport: Transport) -> Float64[np.ndarray, " site"]:
    """The share of each site's cosine-weighted hemisphere that no surface fills, at least a fiftieth."""
    filled = np.asarray(transport.seen.sum(axis=1), np.float64).ravel()
    return np.clip(1.0 - transport.to_sites @ filled, 0.02, 1.0)


@dataclass(frozen=True, eq=False)
class Bounced:
    """Irradiance from surface to surface in functions of the light, for power 1."""

    basis: str
    coefficients: Float64[np.ndarray, "site basis 3"]


def as_functions(
    transport: Transport,
    irradiance: Float32[np.ndarray, "patch light 3"],
    basis: str,
    anchors: Float64[np.ndarray, "anchor 3"],
    softening: float,
) -> Bounced:
    """The computed irradiance in functions of the light, per site: least squares over the lights tried."""
    rows = [indirect_design(basis, one, transport.positions, anchors, np.pi, softening) for one in transport.lights]
    design = np.stack(np.broadcast_arrays(*rows), axis=1)  # (1 or patch, light, basis)
    gram = np.einsum("nlu,nlv->nuv", design, design)
    if len(design) == 1:
        moment = np.einsum("lu,nlc->nuc", design[0], irradiance, optimize=True)
        gram = np.broadcast_to(gram, (len(moment), *gram.shape[1:]))
    else:
        moment = np.einsum("nlu,nlc->nuc", design, irradiance, optimize=True)
    damping = DAMPING * degree_of(basis) ** 2
    value = solve_normal(gram, moment, damping=damping, diagnose=False).value
    flat = transport.to_sites @ value.reshape(len(value), -1)
    return Bounced(basis, flat.reshape(-1, BASES[basis], 3))


def at_photographs(
    bounced: Bounced, rows: Float64[np.ndarray, "#site photo #color basis"]
) -> Float64[np.ndarray, "site photo 3"]:
    """The computed irradiance of each site in each photograph, from the photographs' rows of the same functions."""
    if len(rows) == 1 and rows.shape[2] == 1:
        return np.einsum("lu,nuc->nlc", rows[0, :, 0], bounced.coefficients, optimize=True)
    num, colors = len(bounced.coefficients), 3
    rows = np.broadcast_to(rows, (num, rows.shape[1], colors, rows.shape[3]))
    return np.einsum("nlcu,nuc->nlc", rows, bounced.coefficients, optimize=True)


def added(indirect: Indirect, bounced: Bounced) -> Indirect:
    """Fitted and computed light as one record, in the functions of whichever has more."""
    basis = max(indirect.basis, bounced.basis, key=lambda name: BASES[name])
    parts = ((indirect.basis, indirect.coefficients), (bounced.basis, bounced.coefficients))
    total = sum(np.einsum("nbc,bk->nkc", part, embedding(name, basis)) for name, part in parts)
    return replace(indirect, basis=basis, coefficients=np.ascontiguousarray(total, np.float32))


def lights_to_try(
    photographed: tuple[tuple[Light, ...], ...],
    anchors: Float64[np.ndarray, "anchor 3"],
    reach_rad: float,
    num_lights: int,
) -> tuple[Light, ...]:
    """Lamps of power 1: the photographed ones, and more within reach of those, since the functions are read there."""
    white = (1.0, 1.0, 1.0)
    every = [light for each in photographed for light in each if np.any(light.power > 0)]
    if not every:
        return ()
    distances = np.array(
        [np.inf if isinstance(one, DirectionalLight) else np.linalg.norm(one.position) for one in every]
    )
    around = spread_directions(8 * num_lights)
    cosine = around @ anchors.T
    near = cosine.max(axis=1) > np.cos(min(reach_rad, np.pi))
    around, nearest = around[near], cosine[near].argmax(axis=1)
    take = np.linspace(0, len(around) - 1, min(num_lights, len(around))).astype(int)
    directions = np.concatenate([anchors, around[take]])
    distance = np.concatenate([distances, distances[nearest[take]]])
    return tuple(
        DirectionalLight(tuple(way), white) if np.isinf(far) else PointLight(tuple(way * far), white)
        for way, far in zip(directions, distance, strict=True)
    )

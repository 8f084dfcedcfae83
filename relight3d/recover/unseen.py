"""The albedo where no captured pixel knows it: behind things, and on their backs.

A texture goes on as far as it resembles itself. How far that is the seen part of each surface says (its correlation over
distance), and simple kriging (Matheron 1963) blends the nearest seen vertices with the surface's own albedo by it: paint
that covers half of a wall is continued behind a vase, a print of narrow stripes is not.
"""

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32
from scipy.spatial import cKDTree

from relight3d.records import PatchMesh, ShadingPoints
from relight3d.recover.sites import site_binding

NUM_DONORS = 12  # seen vertices that speak for an unseen one
NUM_COMPARED = 1000  # seen vertices whose pairs tell how far a surface resembles itself
NUM_STEPS, MIN_PAIRS = 25, 20  # of distance, and that must speak for one
NUGGET = 0.05  # of the variance: what a vertex has for itself alone
NORMALS_COUNT = 0.25  # of the scene's radius: a texture goes on along a wall sooner than around a corner
BLOCK = 20_000  # vertices at a time


def albedo_of_vertices(
    mesh: PatchMesh,
    surface_of_face: Int32[np.ndarray, " face"],
    surface_albedo: Float64[np.ndarray, "surface 3"],
    points: ShadingPoints,
    surface: Int32[np.ndarray, " point"],
    albedo: Float32[np.ndarray, "point 3"],
    is_known: Bool[np.ndarray, " point"],
) -> Float32[np.ndarray, "vertex 3"]:
    """Every vertex's albedo: what the points about it have where `is_known`, else what the seen part of its surface says.

    A surface of one albedo, or with fewer than NUM_DONORS seen vertices, has its `surface_albedo` at the others.
    """
    owner = np.zeros(len(mesh.vertices), np.int32)
    owner[mesh.faces.ravel()] = np.repeat(surface_of_face, 3)
    binding = site_binding(mesh, points.take(is_known), "vertex")
    heard = np.asarray(binding.sum(axis=1))
    out = np.where(heard > 0, binding @ albedo[is_known] / np.maximum(heard, 1e-12), surface_albedo[owner])
    place = np.concatenate([mesh.centered_vertices, NORMALS_COUNT * mesh.radius * mesh.vertex_normals], axis=1)
    place = place.astype(np.float64)
    for s in np.flatnonzero(_has_texture(surface[is_known], albedo[is_known], len(surface_albedo))):
        seen, unseen = (np.flatnonzero((owner == s) & is_one) for is_one in (heard[:, 0] > 0, heard[:, 0] == 0))
        if len(seen) < NUM_DONORS or len(unseen) == 0:
            continue
        away = out[seen] - surface_albedo[s]
        length = correlation_length(place[seen], away)
        if length > 0:
            out[unseen] = np.maximum(surface_albedo[s] + kriged(place[seen], away, place[unseen], length), 0.0)
    return out.astype(np.float32)


def _has_texture(
    surface: Int32[np.ndarray, " point"], albedo: Float32[np.ndarray, "point 3"], num_surfaces: int
) -> Bool[np.ndarray, " surface"]:
    """Surfaces with an albedo per pixel."""
    least, most = np.full((num_surfaces, 3), np.inf), np.full((num_surfaces, 3), -np.inf)
    np.minimum.at(least, surface, albedo)
    np.maximum.at(most, surface, albedo)
    return np.any(most > least, axis=1)


def correlation_length(place: Float64[np.ndarray, "vertex key"], away: Float64[np.ndarray, "vertex 3"]) -> float:
    """The distance over which values resemble each other by 1 / e; 0 where not even neighbours do.

    `away` is by how much each vertex differs from the surface's own albedo.
    """
    some = np.linspace(0, len(place) - 1, min(len(place), NUM_COMPARED)).astype(int)
    one, other = _pairs(place, some)
    distance = np.linalg.norm(place[one] - place[other], axis=1)
    variance = float((away**2).mean(axis=0).sum())
    if variance <= 0 or not distance.max(initial=0.0) > 0:
        return 0.0
    alike = np.einsum("pc,pc->p", away[one], away[other]) / variance
    edges = np.geomspace(np.quantile(distance[distance > 0], 1e-3), distance.max(), NUM_STEPS)
    step = np.digitize(distance, edges[1:-1])
    count = np.bincount(step, minlength=NUM_STEPS - 1)
    told = count >= MIN_PAIRS
    alike = np.bincount(step, alike, minlength=NUM_STEPS - 1)[told] / count[told]
    distance = np.bincount(step, distance, minlength=NUM_STEPS - 1)[told] / count[told]
    unlike = np.flatnonzero(alike < np.exp(-1.0))
    first = unlike[0] if len(unlike) else len(alike)
    return float(distance[first - 1]) if first > 0 else 0.0


def _pairs(
    place: Float64[np.ndarray, "vertex key"], some: Int[np.ndarray, " one"]
) -> tuple[Int[np.ndarray, " pair"], Int[np.ndarray, " pair"]]:
    """All pairs among some vertices; and each with its neighbours, since few of some thousands lie close together."""
    one, other = np.triu_indices(len(some), 1)
    near = cKDTree(place).query(place[some], k=min(NUM_DONORS, len(place)))[1].reshape(len(some), -1)[:, 1:]
    return np.concatenate([some[one], np.repeat(some, near.shape[1])]), np.concatenate([some[other], near.ravel()])


def kriged(
    place: Float64[np.ndarray, "seen key"],
    away: Float64[np.ndarray, "seen 3"],
    wanted: Float64[np.ndarray, "unseen key"],
    length: float,
) -> Float64[np.ndarray, "unseen 3"]:
    """Simple kriging from the nearest seen vertices, by an exponential covariance of the given length."""
    tree, out = cKDTree(place), np.empty((len(wanted), 3))
    for first in range(0, len(wanted), BLOCK):
        part = slice(first, first + BLOCK)
        distance, donor = tree.query(wanted[part], k=NUM_DONORS)
        between = np.linalg.norm(place[donor][:, :, None] - place[donor][:, None], axis=3)
        covariance = np.exp(-between / length) + NUGGET * np.eye(NUM_DONORS)
        share = np.linalg.solve(covariance, np.exp(-distance / length)[..., None])[..., 0]
        out[part] = np.einsum("uk,ukc->uc", share, away[donor])
        least, most = away[donor].min(axis=1), away[donor].max(axis=1)
        out[part] = np.clip(out[part], np.minimum(least, 0.0), np.maximum(most, 0.0))
    return out

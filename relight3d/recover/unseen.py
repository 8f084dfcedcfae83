"""The albedo where nothing shows it: behind things, on their backs, and where no photograph's light falls.

A texture goes on as far as it resembles itself. How far that is the seen part of each surface says (its correlation over
distance), and simple kriging (Matheron 1963) blends the nearest seen vertices with the surface's own albedo by it: paint
that covers half of a wall is continued behind a vase, a print of narrow stripes is not.
"""

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32
from scipy.spatial import cKDTree

from relight3d.records import PatchMesh, ShadingPoints
from relight3d.recover.sites import of_vertices, site_binding

NUM_DONORS = 12  # seen vertices that speak for an unseen one
NUM_COMPARED = 600  # seen vertices whose pairs tell how far a surface resembles itself
NUM_STEPS, MIN_PAIRS = 25, 20  # of distance, and that must speak for one
MIN_SHARED = 0.2  # of the variance, between neighbours
MIN_NUGGET = 0.05  # of the variance: what a place has for itself alone
NORMALS_COUNT = 0.25  # of the scene's radius
BLOCK = 20_000  # vertices at a time


def albedo_of_vertices(
    mesh: PatchMesh,
    surface_of_face: Int32[np.ndarray, " face"],
    panel_of_face: Int32[np.ndarray, " face"],
    surface_albedo: Float64[np.ndarray, "surface 3"],
    points: ShadingPoints,
    surface: Int32[np.ndarray, " point"],
    albedo: Float32[np.ndarray, "point 3"],
    is_known: Bool[np.ndarray, " point"],
) -> Float32[np.ndarray, "vertex 3"]:
    """Every vertex's albedo: what the points about it have where `is_known`, else what the seen part of its panel says.

    The panels are each surface's smooth pieces: what a box's lid shows says nothing of its sides.
    """
    owner, panel = of_vertices(mesh, surface_of_face), of_vertices(mesh, panel_of_face)
    binding = site_binding(mesh, points.take(is_known), "vertex")
    heard = np.asarray(binding.sum(axis=1))
    away = np.where(heard > 0, binding @ albedo[is_known] / np.maximum(heard, 1e-12) - surface_albedo[owner], 0.0)
    is_textured = _has_texture(surface[is_known], albedo[is_known], len(surface_albedo))
    place = places(mesh, mesh.centered_vertices, mesh.vertex_normals)
    away = continued(place, away, np.where(is_textured[owner], panel, -1), heard[:, 0] > 0)
    return np.maximum(surface_albedo[owner] + away, 0.0).astype(np.float32)


def places(
    mesh: PatchMesh, position: Float32[np.ndarray, "point 3"], normal: Float32[np.ndarray, "point 3"]
) -> Float64[np.ndarray, "point 6"]:
    """Positions, and normals beside them as a length: a texture goes on along a wall sooner than around a corner."""
    return np.concatenate([position, NORMALS_COUNT * mesh.radius * normal], axis=1).astype(np.float64)


def continued(
    place: Float64[np.ndarray, "point key"],
    away: Float64[np.ndarray, "point 3"],
    part: Int[np.ndarray, " point"],
    is_known: Bool[np.ndarray, " point"],
) -> Float64[np.ndarray, "point 3"]:
    """What each point differs by from the mean of its part, the unknown ones by those of the same part that are known.

    Parts below 0, those of fewer than NUM_DONORS known points, and those that do not resemble themselves are left at 0.
    """
    out = np.where(is_known[:, None], away, 0.0)
    for one in np.unique(part[~is_known & (part >= 0)]):
        known, unknown = (np.flatnonzero((part == one) & is_one) for is_one in (is_known, ~is_known))
        if len(known) < NUM_DONORS:
            continue
        # About the mean: about any other value, what is far apart would resemble itself as well.
        mean = away[known].mean(axis=0)
        shared, length = correlation(place[known], away[known] - mean)
        if shared > 0:
            out[unknown] = mean + kriged(place[known], away[known] - mean, place[unknown], shared, length)
    return out


def _has_texture(
    surface: Int32[np.ndarray, " point"], albedo: Float32[np.ndarray, "point 3"], num_surfaces: int
) -> Bool[np.ndarray, " surface"]:
    """Surfaces with an albedo per pixel."""
    least, most = np.full((num_surfaces, 3), np.inf), np.full((num_surfaces, 3), -np.inf)
    np.minimum.at(least, surface, albedo)
    np.maximum.at(most, surface, albedo)
    return np.any(most > least, axis=1)


def correlation(place: Float64[np.ndarray, "vertex key"], away: Float64[np.ndarray, "vertex 3"]) -> tuple[float, float]:
    """How much of their variance places share with those beside them, and over what distance that falls to 1 / e.

    `away` is by how much each differs from the mean. (0, 0) where not even neighbours resemble each other; what each has
    for itself is noise, or finer than the places are close.
    """
    some = np.linspace(0, len(place) - 1, min(len(place), NUM_COMPARED)).astype(int)
    one, other = _pairs(place, some)
    distance = np.linalg.norm(place[one] - place[other], axis=1)
    is_apart = distance > 0  # the same place twice tells nothing of a distance
    one, other, distance = one[is_apart], other[is_apart], distance[is_apart]
    variance = float((away**2).mean(axis=0).sum())
    if variance <= 0 or len(distance) == 0:
        return 0.0, 0.0
    alike = np.einsum("pc,pc->p", away[one], away[other]) / variance
    edges = np.geomspace(np.quantile(distance, 1e-3), distance.max(), NUM_STEPS)
    step = np.digitize(distance, edges[1:-1])
    count = np.bincount(step, minlength=NUM_STEPS - 1)
    told = count >= MIN_PAIRS
    alike = np.bincount(step, alike, minlength=NUM_STEPS - 1)[told] / count[told]
    distance = np.bincount(step, distance, minlength=NUM_STEPS - 1)[told] / count[told]
    shared = min(float(alike[0]), 1.0 - MIN_NUGGET) if len(alike) else 0.0
    if shared < MIN_SHARED:
        return 0.0, 0.0
    unlike = np.flatnonzero(alike < shared * np.exp(-1.0))
    return shared, float(distance[(unlike[0] if len(unlike) else len(alike)) - 1])


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
    shared: float,
    length: float,
) -> Float64[np.ndarray, "unseen 3"]:
    """Simple kriging from the nearest seen places, by an exponential covariance with a nugget (`correlation`)."""
    tree, out = cKDTree(place), np.empty((len(wanted), 3))
    for first in range(0, len(wanted), BLOCK):
        part = slice(first, first + BLOCK)
        distance, donor = tree.query(wanted[part], k=NUM_DONORS)
        between = np.linalg.norm(place[donor][:, :, None] - place[donor][:, None], axis=3)
        covariance = shared * np.exp(-between / length) + (1.0 - shared) * np.eye(NUM_DONORS)
        share = np.linalg.solve(covariance, shared * np.exp(-distance / length)[..., None])[..., 0]
        out[part] = np.einsum("uk,ukc->uc", share, away[donor])
        least, most = away[donor].min(axis=1), away[donor].max(axis=1)
        out[part] = np.clip(out[part], np.minimum(least, 0.0), np.maximum(most, 0.0))
    return out

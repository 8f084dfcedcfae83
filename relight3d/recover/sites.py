"""Where the indirect light is kept: vertices, faces or pixels; which points each hears, and who stands in for the unseen."""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float32, Float64, Num
from scipy.spatial import cKDTree

from relight3d.maths.least_squares import Status
from relight3d.records import Health, Indirect, PatchMesh, ShadingPoints

SITES = ("vertex", "face", "pixel")
NUM_DONORS = 4  # that stand in for a site without data
MIN_ALBEDO = 0.2  # of the brightest surface's: what is darker shows too little of its light to lend it
MOST_OPENED = 1.5  # times its donors' light, at most, for a site more open than they


def site_binding(mesh: PatchMesh, points: ShadingPoints, site: str) -> sp.csr_matrix:
    """How much each point says of each site: barycentric weights for vertices, 1 for its face, itself for pixels."""
    num = len(points)
    if site == "pixel":
        return sp.identity(num, format="csr", dtype=np.float32)
    if site == "face":
        ones = np.ones(num, np.float32)
        return sp.csr_matrix((ones, (points.face, np.arange(num))), shape=(len(mesh.faces), num))
    corners = mesh.faces[points.face]
    columns = np.repeat(np.arange(num), 3)
    entries = (points.barycentric.ravel(), (corners.ravel(), columns))
    return sp.csr_matrix(entries, shape=(len(mesh.vertices), num))


def site_positions(mesh: PatchMesh, points: ShadingPoints, site: str) -> Float32[np.ndarray, "site 3"]:
    """Where the sites are, in centred coordinates."""
    if site == "pixel":
        return points.position
    return mesh.centered_vertices if site == "vertex" else mesh.centered_vertices[mesh.faces].mean(axis=1)


def site_vertices(mesh: PatchMesh, points: ShadingPoints, site: str) -> sp.csr_matrix:
    """How sites blend vertices (site x vertex): themselves, a face's three, or a pixel's by its place in its face."""
    num = len(mesh.vertices)
    if site == "vertex":
        return sp.identity(num, format="csr", dtype=np.float32)
    corners = mesh.faces if site == "face" else mesh.faces[points.face]
    shares = np.full(corners.shape, 1 / 3, np.float32) if site == "face" else points.barycentric
    entries = (shares.ravel(), (np.repeat(np.arange(len(corners)), 3), corners.ravel()))
    return sp.csr_matrix(entries, shape=(len(corners), num))


def spread_over_neighbours(mesh: PatchMesh, binding: sp.csr_matrix, site: str, smoothing_px: float) -> sp.csr_matrix:
    """The binding widened along the mesh until a site hears about (2 * smoothing_px)^2 pixels, and every site is heard.

    Steps along edges halve in strength, so that a dense site keeps its own light and a sparse one borrows.
    """
    if site == "pixel" or smoothing_px <= 0:
        return binding
    step = _neighbours(mesh, site)
    wanted = np.pi * smoothing_px**2
    total, reached = binding.astype(np.float32), binding
    for _ in range(12):
        heard = np.asarray(total.sum(axis=1)).ravel()
        short = np.clip(1.0 - heard / wanted, 0.0, 1.0)
        if short.max() < 1e-3:
            break
        reached = step @ reached
        # What would weigh next to nothing is dropped: a site need not carry the names of all it hardly hears.
        reached.data[reached.data < 1e-3] = 0.0
        reached.eliminate_zeros()
        total = total + sp.diags((0.5 * short).astype(np.float32)) @ reached
        if total.nnz > 60 * max(binding.shape):  # memory: a site need not hear more than this
            break
    return total.tocsr()


def _neighbours(mesh: PatchMesh, site: str) -> sp.csr_matrix:
    """Row-normalised adjacency of vertices by edges, or of faces by shared vertices of one normal."""
    faces, num = mesh.faces, len(mesh.vertices)
    if site == "vertex":
        rows = faces[:, [0, 1, 2, 1, 2, 0]].ravel()
        columns = faces[:, [1, 2, 0, 0, 1, 2]].ravel()
        matrix = sp.csr_matrix((np.ones(len(rows), np.float32), (rows, columns)), shape=(num, num))
    else:
        index = np.repeat(np.arange(len(faces)), 3)
        touch = sp.csr_matrix((np.ones(len(index), np.float32), (index, faces.ravel())), shape=(len(faces), num))
        matrix = (touch @ touch.T).tocsr()
        matrix.setdiag(0)
    matrix.data[:] = 1.0
    degree = np.maximum(np.asarray(matrix.sum(axis=1)).ravel(), 1.0)
    return sp.diags((1.0 / degree).astype(np.float32)) @ matrix


def of_faces(mesh: PatchMesh, values: Num[np.ndarray, " face"], site: str) -> Num[np.ndarray, " site"] | None:
    """A number of each face at the sites: at vertices that of one of their faces; None for pixels."""
    if site == "pixel":
        return None
    if site == "face":
        return values
    return of_vertices(mesh, values)


def of_vertices(mesh: PatchMesh, values: Num[np.ndarray, " face"]) -> Num[np.ndarray, " vertex"]:
    """A number of each face at the vertices: that of one of their faces."""
    at_vertex = np.zeros(len(mesh.vertices), values.dtype)
    at_vertex[mesh.faces.ravel()] = np.repeat(values, 3)
    return at_vertex


def fill_unseen(
    mesh: PatchMesh,
    indirect: Indirect,
    health: Health,
    openness: Float64[np.ndarray, " site"] | None = None,
    albedo: Float64[np.ndarray, " site"] | None = None,
) -> tuple[Indirect, Health]:
    """Sites without data take the mean of the nearest sites that have some (by distance and normal).

    With `openness` (0 to 1, how much of its surroundings each site looks at) they take it by how open they are; with
    `albedo` (of the surface that each site is on) from sites that send enough back to tell what they get.
    """
    missing = health.status == Status.NO_DATA
    if indirect.site == "pixel" or not missing.any() or missing.all():
        return indirect, health
    donors = ~missing
    if albedo is not None:
        donors &= albedo >= MIN_ALBEDO * albedo[donors].max()
    places = mesh.centered_vertices
    normals = mesh.vertex_normals
    if indirect.site == "face":
        places, normals = places[mesh.faces].mean(axis=1), mesh.face_normals
    # Normals count as a quarter of the scene: light changes more around a corner than along a wall.
    keyed = np.concatenate([places, 0.25 * mesh.radius * normals], axis=1)
    tree = cKDTree(keyed[donors])
    distance, nearest = tree.query(keyed[missing], k=min(NUM_DONORS, int(donors.sum())))
    distance, nearest = distance.reshape(missing.sum(), -1), nearest.reshape(missing.sum(), -1)
    share = 1.0 / np.maximum(distance, 1e-9 * mesh.radius + 1e-30)
    if albedo is not None:  # what a site gets is what it sends over its albedo, and so are the errors in it
        share = share * (np.maximum(albedo[donors], 1e-6) ** 2)[nearest]
    share /= share.sum(axis=1, keepdims=True)
    if openness is not None:
        # Of all donors together: one that is closed in says little of the surroundings, and must not be scaled up.
        theirs = (share * openness[donors][nearest]).sum(axis=1)
        share = share * np.minimum(openness[missing] / theirs, MOST_OPENED)[:, None]
    coefficients, ambient = indirect.coefficients.copy(), indirect.ambient.copy()
    coefficients[missing] = np.einsum("nk,nkbc->nbc", share, indirect.coefficients[donors][nearest])
    ambient[missing] = np.einsum("nk,nkc->nc", share, indirect.ambient[donors][nearest])
    status = health.status.copy()
    status[missing] = Status.FALLBACK
    return replace(indirect, coefficients=coefficients, ambient=ambient), replace(health, status=status)

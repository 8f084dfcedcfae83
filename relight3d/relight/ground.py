"""The one plane that decides without a ray: what stands on a table gets no light from under it."""

from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float64

from relight3d.records import PatchMesh

MAX_EDGES = 16
ALIKE = 0.95  # of the largest piece's area: as large
NO_GROUND = np.zeros((0, 3))

_grounds: "WeakKeyDictionary[PatchMesh, np.ndarray]" = WeakKeyDictionary()


def ground_of(mesh: PatchMesh) -> Float64[np.ndarray, "row 3"]:
    """The mesh's largest flat piece, if it is convex and without holes: a point, the normal, two axes, and for each
    edge (a, b, c) with a u + b v <= c inside; centred coordinates. No rows where there is no such piece.
    """
    if mesh not in _grounds:
        _grounds[mesh] = _find_ground(mesh)
    return _grounds[mesh]


def _find_ground(mesh: PatchMesh) -> Float64[np.ndarray, "row 3"]:
    corners = (mesh.vertices - mesh.center)[mesh.faces]
    normals, areas = mesh.face_normals.astype(np.float64), mesh.face_areas
    offsets = np.einsum("fi,fi->f", normals, corners.mean(axis=1)) / mesh.radius
    # A coarse lattice finds the plane; its own tolerance, not the lattice's borders, says what belongs to it.
    keys = np.rint(np.column_stack([normals * 50, offsets * 500])).astype(np.int64)
    _, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.ravel()
    area = np.bincount(group, weights=areas)
    largest = [group == k for k in np.flatnonzero(area > ALIKE * area.max())]
    widest = [np.flatnonzero(piece)[np.argmax(areas[piece])] for piece in largest]  # a face of each
    # A slab has two sides of one size: things stand on the one that has more of the mesh in front of it.
    corner = corners.reshape(-1, 3) / mesh.radius
    in_front = [np.count_nonzero(corner @ normals[k] > offsets[k] + 1e-4) for k in widest]
    face = widest[int(np.argmax(in_front))]
    normal, offset = normals[face], offsets[face]
    belongs = (normals @ normal > 1 - 1e-6) & (np.abs(offsets - offset) < 1e-5)
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    axes = np.stack([u / np.linalg.norm(u), np.cross(normal, u / np.linalg.norm(u))])
    edges = _convex_outline((corners[belongs] @ axes.T).reshape(-1, 2), float(areas[belongs].sum()))
    if edges is None:
        return NO_GROUND
    return np.concatenate([(offset * mesh.radius * normal)[None], normal[None], axes, edges])


def _convex_outline(points: Float64[np.ndarray, "corner 2"], area: float) -> Float64[np.ndarray, "edge 3"] | None:
    """The hull's edges, if the pieces fill it."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:  # a sliver
        return None
    # `volume` is an area in two dimensions. Qhull splits straight sides: equal lines are one edge.
    lines = np.unique(hull.equations.round(7), axis=0)
    if area < hull.volume * (1 - 1e-5) or len(lines) > MAX_EDGES:
        return None
    margin = 1e-5 * np.abs(points).max()
    return np.column_stack([lines[:, :2], -lines[:, 2] - margin])

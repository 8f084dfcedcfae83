"""Which vertices are one, which faces share an edge, which corners shade alike: index arrays only.

A vertex is a number. To ask about places instead of shading vertices, give `mesh.welded_vertex[mesh.faces]` for the
faces: then faces meet wherever their corners stand at one place. Side k of a face runs from corner k to corner k + 1.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int32, Shaped
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

# At an edge of very many faces (a broken file) each is paired with this many others, not with all: no blow-up.
MAX_PAIRS_PER_SIDE = 8


@dataclass(frozen=True, eq=False)
class SharedEdges:
    """Every pair of faces that share an edge (all pairs, where an edge has three faces or more)."""

    pairs: Int32[np.ndarray, "pair 2"]  # faces, the lower number first
    sides: Int32[np.ndarray, "pair 2"]  # which side of each
    is_manifold: Bool[np.ndarray, " pair"]  # the edge has no third face
    is_coherent: Bool[np.ndarray, " pair"]  # the faces run along it in opposite directions, as one surface does
    num_boundary: int  # edges of one face
    num_non_manifold: int  # edges of three or more


def first_equal_row(rows: Shaped[np.ndarray, "row column"]) -> Int32[np.ndarray, " row"]:
    """For each row the number of the first row that equals it exactly (no NaN)."""
    order = np.lexsort(rows.T[::-1])
    is_new = np.ones(len(rows), dtype=bool)
    is_new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    first = np.empty(len(rows), dtype=np.int32)
    first[order] = order[is_new][np.cumsum(is_new) - 1]  # lexsort is stable: a run starts with its lowest number
    return first


def weld(points: Float64[np.ndarray, "vertex 3"], tolerance: float) -> Int32[np.ndarray, " vertex"]:
    """For each point the lowest-numbered one at its place: equal, or within `tolerance`.

    Finite points. A chain of points, each near the next, that leads farther than twice the tolerance is detail of the
    surface and not noise: its points stay apart.
    """
    first = first_equal_row(points)
    distinct = np.flatnonzero(first == np.arange(len(points)))
    if tolerance <= 0 or len(distinct) < 2:
        return first
    tree = cKDTree(points[distinct])
    nearest = tree.query(points[distinct], k=2, distance_upper_bound=tolerance)[0][:, 1]
    close = np.flatnonzero(np.isfinite(nearest))
    if len(close) == 0:
        return first
    # A bounded number of neighbours, since all pairs of a crowd (a tiny object and one far vertex) would not fit.
    _, near = tree.query(points[distinct[close]], k=min(9, len(distinct)), distance_upper_bound=tolerance)
    row, column = np.nonzero(near < len(distinct))
    group = _components(len(distinct), close[row], near[row, column])
    low, high = np.full((2, group.max() + 1, 3), np.inf) * np.array([1, -1])[:, None, None]
    np.minimum.at(low, group, points[distinct])
    np.maximum.at(high, group, points[distinct])
    is_chain = np.linalg.norm(high - low, axis=1) > 2 * tolerance
    lowest = np.full(group.max() + 1, len(points))
    np.minimum.at(lowest, group, distinct)
    stands_for = np.arange(len(points), dtype=np.int32)
    stands_for[distinct] = np.where(is_chain[group], distinct, lowest[group])
    return stands_for[first]


def repeated_faces(faces: Int32[np.ndarray, "face 3"]) -> Bool[np.ndarray, " face"]:
    """True for a face whose corners, in whatever order, an earlier face has too."""
    return first_equal_row(np.sort(faces, axis=1)) != np.arange(len(faces))


def shared_edges(faces: Int32[np.ndarray, "face 3"]) -> SharedEdges:
    """Pair the faces over their edges. A face is never paired with itself."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(start, end).astype(np.int64) << 32 | np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    is_first = np.ones(len(order), dtype=bool)
    is_first[1:] = ordered[1:] != ordered[:-1]
    num_faces = np.diff(np.append(np.flatnonzero(is_first), len(order)))
    found = []
    for step in range(1, min(int(num_faces.max(initial=0)), MAX_PAIRS_PER_SIDE + 1)):
        at = np.flatnonzero(ordered[step:] == ordered[:-step])
        found.append(np.column_stack([order[at], order[at + step]]))
    halves = np.concatenate(found) if found else np.empty((0, 2), dtype=np.int64)
    halves = halves[halves[:, 0] // 3 != halves[:, 1] // 3]
    edge_of_half = np.empty(len(order), dtype=np.int64)
    edge_of_half[order] = np.cumsum(is_first) - 1
    return SharedEdges(
        pairs=(halves // 3).astype(np.int32),
        sides=(halves % 3).astype(np.int32),
        is_manifold=num_faces[edge_of_half[halves[:, 0]]] == 2,
        is_coherent=start[halves[:, 0]] != start[halves[:, 1]],
        num_boundary=int((num_faces == 1).sum()),
        num_non_manifold=int((num_faces > 2).sum()),
    )


def split_non_manifold(
    faces: Int32[np.ndarray, "face 3"],
) -> tuple[Int32[np.ndarray, "face 3"], Int32[np.ndarray, " vertex"]]:
    """Give faces that meet three or more at an edge vertices of their own there.

    Returns the faces and, for each of the new vertices, the one it was; they are in the old ones' order.
    """
    edges = shared_edges(faces)
    face, side = edges.pairs[~edges.is_manifold].ravel(), edges.sides[~edges.is_manifold].ravel()
    own = np.zeros(faces.shape, dtype=np.int64)
    own[face, side] = own[face, (side + 1) % 3] = 1
    own[own > 0] = np.arange(1, own.sum() + 1)
    width = int(own.max(initial=0)) + 1
    key, split = np.unique(faces * width + own, return_inverse=True)
    return split.reshape(faces.shape).astype(np.int32), (key // width).astype(np.int32)


def face_adjacency(faces: Int32[np.ndarray, "face 3"]) -> Int32[np.ndarray, "pair 2"]:
    """The pairs of faces that share an edge, the lower number first."""
    return shared_edges(faces).pairs


def dihedral_angles(
    face_normals: Float[np.ndarray, "face 3"], pairs: Int32[np.ndarray, "pair 2"]
) -> Float64[np.ndarray, " pair"]:
    """The angle in radians between the normals of each pair: 0 on a plane, pi where a face folds onto the other."""
    one, other = face_normals[pairs[:, 0]].astype(np.float64), face_normals[pairs[:, 1]].astype(np.float64)
    # arctan2 is exact near 0, where arccos of a rounded cosine is off by 1e-4.
    return np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), (one * other).sum(axis=1))


def vertex_neighbours(faces: Int32[np.ndarray, "face 3"], num_vertices: int) -> csr_array:
    """Which vertices an edge joins: a symmetric sparse matrix of float64 ones, with an empty diagonal."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    keep = start != end
    row, column = np.concatenate([start[keep], end[keep]]), np.concatenate([end[keep], start[keep]])
    matrix = coo_array((np.ones(len(row)), (row, column)), shape=(num_vertices, num_vertices)).tocsr()
    matrix.data[:] = 1.0
    return matrix


def corner_angles(
    vertices: Float64[np.ndarray, "vertex 3"], faces: Int32[np.ndarray, "face 3"]
) -> Float64[np.ndarray, "face 3"]:
    """The inner angle in radians at each corner; 0 where an edge has no length."""
    place = vertices[faces]
    ahead, back = np.roll(place, -1, axis=1) - place, np.roll(place, 1, axis=1) - place
    return np.arctan2(np.linalg.norm(np.cross(ahead, back), axis=2), (ahead * back).sum(axis=2))


def corner_fans(
    faces: Int32[np.ndarray, "face 3"], edges: SharedEdges, is_smooth: Bool[np.ndarray, " pair"]
) -> Int32[np.ndarray, "face 3"]:
    """Number the fans of corners that shade alike: those of one vertex that smooth edges connect."""
    face, side = edges.pairs[is_smooth], edges.sides[is_smooth]
    start, end = 3 * face + side, 3 * face + (side + 1) % 3
    # Coherent faces run along their edge in opposite directions, so the start of one meets the end of the other.
    crossed = edges.is_coherent[is_smooth]
    other_start = np.where(crossed, end[:, 1], start[:, 1])
    other_end = np.where(crossed, start[:, 1], end[:, 1])
    ones, others = np.concatenate([start[:, 0], end[:, 0]]), np.concatenate([other_start, other_end])
    return _components(faces.size, ones, others).reshape(faces.shape)


def coherent_flips(
    num_faces: int, edges: SharedEdges
) -> tuple[Bool[np.ndarray, " face"], Int32[np.ndarray, " face"], Bool[np.ndarray, " component"]]:
    """Which faces to turn over so that neighbours agree, the component of each face, and which can be oriented.

    Components are connected over edges of two faces. Each face stands twice in a graph, as it is and turned over; an
    edge joins equal states where the faces agree and unequal ones where they do not. A Moebius strip meets itself.
    The lowest face of a component is not flipped; nothing is where there is no orientation.
    """
    pairs, agrees = edges.pairs[edges.is_manifold], edges.is_coherent[edges.is_manifold]
    one, other = pairs.T.astype(np.int64)
    shift = np.where(agrees, 0, num_faces)
    state = _components(
        2 * num_faces,
        np.concatenate([one, one + num_faces]),
        np.concatenate([other + shift, other + num_faces - shift]),
    )
    as_is, turned = state[:num_faces], state[num_faces:]
    _, component = np.unique(np.minimum(as_is, turned), return_inverse=True)
    is_orientable = np.ones(component.max(initial=-1) + 1, dtype=bool)
    is_orientable[component[as_is == turned]] = False
    return as_is > turned, component.astype(np.int32), is_orientable


def _components(num_nodes: int, one: np.ndarray, other: np.ndarray) -> Int32[np.ndarray, " node"]:
    """The connected component of each node, numbered by their lowest nodes."""
    graph = coo_array((np.ones(len(one), dtype=bool), (one, other)), shape=(num_nodes, num_nodes))
    return connected_components(graph, directed=False)[1].astype(np.int32)

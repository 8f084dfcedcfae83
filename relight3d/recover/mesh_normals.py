"""The vertices a mesh is shaded by: its own where it brings normals, split at creases where it does not."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int32

from relight3d.maths.topology import corner_angles, corner_fans, dihedral_angles, first_equal_row, shared_edges
from relight3d.records import TriangleMesh
from relight3d.recover.mesh_repair import CleanFaces, face_normals

MIN_NORMAL = 1e-6  # a normal shorter than this has no direction


@dataclass(frozen=True, eq=False)
class ShadingVertices:
    """Vertices with one normal each, in the input's order."""

    vertex_in: Int32[np.ndarray, " vertex"]  # of the input mesh
    normals: Float64[np.ndarray, "vertex 3"]
    faces: Int32[np.ndarray, "face 3"]
    num_merged: int  # vertices that were the same as another: place, normal and UV
    num_unused: int  # vertices of no face that stayed
    num_bad_normals: int  # vertices whose normal was NaN or had no length; those got a computed one


def shading_vertices(clean: CleanFaces, mesh: TriangleMesh, crease_angle_rad: float) -> ShadingVertices:
    """Merge vertices that are the same in all they have, and split those whose computed normals differ at a crease."""
    has_normal, given = _given_normals(mesh)
    vertex = clean.vertex
    is_used = np.zeros(len(mesh.vertices), dtype=bool)
    is_used[vertex] = True
    used = np.flatnonzero(is_used)
    merged = _merge(clean, mesh, used, np.where(has_normal[:, None], given, 0.0))
    is_computed = ~has_normal[vertex]
    fan, fan_normals = np.zeros(vertex.shape, dtype=np.int64), given[vertex]
    if is_computed.any():
        fan, computed = _fan_normals(clean, crease_angle_rad)
        fan = np.where(is_computed, fan, 0)
        fan_normals = np.where(is_computed[..., None], computed, fan_normals)
    # Sorted by the vertex of the input first: a mesh with nothing to mend keeps its own numbers.
    num_fans = int(fan.max()) + 1
    key, first, faces = np.unique(
        merged[vertex].astype(np.int64) * num_fans + fan, return_index=True, return_inverse=True
    )
    return ShadingVertices(
        vertex_in=(key // num_fans).astype(np.int32),
        normals=fan_normals.reshape(-1, 3)[first],
        faces=faces.reshape(-1, 3).astype(np.int32),
        num_merged=int((merged[used] != used).sum()),
        num_unused=len(mesh.vertices) - len(used),
        num_bad_normals=0 if mesh.vertex_normals is None else int((~has_normal[used]).sum()),
    )


def _given_normals(mesh: TriangleMesh) -> tuple[Bool[np.ndarray, " vertex"], Float64[np.ndarray, "vertex 3"]]:
    """Which vertices have a direction, and it at unit length."""
    if mesh.vertex_normals is None:
        return np.zeros(len(mesh.vertices), dtype=bool), np.zeros_like(mesh.vertices)
    normals = mesh.vertex_normals.astype(np.float64)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    has_normal = np.isfinite(length[:, 0]) & (length[:, 0] > MIN_NORMAL)
    # float32 normals of unit length stay bit for bit what they were.
    unit = np.where(np.abs(length - 1) < 1e-6, normals, normals / np.where(has_normal[:, None], length, 1.0))
    return has_normal, np.where(has_normal[:, None], unit, 0.0)


def _merge(
    clean: CleanFaces, mesh: TriangleMesh, used: np.ndarray, normals: np.ndarray
) -> Int32[np.ndarray, " vertex"]:
    """For each used vertex the lowest-numbered one with its place, normal and UV."""
    uvs = np.zeros((len(mesh.vertices), 2))
    if mesh.corner_uvs is not None:
        uvs[mesh.faces.ravel()[::-1]] = np.nan_to_num(mesh.corner_uvs.reshape(-1, 2)[::-1])  # the first corner's stays
    # Normals that differ in the last digits of float32 are the same; a rounding border between two costs a vertex.
    rows = np.column_stack([clean.twin[used], np.rint(normals[used] * 1e5), uvs[used]])
    merged = np.arange(len(mesh.vertices), dtype=np.int32)
    merged[used] = used[first_equal_row(rows)]
    return merged


def _fan_normals(
    clean: CleanFaces, crease_angle_rad: float
) -> tuple[Int32[np.ndarray, "face 3"], Float64[np.ndarray, "face 3 3"]]:
    """Fans of corners that no crease parts, and at each corner its fan's mean normal, weighted by the corners' angles.

    The angles make the mean independent of how a flat part is cut up. Where the mean cancels, the face's own normal.
    """
    faces = clean.faces
    normals = face_normals(clean.points, faces)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges = shared_edges(faces)
    fan = corner_fans(faces, edges, dihedral_angles(normals, edges.pairs) <= crease_angle_rad)
    weight = corner_angles(clean.points, faces)
    total = np.stack([np.bincount(fan.ravel(), (weight * normals[:, None, k]).ravel()) for k in range(3)], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    has_mean = length > 1e-3 * np.bincount(fan.ravel(), weight.ravel())[:, None]
    mean = total / np.where(has_mean, length, 1.0)
    return fan, np.where(has_mean[fan], mean[fan], normals[:, None, :])

"""Patches: vertices of the mesh that send light to one another, and how much of each other's sky they fill."""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float32
from scipy.spatial import cKDTree

from relight3d.maths.light_basis import GOLDEN_ANGLE
from relight3d.records import Mirror, PatchMesh, ShadingPoints
from relight3d.tracing import RayScene

INSET = 0.2  # patches stand so far from their vertex towards the middle of its face: edges lie in two surfaces


def turned_to_viewer(
    mesh: PatchMesh, points: ShadingPoints
) -> tuple[Float32[np.ndarray, "vertex 3"], Float32[np.ndarray, "face 3"]]:
    """Normals of vertices and faces, turned where the camera sees the side that they turn away from."""
    corners = mesh.faces[points.face]
    agree = np.einsum("pki,pi->pk", mesh.vertex_normals[corners], points.normal) * points.barycentric
    vote = np.bincount(corners.ravel(), agree.ravel(), len(mesh.vertices))
    normals = mesh.vertex_normals * np.where(vote < 0, -1.0, 1.0)[:, None].astype(np.float32)
    along = np.einsum("fi,fki->f", mesh.face_normals, normals[mesh.faces])
    return normals, mesh.face_normals * np.where(along < 0, -1.0, 1.0)[:, None].astype(np.float32)


def choose_patches(
    mesh: PatchMesh, normals: np.ndarray, max_patches: int
) -> tuple[np.ndarray, np.ndarray, sp.csr_matrix]:
    """Which vertices are patches, the nearest patch of each vertex, and how vertices blend patches."""
    num = len(mesh.vertices)
    if num <= max_patches:
        every = np.arange(num)
        return every, every, sp.identity(num, format="csr", dtype=np.float32)
    # Evenly by area: the vertex at every n-th step along a walk over the faces weighed by their areas.
    total = np.cumsum(mesh.face_areas)
    picks = np.searchsorted(total, (np.arange(max_patches) + 0.5) * total[-1] / max_patches)
    chosen = np.unique(mesh.faces[np.minimum(picks, len(mesh.faces) - 1), 0])
    keyed = np.concatenate([mesh.centered_vertices, 0.1 * mesh.radius * normals], axis=1)
    count = min(3, len(chosen))
    distance, index = cKDTree(keyed[chosen]).query(keyed, k=count)
    distance, index = distance.reshape(num, count), index.reshape(num, count)
    share = 1.0 / (distance + 1e-6 * mesh.radius)
    share /= share.sum(axis=1, keepdims=True)
    entries = (share.ravel().astype(np.float32), (np.repeat(np.arange(num), count), index.ravel()))
    return chosen, index[:, 0], sp.csr_matrix(entries, shape=(num, len(chosen)))


def as_points(mesh: PatchMesh, normals: np.ndarray, face_normals: np.ndarray, chosen: np.ndarray) -> ShadingPoints:
    """Patches as points to cast light to: a little inside one of their faces, since an edge lies in two surfaces."""
    face = np.zeros(len(mesh.vertices), np.int32)
    face[mesh.faces.ravel()] = np.repeat(np.arange(len(mesh.faces), dtype=np.int32), 3)
    face = face[chosen]
    corner = mesh.centered_vertices[chosen]
    position = corner + np.float32(INSET) * (mesh.centered_vertices[mesh.faces[face]].mean(axis=1) - corner)
    normal = np.ascontiguousarray(normals[chosen], np.float32)
    num = len(chosen)
    return ShadingPoints(
        pixel=np.zeros(num, np.int32), face=face, barycentric=np.zeros((num, 3), np.float32),
        position=position, geometric_normal=np.ascontiguousarray(face_normals[face]), normal=normal,
        to_viewer=normal, depth=np.zeros(num, np.float32),
    )  # fmt: skip


def hemispheres(
    scene: RayScene,
    mesh: PatchMesh,
    face_normals: np.ndarray,
    patches: ShadingPoints,
    nearest: np.ndarray,
    mirrors: tuple[Mirror, ...],
    surface_of_face: np.ndarray,
    num_rays: int,
) -> tuple[sp.csr_matrix, tuple[sp.csr_matrix, ...]]:
    """Shares of hemispheres, patch by patch: seen directly, and by way of each mirror."""
    num = len(patches)
    shape = (num, num)
    blocks: list[list[sp.csr_matrix]] = [[] for _ in range(1 + len(mirrors))]
    step = max(1, 2**20 // max(num_rays, 1))  # a million rays at once: 60 MB
    for first in range(0, num, step):
        part = np.arange(first, min(first + step, num))
        origins, ways = _cosine_rays(patches.position[part], patches.normal[part], part, num_rays)
        sender = np.repeat(part, num_rays)
        offset = origins + np.repeat(patches.geometric_normal[part], num_rays, axis=0) * scene.offset_distance
        # A shading normal leans over: what it looks at below its own face would be that face's neighbours.
        above = np.flatnonzero(
            np.einsum("ri,ri->r", ways, np.repeat(patches.geometric_normal[part], num_rays, axis=0)) > 0
        )
        offset, ways, sender = offset[above], ways[above], sender[above]
        hits = scene.first_hit(offset, ways)
        blocks[0].append(_counted(mesh, face_normals, hits, ways, sender, nearest, shape, num_rays))
        for k, one in enumerate(mirrors):
            on = np.flatnonzero((hits.face >= 0) & (surface_of_face[np.maximum(hits.face, 0)] == one.surface))
            normal = face_normals[hits.face[on]]
            against = np.einsum("ri,ri->r", ways[on], normal)
            on, normal, against = on[against < 0], normal[against < 0], against[against < 0]
            bounce = offset[on] + hits.distance[on, None] * ways[on] + 4 * scene.offset_distance * normal
            onward = ways[on] - 2 * against[:, None] * normal
            again = scene.first_hit(bounce, onward)
            blocks[k + 1].append(_counted(mesh, face_normals, again, onward, sender[on], nearest, shape, num_rays))
    summed = [sum(block[1:], start=block[0]).tocsr() for block in blocks]
    return summed[0], tuple(summed[1:])


def _cosine_rays(position, normal, index, num_rays: int) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions, cosine-weighted by a spiral that each patch turns by its own angle."""
    k = np.arange(num_rays) + 0.5
    radius, angle = np.sqrt(k / num_rays), GOLDEN_ANGLE * k
    turn = (GOLDEN_ANGLE * 7.0 * index)[:, None]
    x, y, z = radius * np.cos(angle + turn), radius * np.sin(angle + turn), np.sqrt(1.0 - k / num_rays)
    helper = np.where(np.abs(normal[:, :1]) < 0.7, np.array([[1.0, 0, 0]]), np.array([[0, 1.0, 0]]))
    tangent = np.cross(normal, helper)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
    bitangent = np.cross(normal, tangent)
    ways = x[..., None] * tangent[:, None] + y[..., None] * bitangent[:, None] + z[None, :, None] * normal[:, None]
    return np.repeat(position, num_rays, axis=0), ways.reshape(-1, 3).astype(np.float32)


def _counted(mesh: PatchMesh, face_normals, hits, ways, sender, nearest, shape, num_rays: int) -> sp.csr_matrix:
    """Hits on front sides, as shares per pair of patches."""
    good = np.flatnonzero(hits.face >= 0)
    front = np.einsum("ri,ri->r", face_normals[hits.face[good]], ways[good]) < 0
    good = good[front]
    weights = np.stack([1.0 - hits.u - hits.v, hits.u, hits.v], axis=1)[good]
    target = nearest[main_corner(mesh, hits.face[good], weights)]
    share = np.full(len(good), 1.0 / num_rays, np.float32)
    return sp.csr_matrix((share, (sender[good], target)), shape=shape)


def main_corner(mesh: PatchMesh, face: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The vertex of a face that a point in it is nearest to."""
    return mesh.faces[face, weights.argmax(axis=1)]

"""A model with more faces: every face cut into four, again and again, with nothing else changed."""

from dataclasses import replace

import numpy as np

from relight3d.records import MeshReport, PatchMesh, PixelMap, RelightModel

CORNERS = np.eye(3)
MIDDLES = (CORNERS + np.roll(CORNERS, -1, axis=0)) / 2  # of edges 01, 12, 20
# The four children's corners, as weights of the parent's.
CHILDREN = np.stack(
    [
        np.stack([CORNERS[0], MIDDLES[0], MIDDLES[2]]),
        np.stack([MIDDLES[0], CORNERS[1], MIDDLES[1]]),
        np.stack([MIDDLES[2], MIDDLES[1], CORNERS[2]]),
        np.stack([MIDDLES[0], MIDDLES[1], MIDDLES[2]]),
    ]
)


def with_faces(model: RelightModel, num_faces: int) -> RelightModel:
    """The model cut until it has at least so many faces."""
    while len(model.mesh.faces) < num_faces:
        model = _cut_once(model)
    return model


def _cut_once(model: RelightModel) -> RelightModel:
    mesh, indirect = model.mesh, model.indirect
    edges = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    ends, middle = np.unique(edges, axis=0, return_inverse=True)
    middle = middle.reshape(-1, 3) + len(mesh.vertices)
    (a, b, c), (ab, bc, ca) = mesh.faces.T, middle.T
    faces = np.stack([np.stack(f, axis=1) for f in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))], axis=1)

    def extended(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, values[ends].mean(axis=1)]).astype(values.dtype)

    normals = extended(mesh.vertex_normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    num_vertices = len(mesh.vertices) + len(ends)
    finer = PatchMesh(
        vertices=extended(mesh.vertices),
        faces=faces.reshape(-1, 3).astype(np.int32),
        vertex_normals=normals,
        welded_vertex=np.arange(num_vertices, dtype=np.int32),
        parent_face=np.repeat(mesh.parent_face, 4),
        object_id=None if mesh.object_id is None else np.repeat(mesh.object_id, 4),
        corner_uvs=None,
        object_names=mesh.object_names,
        report=MeshReport(len(mesh.faces), 4 * len(mesh.faces)),
    )
    if indirect is not None and indirect.site == "vertex":
        indirect = replace(indirect, coefficients=extended(indirect.coefficients), ambient=extended(indirect.ambient))
    surfaces = replace(model.surfaces, surface_of_face=np.repeat(model.surfaces.surface_of_face, 4))
    pixels, unseen = _on_children(model.pixels), extended(model.albedo_unseen)
    return replace(model, mesh=finer, surfaces=surfaces, indirect=indirect, pixels=pixels, vertex_albedo=unseen)


def _on_children(pixels: PixelMap) -> PixelMap:
    """The captured points on the smaller faces."""
    weights = pixels.points.barycentric
    child = np.where((weights >= 0.5).any(axis=1), np.argmax(weights, axis=1), 3)
    inverse = np.linalg.inv(CHILDREN.transpose(0, 2, 1))  # columns: the children's corners
    local = np.einsum("pij,pj->pi", inverse[child], weights)
    face = (4 * pixels.points.face + child).astype(np.int32)
    return replace(pixels, points=replace(pixels.points, face=face, barycentric=local.astype(np.float32)))

"""glTF 2.0 and GLB, parsed by trimesh: node transforms applied, one label per material."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from relight3d.errors import MeshError
from relight3d.records import TriangleMesh


def read_gltf(path: Path) -> TriangleMesh:
    """Read a .gltf file with what it refers to, or a .glb. Lines and points are left out.

    UVs are kept for primitives that have a material. Raises MeshError for integer positions
    (KHR_mesh_quantization), or what trimesh raises.
    """
    from trimesh.exchange.gltf import load_glb, load_gltf
    from trimesh.resolvers import FilePathResolver

    load = load_glb if path.suffix.lower() == ".glb" else load_gltf
    with open(path, "rb") as file:
        scene: Any = load(file, resolver=FilePathResolver(str(path)))
    placed = _placed(scene)
    if not placed:
        raise MeshError(str(path), "no triangles", "at least one mesh of triangles in the scene")
    return _join(str(path), [(name, scene["geometry"][name], matrix) for name, matrix in placed])


def _placed(scene: Any) -> list[tuple[str, Float64[np.ndarray, "4 4"]]]:
    """Every use of a geometry and its world_from_mesh, in the file's order of geometries."""
    world_from_node = {scene["base_frame"]: np.eye(4)}
    placed = []
    for edge in scene["graph"]:  # parents come before their children
        matrix = world_from_node[edge["frame_from"]] @ edge["matrix"]
        world_from_node[edge["frame_to"]] = matrix
        if "faces" in scene["geometry"].get(edge.get("geometry"), {}):
            placed.append((edge["geometry"], matrix))
    rank = {name: i for i, name in enumerate(scene["geometry"])}
    return sorted(placed, key=lambda use: rank[use[0]])


def _join(field: str, parts: list[tuple[str, dict[str, Any], np.ndarray]]) -> TriangleMesh:
    labels: dict[str, int] = {}
    vertices, faces, normals, uvs, ids = [], [], [], [], []
    num_vertices = 0
    for name, geometry, matrix in parts:
        place = np.asarray(geometry["vertices"])
        if place.dtype.kind != "f":
            raise MeshError(field, "integer positions", "float positions", "export without KHR_mesh_quantization")
        face = np.asarray(geometry["faces"]).astype(np.int64).reshape(-1, 3)
        if face.size and face.max() >= len(place):
            raise MeshError(field, f"vertex index {face.max()} in {name}", f"indices below {len(place)}")
        if np.linalg.det(matrix[:3, :3]) < 0:
            face = face[:, [0, 2, 1]]  # a mirroring node turns the faces inside out
        visual = geometry.get("visual")
        uv = getattr(visual, "uv", None)
        label = labels.setdefault(getattr(getattr(visual, "material", None), "name", None) or name, len(labels))
        vertices.append(place.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3])
        faces.append(face + num_vertices)
        normals.append(_turned(geometry.get("vertex_normals"), matrix, len(place)))
        uvs.append(np.zeros((len(face), 3, 2)) if uv is None else np.asarray(uv)[face])
        ids.append(np.full(len(face), label))
        num_vertices += len(place)
    has_normals = any("vertex_normals" in geometry for _, geometry, _ in parts)
    has_uvs = any(getattr(geometry.get("visual"), "uv", None) is not None for _, geometry, _ in parts)
    return TriangleMesh(
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces).astype(np.int32),
        vertex_normals=np.concatenate(normals).astype(np.float32) if has_normals else None,
        corner_uvs=np.concatenate(uvs).astype(np.float32) if has_uvs else None,
        object_id=np.concatenate(ids).astype(np.int32),
        object_names={label: name for name, label in labels.items()},
    )


def _turned(normals: Any, matrix: np.ndarray, num_vertices: int) -> np.ndarray:
    """Unit normals under a node's transform; (0, 0, 0) where the primitive has none."""
    if normals is None:
        return np.zeros((num_vertices, 3))
    # The cofactors are the inverse transpose up to scale, and exist for a squashed node too.
    x, y, z = matrix[:3, :3]
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)])
    turned = np.asarray(normals, dtype=np.float64) @ cofactors.T * (np.sign(np.linalg.det(matrix[:3, :3])) or 1.0)
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    return turned / np.where(length > 0, length, 1.0)

"""PLY, ascii and binary: vertex normals, UVs and the face property `object_id`.

Names of labels travel in comments, `comment object_name 3 bronze mirror`, which other programs skip.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
from plyfile import PlyData, PlyParseError

from relight3d.errors import MeshError
from relight3d.maths.polygons import triangulate
from relight3d.records import PatchMesh, TriangleMesh

UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
NAME_COMMENT = re.compile(r"object_name (-?\d{1,10}) (.+)")
INDEX_NAMES = ("vertex_indices", "vertex_index")
# Lists known to be triangles are read at once; other faces row by row, some hundred times slower.
TRIANGLE_LISTS = {"vertex_indices": 3, "vertex_index": 3, "texcoord": 6}


def read_ply(path: Path) -> TriangleMesh:
    """Read a PLY file. Raises MeshError or what plyfile raises."""
    try:
        data = PlyData.read(str(path), known_list_len={"face": TRIANGLE_LISTS})
    except PlyParseError:
        data = PlyData.read(str(path))
    if "vertex" not in data or "face" not in data:
        found = ", ".join(element.name for element in data.elements) or "nothing"
        raise MeshError(str(path), found, "the elements vertex and face")
    vertex: Any = data["vertex"].data
    face: Any = data["face"].data
    vertices = _columns(vertex, ("x", "y", "z"), np.float64)
    assert vertices is not None
    corner_vertex, num_corners = _index_lists(face)
    in_range = (corner_vertex >= 0) & (corner_vertex < len(vertices))
    if not in_range.all():
        raise MeshError(str(path), f"vertex index {corner_vertex[~in_range][0]}", f"indices below {len(vertices)}")
    triangles, polygon = triangulate(vertices[corner_vertex], num_corners)
    return TriangleMesh(
        vertices=vertices,
        faces=corner_vertex[triangles].astype(np.int32),
        vertex_normals=_columns(vertex, ("nx", "ny", "nz"), np.float32),
        corner_uvs=_corner_uvs(vertex, face, corner_vertex, triangles),
        object_id=_object_id(str(path), face, polygon),
        object_names=_object_names(data.comments),
    )


def ply_bytes(mesh: TriangleMesh | PatchMesh) -> bytes:
    """The whole file, binary little endian."""
    corner_uvs = mesh.corner_uvs
    vertex_uvs = None if corner_uvs is None else _uvs_by_vertex(mesh.faces, corner_uvs, len(mesh.vertices))
    columns: list[tuple[str, str, np.ndarray]] = [(a, "<f8", mesh.vertices[:, i]) for i, a in enumerate("xyz")]
    if mesh.vertex_normals is not None:
        columns += [(f"n{a}", "<f4", mesh.vertex_normals[:, i]) for i, a in enumerate("xyz")]
    if vertex_uvs is not None:
        columns += [(a, "<f4", vertex_uvs[:, i]) for i, a in enumerate("st")]
    vertex = np.empty(len(mesh.vertices), dtype=[(name, kind) for name, kind, _ in columns])
    for name, _, values in columns:
        vertex[name] = values
    lines = [f"property {'double' if kind == '<f8' else 'float'} {name}" for name, kind, _ in columns]
    fields: list[tuple] = [("num", "u1"), ("vertex_indices", "<i4", (3,))]
    lists = ["property list uchar int vertex_indices"]
    if corner_uvs is not None and vertex_uvs is None:
        fields += [("num_uv", "u1"), ("texcoord", "<f4", (6,))]
        lists.append("property list uchar float texcoord")
    if mesh.object_id is not None:
        fields.append(("object_id", "<i4"))
        lists.append("property int object_id")
    face = np.empty(len(mesh.faces), dtype=fields)
    face["num"], face["vertex_indices"] = 3, mesh.faces
    if corner_uvs is not None and vertex_uvs is None:
        face["num_uv"], face["texcoord"] = 6, corner_uvs.reshape(-1, 6)
    if mesh.object_id is not None:
        face["object_id"] = mesh.object_id
    header = ["ply", "format binary_little_endian 1.0"]
    header += [f"comment object_name {key} {' '.join(name.split())}" for key, name in (mesh.object_names or {}).items()]
    header += [f"element vertex {len(vertex)}", *lines, f"element face {len(face)}", *lists, "end_header", ""]
    return "\n".join(header).encode("ascii", "replace") + vertex.tobytes() + face.tobytes()


def _columns(table: np.ndarray, names: tuple[str, ...], kind: type) -> np.ndarray | None:
    if not set(names) <= set(table.dtype.names or ()):
        if names == ("x", "y", "z"):
            raise ValueError("the vertices have no x, y, z")
        return None
    return np.stack([np.asarray(table[name]) for name in names], axis=1).astype(kind)


def _index_lists(face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All faces' vertices one after another, and how many each face has."""
    name = next((name for name in INDEX_NAMES if name in (face.dtype.names or ())), None)
    if name is None:
        raise ValueError("the faces have no list vertex_indices")
    lists = face[name]
    if lists.dtype != object:
        return np.asarray(lists, dtype=np.int64).reshape(-1), np.full(len(lists), 3, dtype=np.int64)
    flat = np.concatenate(lists) if len(lists) else np.empty(0)
    return flat.astype(np.int64), np.array([len(indices) for indices in lists], dtype=np.int64)


def _corner_uvs(
    vertex: np.ndarray, face: np.ndarray, corner_vertex: np.ndarray, triangles: np.ndarray
) -> np.ndarray | None:
    if "texcoord" in (face.dtype.names or ()):
        lists = face["texcoord"]
        flat = np.concatenate(lists) if lists.dtype == object and len(lists) else np.asarray(lists)
        if flat.size == 2 * corner_vertex.size:
            return flat.reshape(-1, 2)[triangles].astype(np.float32)
    for names in UV_NAMES:
        uvs = _columns(vertex, names, np.float32)
        if uvs is not None:
            return uvs[corner_vertex[triangles]]
    return None


def _object_id(field: str, face: np.ndarray, polygon: np.ndarray) -> np.ndarray | None:
    if "object_id" not in (face.dtype.names or ()):
        return None
    label = np.asarray(face["object_id"])[polygon]
    if label.dtype.kind == "f":
        if not (np.abs(label) < 2**31).all():
            raise MeshError(f"{field} object_id", "NaN or a value beyond 32 bits", "whole numbers")
        label = np.rint(label)
    return label.astype(np.int64).astype(np.int32)  # the unsigned "none" 4294967295 becomes -1


def _object_names(comments: list[str]) -> dict[int, str] | None:
    found = (NAME_COMMENT.fullmatch(comment) for comment in comments)
    return {int(match[1]): match[2] for match in found if match} or None


def _uvs_by_vertex(faces: np.ndarray, corner_uvs: np.ndarray, num_vertices: int) -> np.ndarray | None:
    """One UV per vertex, if all corners of each vertex agree."""
    uvs = np.zeros((num_vertices, 2), dtype=np.float32)
    uvs[faces.ravel()] = corner_uvs.reshape(-1, 2)
    return uvs if np.array_equal(uvs[faces], corner_uvs) else None

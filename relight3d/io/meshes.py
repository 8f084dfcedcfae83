"""Meshes from files and to files. Nothing is merged or mended here: that is recover/mesh.py's work.

The parsers are NumPy and pure Python, so that a corrupt file raises; native code never meets unchecked bytes.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from relight3d.errors import InputError, MeshError
from relight3d.io.files import write_bytes
from relight3d.io.mesh_gltf import read_gltf
from relight3d.io.mesh_obj import read_obj
from relight3d.io.mesh_ply import ply_bytes, read_ply
from relight3d.io.mesh_stl import read_stl
from relight3d.records import PatchMesh, TriangleMesh

READERS: dict[str, Callable[[Path], TriangleMesh]] = {
    ".ply": read_ply,
    ".obj": read_obj,
    ".stl": read_stl,
    ".gltf": read_gltf,
    ".glb": read_gltf,
}


def read_mesh(path: str | Path) -> TriangleMesh:
    """Read a PLY, OBJ, STL, glTF or GLB file: world coordinates in float64, polygons cut into triangles.

    Vertex normals, UVs and labels come along when the file has them. `object_id` is the PLY face property of that
    name, the OBJ material (or, in a file without any, the object and group), the glTF material (or mesh), the STL
    solid. Raises MeshError for a file that is missing, foreign, cut short, without faces, or inconsistent.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise MeshError(str(path), f"a {path.suffix or 'nameless'} file", "one of " + " ".join(READERS))
    try:
        mesh = reader(path)
    except MeshError:
        raise
    except OSError as error:
        raise MeshError(str(path), error.strerror or error, "a file that can be read") from error
    except Exception as error:  # a parser that meets arbitrary bytes may fail in any way; the file is to blame
        got = f"{type(error).__name__} ({error})"
        hint = "it may be cut short or of another format"
        raise MeshError(str(path), got, f"a well-formed {path.suffix[1:].upper()} file", hint) from error
    check_mesh(mesh, str(path))
    return mesh


def check_mesh(mesh: TriangleMesh, field: str) -> None:
    """Raise MeshError under `field` unless the mesh has faces, their indices exist, and the arrays agree in length.

    Single vertices may be NaN: cleaning drops their faces and says so.
    """
    num_vertices, num_faces = len(mesh.vertices), len(mesh.faces)
    if num_faces == 0:
        raise MeshError(field, "no faces", "at least one triangle", "a point cloud must be meshed first")
    low, high = int(mesh.faces.min()), int(mesh.faces.max())
    if low < 0 or high >= num_vertices:
        raise MeshError(field, f"vertex index {low if low < 0 else high}", f"indices from 0 to {num_vertices - 1}")
    if not np.isfinite(mesh.vertices[mesh.faces]).all(axis=(1, 2)).any():
        raise MeshError(field, "NaN or infinity in every face", "finite coordinates")
    lengths = (
        ("vertex_normals", mesh.vertex_normals, num_vertices),
        ("corner_uvs", mesh.corner_uvs, num_faces),
        ("object_id", mesh.object_id, num_faces),
    )
    for name, array, expected in lengths:
        if array is not None and len(array) != expected:
            raise MeshError(f"{field} {name}", f"{len(array)} entries", f"{expected}")


def write_mesh(path: str | Path, mesh: TriangleMesh | PatchMesh) -> None:
    """Write a binary PLY that read_mesh gives back equal: double vertices, normals, UVs, object_id and its names.

    UVs become the vertex properties s and t, or, where corners of one vertex differ, MeshLab's face list `texcoord`.
    Raises MeshError where the file cannot be written.
    """
    if Path(path).suffix.lower() != ".ply":
        raise MeshError(str(path), f"a {Path(path).suffix or 'nameless'} file", "a name that ends in .ply")
    try:
        write_bytes(path, ply_bytes(mesh))
    except MeshError:
        raise
    except InputError as error:
        raise MeshError(error.field, error.got, error.expected, error.hint) from error

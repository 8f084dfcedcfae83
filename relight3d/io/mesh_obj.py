"""Wavefront OBJ: positions, normals, UVs, and labels from materials, or from objects and groups without them.

The material file itself is not needed: only the names in `usemtl` are.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Int64

from relight3d.errors import MeshError
from relight3d.io.files import read_bytes
from relight3d.maths.polygons import triangulate
from relight3d.records import TriangleMesh

WINDOWS_NAN = re.compile(r"-?\d\.#(?:IND|INF|QNAN|SNAN)\w*")


@dataclass
class _Statements:
    """The file's statements as words, before any is understood."""

    positions: list[list[str]] = field(default_factory=list)
    uvs: list[list[str]] = field(default_factory=list)
    normals: list[list[str]] = field(default_factory=list)
    corners: list[str] = field(default_factory=list)
    num_corners: list[int] = field(default_factory=list)
    seen: list[tuple[int, int, int]] = field(default_factory=list)  # positions, UVs, normals before each face
    labels: list[tuple[str, str, str]] = field(default_factory=list)  # material, object, group of each face


def read_obj(path: Path) -> TriangleMesh:
    """Read an OBJ file. Raises MeshError for an index that does not exist, ValueError for words that are no numbers."""
    statements = _statements(read_bytes(path).decode("utf-8", "replace"))
    if not statements.corners:
        raise MeshError(str(path), "no faces", "at least one triangle")
    positions = np.array(statements.positions, dtype=np.float64).reshape(-1, 3)
    uvs = np.array([(row + ["0"])[:2] for row in statements.uvs], dtype=np.float32).reshape(-1, 2)
    normals = np.array(statements.normals, dtype=np.float32).reshape(-1, 3)
    num_corners = np.array(statements.num_corners, dtype=np.int64)
    index = _indices(str(path), statements, num_corners, (len(positions), len(uvs), len(normals)))
    triangles, polygon = triangulate(positions[index[:, 0]], num_corners)
    position, uv, normal = np.moveaxis(index[triangles], 2, 0)
    object_id, names = _labels(statements.labels, polygon)
    vertices, faces, vertex_normals = _split_by_normal(positions, position, normals, normal)
    return TriangleMesh(
        vertices=vertices,
        faces=faces,
        vertex_normals=vertex_normals,
        corner_uvs=_where_given(uvs, uv) if (uv >= 0).any() else None,
        object_id=object_id,
        object_names=names,
    )


def _statements(text: str) -> _Statements:
    found = _Statements()
    material = group = name = ""
    coordinates = {"v": found.positions, "vn": found.normals, "vt": found.uvs}
    if ".#" in text:
        text = WINDOWS_NAN.sub("nan", text)
    for line in text.replace("\\\r\n", " ").replace("\\\n", " ").split("\n"):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        key = words[0]
        if key in coordinates or key == "f":
            words = line.partition("#")[0].split()
        if key in coordinates:
            coordinates[key].append(words[1:4])
        elif key == "f":
            found.corners.extend(words[1:])
            found.num_corners.append(len(words) - 1)
            found.seen.append((len(found.positions), len(found.uvs), len(found.normals)))
            found.labels.append((material, name, group))
        elif key == "usemtl":
            material = " ".join(words[1:])
        elif key == "o":
            name = " ".join(words[1:])
        elif key == "g":
            group = " ".join(words[1:])
    return found


def _indices(
    path: str, statements: _Statements, num_corners: np.ndarray, limits: tuple[int, int, int]
) -> Int64[np.ndarray, "corner 3"]:
    """Position, UV and normal of each corner, from 0; -1 where a corner has none."""
    words = [int(word) if word else 0 for corner in statements.corners for word in (corner + "//").split("/")[:3]]
    index = np.array(words, dtype=np.int64).reshape(-1, 3)
    # Negative numbers count back from the last one read before the face.
    seen = np.repeat(np.array(statements.seen, dtype=np.int64), num_corners, axis=0)
    index = np.where(index < 0, index + seen, index - 1)
    for column, (kind, limit) in enumerate(zip(("vertex", "UV", "normal"), limits)):
        lowest = 0 if kind == "vertex" else -1
        bad = (index[:, column] < lowest) | (index[:, column] >= limit)
        if bad.any():
            raise MeshError(path, f"{kind} index {index[bad, column][0] + 1}", f"{kind} indices from 1 to {limit}")
    return index


def _labels(labels: list[tuple[str, str, str]], polygon: np.ndarray) -> tuple[np.ndarray | None, dict[int, str] | None]:
    """Materials if the file names any, else objects and groups; None where it names nothing."""
    if any(material for material, _, _ in labels):
        words = [material for material, _, _ in labels]
    else:
        words = [" / ".join(filter(None, label[1:])) for label in labels]
    number = {word: i for i, word in enumerate(dict.fromkeys(words))}
    if not any(words):
        return None, None
    names = {i: word or "unnamed" for word, i in number.items()}
    return np.array([number[word] for word in words], dtype=np.int32)[polygon], names


def _split_by_normal(
    positions: np.ndarray, position: np.ndarray, normals: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """One vertex for each pair of position and normal that a corner uses; (0, 0, 0) where a normal is missing."""
    if not (normal >= 0).any():
        return positions, position.astype(np.int32), None
    pairs, vertex = np.unique(position * (len(normals) + 1) + normal + 1, return_inverse=True)
    at, which = np.divmod(pairs, len(normals) + 1)
    return positions[at], vertex.reshape(position.shape).astype(np.int32), _where_given(normals, which - 1)


def _where_given(values: np.ndarray, index: np.ndarray) -> np.ndarray:
    taken = values[np.maximum(index, 0)]
    taken[index < 0] = 0.0
    return taken

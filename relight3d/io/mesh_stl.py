"""STL, binary and ascii. Every face brings three vertices of its own; cleaning welds them."""

import re
from pathlib import Path

import numpy as np

from relight3d.errors import MeshError
from relight3d.io.files import read_bytes
from relight3d.records import TriangleMesh

RECORD = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER_BYTES = 84
SOLID = re.compile(rb"^[ \t]*solid\b[ \t]*([^\r\n]*)", re.IGNORECASE | re.MULTILINE)
VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
FACET = re.compile(rb"\bfacet\b(?=\s+normal)", re.IGNORECASE)
END = re.compile(rb"^[ \t]*endsolid\b", re.IGNORECASE | re.MULTILINE)


def read_stl(path: Path) -> TriangleMesh:
    """Read an STL file. Raises MeshError for one that is cut short."""
    data = read_bytes(path)
    num_faces = int.from_bytes(data[80:HEADER_BYTES], "little") if len(data) >= HEADER_BYTES else -1
    # Many binary files start with "solid" too, so the length decides.
    if len(data) == HEADER_BYTES + num_faces * RECORD.itemsize:
        corners = np.frombuffer(data, RECORD, offset=HEADER_BYTES)["corners"].astype(np.float64)
        return _mesh(corners, None, None)
    if SOLID.match(data) and FACET.search(data):
        return _read_ascii(path, data)
    expected = f"{HEADER_BYTES + num_faces * RECORD.itemsize} bytes for {num_faces} faces"
    raise MeshError(str(path), f"{len(data)} bytes", expected if num_faces >= 0 else "an STL file", "is it cut short?")


def _read_ascii(path: Path, data: bytes) -> TriangleMesh:
    solids = list(SOLID.finditer(data))
    ends = [match.start() for match in END.finditer(data)]
    text = [match.groups() for match in VERTEX.finditer(data)]
    facet_at = np.array([match.start() for match in FACET.finditer(data)])
    if len(text) != 3 * len(facet_at) or len(ends) != len(solids):
        got = f"{len(facet_at)} facets, {len(text)} vertices, {len(solids)} solids and {len(ends)} ends"
        raise MeshError(str(path), got, "three vertices a facet and one endsolid a solid", "it may be cut short")
    corners = np.array(text, dtype="S32").astype(np.float64).reshape(-1, 3, 3)
    if len(solids) == 1:
        return _mesh(corners, None, None)
    solid = np.searchsorted([match.start() for match in solids], facet_at) - 1
    names = {i: match[1].decode("utf-8", "replace").strip() or f"solid {i}" for i, match in enumerate(solids)}
    return _mesh(corners, solid.astype(np.int32), names)


def _mesh(corners: np.ndarray, object_id: np.ndarray | None, names: dict[int, str] | None) -> TriangleMesh:
    faces = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return TriangleMesh(corners.reshape(-1, 3), faces, object_id=object_id, object_names=names)

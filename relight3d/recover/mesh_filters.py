"""The filters of pymeshlab, arrays in and arrays out. The only module that knows it.

It checks little and would let NaN pass or index anywhere, so it is given clean faces only: finite coordinates of about
unit size, indices in range, three different corners a face (mesh_repair.py sees to that). Rows are followed through a
filter by a number on each face, which every filter used here copies exactly.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64, Int32

MAX_PASSES = 200  # a pass splits at least the longest edges; more passes than this is a bug


@dataclass(frozen=True, eq=False)
class Subdivision:
    """Smaller faces, and where each corner lies in the face it came from."""

    points: Float64[np.ndarray, "vertex 3"]
    given: Int32[np.ndarray, " vertex"]  # number among the given vertices, which come first; -1 for a new one
    faces: Int32[np.ndarray, "face 3"]  # the parts of a face stand together
    row: Int32[np.ndarray, " face"]  # which of the given faces
    weights: Float64[np.ndarray, "face corner 3"]  # of that face's corners, for each corner: exact sums of halves


def flip_folds(
    points: Float64[np.ndarray, "vertex 3"], faces: Int32[np.ndarray, "face 3"]
) -> Int32[np.ndarray, "face 3"]:
    """Unfold single faces that lie back on a neighbour (normals 175 degrees apart or more), by turning one edge.

    Coherently wound faces. Rows stay; two rows change for each fold.
    """
    meshes = _mesh_set(points, faces)
    meshes.meshing_remove_folded_faces()
    unfolded = meshes.current_mesh().face_matrix()
    assert np.array_equal(_rows(meshes), np.arange(len(faces))), "unfolding lost faces"
    return unfolded.astype(np.int32)


def without_high_frequencies(
    points: Float64[np.ndarray, "vertex 3"], faces: Int32[np.ndarray, "face 3"], num_steps: int
) -> Float64[np.ndarray, "vertex 3"]:
    """The points after so many steps of Taubin's two Laplacians, which keep the volume (Taubin 1995)."""
    meshes = _mesh_set(points, faces)
    meshes.apply_coord_taubin_smoothing(lambda_=0.5, mu=-0.53, stepsmoothnum=num_steps)
    smooth = meshes.current_mesh().vertex_matrix()
    assert smooth.shape == points.shape, "smoothing lost vertices"
    return smooth


def subdivide(
    points: Float64[np.ndarray, "vertex 3"],
    faces: Int32[np.ndarray, "face 3"],
    next_threshold: Callable[[Float64[np.ndarray, "face 3"]], float | None],
) -> Subdivision:
    """Split edges at their middles, pass by pass: those longer than `next_threshold(edge lengths)`, until it is None.

    No edge of three faces. An edge's length alone decides, so two faces that meet without sharing vertices (at a
    crease, a seam) are split alike and no crack opens.
    """
    threshold = next_threshold(_edge_lengths(points, faces))
    if threshold is None:
        own, rows = np.arange(len(points), dtype=np.int32), np.arange(len(faces), dtype=np.int32)
        return Subdivision(points, own, faces, rows, np.tile(np.eye(3), (len(faces), 1, 1)))
    # Barycentric weights travel as texture coordinates: their halves and sums are exact, unlike a later projection.
    corners = np.tile(np.eye(3)[:, :2], (len(faces), 1))
    meshes = _mesh_set(points, faces, w_tex_coords_matrix=corners)
    for _ in range(MAX_PASSES):
        _midpoint(meshes, threshold)
        mesh = meshes.current_mesh()
        threshold = next_threshold(_edge_lengths(mesh.vertex_matrix(), mesh.face_matrix()))
        if threshold is None:
            break
    assert threshold is None, f"no end to subdivision after {MAX_PASSES} passes"
    mesh, row = meshes.current_mesh(), _rows(meshes)
    order = np.argsort(row, kind="stable")
    two = mesh.wedge_tex_coord_matrix().reshape(-1, 3, 2)[order]
    given = np.full(mesh.vertex_number(), -1, dtype=np.int32)
    given[: len(points)] = np.arange(len(points))
    return Subdivision(
        points=mesh.vertex_matrix(),
        given=given,
        faces=mesh.face_matrix()[order].astype(np.int32),
        row=row[order].astype(np.int32),
        weights=np.concatenate([two, 1.0 - two.sum(axis=2, keepdims=True)], axis=2),
    )


def _edge_lengths(points: np.ndarray, faces: np.ndarray) -> Float64[np.ndarray, "face 3"]:
    place = points[faces]
    return np.linalg.norm(np.roll(place, -1, axis=1) - place, axis=2)


def _midpoint(meshes: Any, threshold: float) -> None:
    from pymeshlab import PureValue

    before = meshes.current_mesh().face_number()
    meshes.meshing_surface_subdivision_midpoint(iterations=1, threshold=PureValue(threshold))
    assert meshes.current_mesh().face_number() > before, f"no edge longer than {threshold}"


def _mesh_set(points: np.ndarray, faces: np.ndarray, **attributes: np.ndarray) -> Any:
    import pymeshlab  # 0.4 s, and not needed by those who only render

    if not hasattr(pymeshlab.MeshSet, "meshing_surface_subdivision_midpoint"):
        raise ImportError("pymeshlab has come without its filters: install OpenGL (on Debian the package libopengl0)")
    meshes = pymeshlab.MeshSet(verbose=False)
    number = np.arange(1.0, len(faces) + 1)  # from 1, since a face that a filter made up has 0
    meshes.add_mesh(pymeshlab.Mesh(points, faces, f_scalar_array=number, **attributes))
    return meshes


def _rows(meshes: Any) -> np.ndarray:
    return meshes.current_mesh().face_scalar_array().astype(np.int64) - 1

"""Small procedural meshes with normals and UVs, for scenes whose truth is known. Lengths in the scene's unit."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int32

from relight3d.errors import InputError
from relight3d.records import TriangleMesh


def plane(width: float, depth: float, num_columns: int = 1, num_rows: int = 1) -> TriangleMesh:
    """A rectangle about the origin in the plane z = 0 that faces up; its UVs cover the unit square."""
    u, v = np.meshgrid(np.linspace(0, 1, num_columns + 1), np.linspace(0, 1, num_rows + 1))
    uvs = np.stack([u.ravel(), v.ravel()], axis=1)
    faces = _grid_faces(num_columns, num_rows)
    vertices = np.column_stack([(uvs - 0.5) * (width, depth), np.zeros(len(uvs))])
    normals = np.broadcast_to(np.array([0, 0, 1], np.float32), vertices.shape).copy()
    return TriangleMesh(vertices, faces, normals, uvs[faces].astype(np.float32))


def box(width: float, depth: float, height: float, num_cells: int = 1) -> TriangleMesh:
    """A closed box about the origin; each side has its own vertices and normal, and the whole unit square of UVs."""
    x_up = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], np.float64)  # takes the plane's x y z to y z x
    y_up = x_up @ x_up
    half_turn = np.diag([1.0, -1.0, -1.0])
    sides = []
    for turn, size in (
        (np.eye(3), (width, depth, height)),
        (x_up, (depth, height, width)),
        (y_up, (height, width, depth)),
    ):
        top = plane(size[0], size[1], num_cells, num_cells)
        lifted = replace(top, vertices=top.vertices + (0, 0, size[2] / 2))
        sides += [transformed(lifted, turn), transformed(lifted, turn @ half_turn)]
    return replace(joined({str(i): side for i, side in enumerate(sides)}), object_id=None, object_names=None)


def sphere(radius: float, num_rows: int = 16) -> TriangleMesh:
    """A UV sphere about the origin with smooth outward normals; the seam has its vertices twice."""
    columns = 2 * num_rows
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, num_rows + 1)))
    azimuth, polar = 2 * np.pi * u, np.pi * (1 - v)
    normals = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
    faces = _grid_faces(columns, num_rows)
    # At each pole one triangle of every cell has no area.
    row = np.arange(num_rows).repeat(columns)
    faces = np.concatenate([faces[: len(row)][row > 0], faces[len(row) :][row < num_rows - 1]])
    uvs = np.stack([u, v], axis=1).astype(np.float32)
    return TriangleMesh(radius * normals, faces, normals.astype(np.float32), uvs[faces])


def transformed(
    mesh: TriangleMesh,
    rotation: Float[np.ndarray, "3 3"] | None = None,
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> TriangleMesh:
    """The mesh turned, then moved."""
    turn = np.eye(3) if rotation is None else np.asarray(rotation, np.float64)
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-9) or np.linalg.det(turn) < 0:
        raise InputError("rotation", turn.tolist(), "a rotation matrix", "mirroring would turn the faces inside out")
    normals = mesh.vertex_normals
    return replace(
        mesh,
        vertices=mesh.vertices @ turn.T + translation,
        vertex_normals=None if normals is None else (normals @ turn.T).astype(np.float32),
    )


def turn_about(axis: str, angle_deg: float) -> Float[np.ndarray, "3 3"]:
    """The rotation about "x", "y" or "z", counter-clockwise when looking down the axis."""
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    cosine, sine = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    turn = np.eye(3)
    turn[[first, second], [first, second]] = cosine
    turn[second, first], turn[first, second] = sine, -sine
    return turn


def joined(parts: Mapping[str, TriangleMesh]) -> TriangleMesh:
    """One mesh of several with normals and UVs; `object_id` counts them in order, `object_names` keeps their names."""
    meshes = list(parts.values())
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    normals, uvs = [m.vertex_normals for m in meshes], [m.corner_uvs for m in meshes]
    return TriangleMesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        faces=np.concatenate([mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts, strict=True)]),
        vertex_normals=np.concatenate([n for n in normals if n is not None]),
        corner_uvs=np.concatenate([u for u in uvs if u is not None]),
        object_id=np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes]).astype(np.int32),
        object_names=dict(enumerate(parts)),
    )


def _grid_faces(num_columns: int, num_rows: int) -> Int32[np.ndarray, "face 3"]:
    """Two counter-clockwise triangles a cell; first every cell's lower one, then the upper ones."""
    row, column = (a.ravel() for a in np.mgrid[0:num_rows, 0:num_columns])
    low = row * (num_columns + 1) + column
    high = low + num_columns + 1
    lower, upper = np.stack([low, low + 1, high + 1], 1), np.stack([low, high + 1, high], 1)
    return np.concatenate([lower, upper]).astype(np.int32)

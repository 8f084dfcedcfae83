"""Meshes of which everything is known: a grid, a cube, a ball, a Moebius strip."""

import numpy as np

from relight3d.records import TriangleMesh


def join(*meshes: TriangleMesh) -> TriangleMesh:
    """One mesh of several without attributes; the faces of the k-th have the label k."""
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return TriangleMesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, offsets)]).astype(np.int32),
        object_id=np.repeat(np.arange(len(meshes), dtype=np.int32), [len(mesh.faces) for mesh in meshes]),
    )


def grid(size: int = 4, extent: float = 1.0) -> TriangleMesh:
    """A square in the plane z = 0 that faces up, of 2 * size * size right triangles."""
    x, y = np.meshgrid(*[np.linspace(0, extent, size + 1)] * 2, indexing="ij")
    number = np.arange((size + 1) ** 2).reshape(size + 1, size + 1)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.stack([np.column_stack([a, b, c]), np.column_stack([a, c, d])], axis=1).reshape(-1, 3)
    return TriangleMesh(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]), faces.astype(np.int32))


def cube(size: float = 1.0, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> TriangleMesh:
    """A closed cube of 8 vertices and 12 faces that face outward, with its lowest corner at `at`."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([[q[i] for i in cut] for q in quads for cut in ((0, 1, 2), (0, 2, 3))], dtype=np.int32)
    return TriangleMesh(corners * size + np.array(at), faces)


def ball(rings: int = 12, radius: float = 1.0, with_normals: bool = False) -> TriangleMesh:
    """A closed sphere about the origin, one vertex at each pole."""
    polar, around = np.linspace(0, np.pi, rings + 1)[1:-1], np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    p, a = np.meshgrid(polar, around, indexing="ij")
    middle = np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=-1).reshape(-1, 3)
    directions = np.concatenate([[[0.0, 0, 1]], middle, [[0.0, 0, -1]]])
    number = 1 + np.arange(len(middle)).reshape(rings - 1, 2 * rings)
    last = len(directions) - 1
    top, bottom = number[0], number[-1]
    faces = [np.column_stack([np.zeros_like(top), top, np.roll(top, -1)])]
    faces.append(np.column_stack([np.full_like(bottom, last), np.roll(bottom, -1), bottom]))
    a, b = number[:-1].ravel(), number[1:].ravel()
    c, d = np.roll(number[1:], -1, axis=1).ravel(), np.roll(number[:-1], -1, axis=1).ravel()
    faces += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    normals = directions.astype(np.float32) if with_normals else None
    return TriangleMesh(directions * radius, np.concatenate(faces).astype(np.int32), normals)


def moebius(num: int = 40) -> TriangleMesh:
    """A strip of 2 * num faces with one side."""
    turn = np.arange(num) / num * 2 * np.pi
    edge = [
        np.column_stack([(1 + w * np.cos(turn / 2)) * np.cos(turn), (1 + w * np.cos(turn / 2)) * np.sin(turn)])
        for w in (-0.3, 0.3)
    ]
    height = [w * np.sin(turn / 2) for w in (-0.3, 0.3)]
    vertices = np.concatenate([np.column_stack([e, h]) for e, h in zip(edge, height)])
    here, ahead = np.arange(num), (np.arange(num) + 1) % num
    is_last = ahead == 0
    low, high = np.where(is_last, num, ahead), np.where(is_last, 0, ahead + num)
    faces = np.concatenate([np.column_stack([here, low, high]), np.column_stack([here, high, here + num])])
    return TriangleMesh(vertices, faces.astype(np.int32))

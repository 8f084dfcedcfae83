"""Index arrays against shapes whose edges and vertices can be counted by hand."""

import numpy as np
import pytest

from relight3d.maths import topology
from tests.shapes import ball, cube, grid, moebius


def normals_of(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    normal = np.cross(b - a, c - a)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def test_a_closed_surface_has_two_faces_at_every_edge():
    edges = topology.shared_edges(cube().faces)
    assert len(edges.pairs) == 18  # Euler: 8 - 18 + 12 = 2
    assert edges.is_manifold.all() and edges.is_coherent.all()
    assert edges.num_boundary == edges.num_non_manifold == 0
    assert (edges.pairs[:, 0] < edges.pairs[:, 1]).all()


def test_sides_name_the_shared_edge():
    faces = ball(5).faces
    edges = topology.shared_edges(faces)
    ends = [
        np.stack([faces[face, side], faces[face, (side + 1) % 3]], axis=1)
        for face, side in zip(edges.pairs.T, edges.sides.T)
    ]
    assert (ends[0] == ends[1][:, ::-1]).all()


def test_an_edge_of_three_faces_gives_three_pairs():
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]], dtype=np.int32)
    edges = topology.shared_edges(faces)
    assert edges.pairs.tolist() == [[0, 1], [1, 2], [0, 2]]
    assert edges.is_coherent.tolist() == [True, True, False]
    assert not edges.is_manifold.any()
    assert (edges.num_non_manifold, edges.num_boundary) == (1, 6)


def test_an_edge_of_a_thousand_faces_does_not_give_half_a_million_pairs():
    number = np.arange(1000)
    faces = np.column_stack([number * 0, number * 0 + 1, number + 2]).astype(np.int32)
    assert len(topology.face_adjacency(faces)) < 1000 * topology.MAX_PAIRS_PER_SIDE


def test_split_non_manifold_leaves_no_edge_of_three_faces():
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 2, 5]], dtype=np.int32)
    split, source = topology.split_non_manifold(faces)
    assert topology.shared_edges(split).num_non_manifold == 0
    assert (source[split] == faces).all()


def test_split_non_manifold_leaves_a_good_surface_alone():
    mesh = ball(6)
    split, source = topology.split_non_manifold(mesh.faces)
    assert (split == mesh.faces).all() and (source == np.arange(len(mesh.vertices))).all()


def test_dihedral_angles_of_a_cube():
    mesh = cube()
    angles = topology.dihedral_angles(normals_of(mesh), topology.face_adjacency(mesh.faces))
    # 12 edges at 90 degrees, and a flat diagonal on each of 6 sides. arctan2: exact to rounding at both.
    assert np.sort(angles) == pytest.approx([0.0] * 6 + [np.pi / 2] * 12, abs=1e-12)


def test_vertex_neighbours_of_a_cube():
    graph = topology.vertex_neighbours(cube().faces, 8)
    assert graph.nnz == 36 and (graph.data == 1).all()
    assert abs(graph - graph.T).nnz == 0 and graph.diagonal().sum() == 0


def test_corner_angles_of_a_triangle_add_up():
    mesh = ball(7)
    assert topology.corner_angles(mesh.vertices, mesh.faces).sum(axis=1) == pytest.approx(np.pi, abs=1e-12)


@pytest.mark.parametrize("crease_deg, fans", [(30.0, 24), (100.0, 8)])
def test_corner_fans_of_a_cube(crease_deg, fans):
    mesh = cube()
    edges = topology.shared_edges(mesh.faces)
    is_smooth = topology.dihedral_angles(normals_of(mesh), edges.pairs) <= np.deg2rad(crease_deg)
    fan = topology.corner_fans(mesh.faces, edges, is_smooth)
    assert len(np.unique(fan)) == fans
    # A fan never joins two vertices.
    assert len(np.unique(np.column_stack([fan.ravel(), mesh.faces.ravel()]), axis=0)) == fans


def test_coherent_flips_undo_random_ones():
    mesh, rng = ball(8), np.random.default_rng(0)
    is_wrong = rng.random(len(mesh.faces)) < 0.4
    faces = np.where(is_wrong[:, None], mesh.faces[:, ::-1], mesh.faces)
    flips, component, is_orientable = topology.coherent_flips(len(faces), topology.shared_edges(faces))
    assert is_orientable.tolist() == [True] and (component == 0).all()
    assert (flips == is_wrong).all() or (flips == ~is_wrong).all()


def test_a_moebius_strip_cannot_be_oriented():
    faces = moebius().faces
    flips, _, is_orientable = topology.coherent_flips(len(faces), topology.shared_edges(faces))
    assert is_orientable.tolist() == [False] and not flips.any()


def test_weld_takes_the_lowest_number():
    points = np.array([[1.0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1e-7, 0], [-0.0, 0, 0]])
    assert topology.weld(points, 0.0).tolist() == [0, 1, 0, 3, 1]
    assert topology.weld(points, 1e-6).tolist() == [0, 1, 0, 1, 1]


def test_weld_keeps_a_chain_of_near_points_apart():
    chain = np.column_stack([np.arange(100) * 0.8e-6, np.zeros(100), np.zeros(100)])
    pair = np.array([[5.0, 0, 0], [5, 0.8e-6, 0]])
    first = topology.weld(np.concatenate([chain, pair]), 1e-6)
    assert first[:100].tolist() == list(range(100)) and first[100:].tolist() == [100, 100]


def test_repeated_faces_in_any_order_of_corners():
    faces = np.array([[0, 1, 2], [3, 1, 2], [2, 0, 1], [1, 0, 2], [3, 2, 1]], dtype=np.int32)
    assert topology.repeated_faces(faces).tolist() == [False, False, True, True, True]


def test_no_faces_have_no_edges():
    assert len(topology.face_adjacency(np.empty((0, 3), dtype=np.int32))) == 0
    assert len(topology.face_adjacency(grid(1).faces[:1])) == 0

"""Cleaning leaves a good mesh alone and counts what it mends; subdivision keeps surface and labels exact."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.errors import InputError, MeshError
from relight3d.evaluate.shapes import sphere
from relight3d.maths import topology
from relight3d.records import TriangleMesh
from relight3d.recover.mesh import MeshOptions, prepare_mesh
from tests.shapes import ball, cube, grid, join, moebius

ONLY_CLEAN = MeshOptions(target_faces=0)


def with_faces(mesh, faces):
    return TriangleMesh(mesh.vertices, np.asarray(faces, dtype=np.int32))


def flat_cube():
    """A cube of 24 vertices with its sides' normals."""
    mesh = cube()
    vertices = mesh.vertices[mesh.faces.reshape(6, 6)[:, [0, 1, 2, 5]]]
    normal = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    faces = np.arange(6)[:, None, None] * 4 + np.array([[0, 1, 2], [0, 2, 3]])
    normals = np.repeat(normal, 4, axis=0).astype(np.float32)
    return TriangleMesh(vertices.reshape(-1, 3), faces.reshape(-1, 3).astype(np.int32), normals)


def area_by_parent(mesh, num_parents):
    return np.bincount(mesh.parent_face, mesh.face_areas, minlength=num_parents)


def areas_of(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


# ---------------------------------------------------------------------------------------- good meshes


@pytest.mark.parametrize(
    "mesh", [flat_cube(), ball(9, with_normals=True), join(ball(5), grid(3))], ids=["cube", "ball", "two parts"]
)
def test_a_good_mesh_passes_as_it_is(mesh):
    patch = prepare_mesh(mesh, ONLY_CLEAN)
    assert dict(patch.report.changes) == {}
    assert np.array_equal(patch.vertices, mesh.vertices) and np.array_equal(patch.faces, mesh.faces)
    assert np.array_equal(patch.parent_face, np.arange(len(mesh.faces)))
    if mesh.vertex_normals is not None:
        assert np.array_equal(patch.vertex_normals, mesh.vertex_normals)


def test_a_uv_seam_is_not_a_duplicate():
    mesh, rng = flat_cube(), np.random.default_rng(0)
    smooth = np.repeat(np.array([[0.0, 0.0, 1.0]], np.float32), 24, axis=0)
    uvs = rng.random((24, 2)).astype(np.float32)[mesh.faces]
    patch = prepare_mesh(TriangleMesh(mesh.vertices, mesh.faces, smooth, uvs), replace(ONLY_CLEAN, orient=False))
    assert dict(patch.report.changes) == {} and len(patch.vertices) == 24
    assert patch.welded_vertex.max() == 7


def test_a_room_seen_from_inside_stays_inside_out():
    room = cube()
    patch = prepare_mesh(with_faces(room, room.faces[:, ::-1]), ONLY_CLEAN)
    assert dict(patch.report.changes) == {}
    assert ((patch.vertices[patch.faces].mean(axis=1) - 0.5) * patch.face_normals).sum(axis=1).max() < 0


def test_thin_and_disconnected_parts_survive():
    sheet = cube()
    sheet.vertices[:, 2] *= 1e-4  # a plate of a tenth of a millimetre on a metre
    sheet_of_two = grid(1)
    sheet_of_two.vertices[:, 2] = 2e-4  # another tenth of a millimetre above it
    patch = prepare_mesh(join(sheet, cube(1e-3, (3, 0, 0)), cube(1e-4, (0, 3, 0)), sheet_of_two), ONLY_CLEAN)
    assert dict(patch.report.changes) == {} and np.bincount(patch.object_id).tolist() == [12, 12, 12, 2]


def test_a_wall_that_meets_a_floor_keeps_all_faces():
    floor = grid(2)
    wall = [[1, 4, 9], [4, 10, 9]]
    vertices = np.concatenate([floor.vertices, floor.vertices[[1, 4]] + [0, 0, 1]])
    patch = prepare_mesh(TriangleMesh(vertices, np.concatenate([floor.faces, wall]).astype(np.int32)), ONLY_CLEAN)
    assert dict(patch.report.changes) == {"edges_non_manifold": 1}
    assert len(patch.faces) == 10 and topology.shared_edges(patch.faces).num_non_manifold == 0
    assert topology.shared_edges(patch.welded_vertex[patch.faces]).num_non_manifold == 1


# ----------------------------------------------------------------------------------------- bad meshes


def test_duplicate_faces_keep_the_first_and_its_label():
    faces = grid(3).faces
    extra = [faces[2], faces[5][[1, 2, 0]], faces[7][::-1]]
    mesh = with_faces(grid(3), np.concatenate([faces, extra]))
    labels = np.append(np.zeros(len(faces)), [1, 1, 1]).astype(np.int32)
    patch = prepare_mesh(replace(mesh, object_id=labels), ONLY_CLEAN)
    assert dict(patch.report.changes) == {"faces_duplicate": 3}
    assert np.array_equal(patch.faces, faces) and (patch.object_id == 0).all()


def test_faces_without_area_go():
    flat = [[0, 0, 1], [0, 4, 8], [2, 2, 2]]  # a repeated corner, three on a line, a point
    mesh = with_faces(grid(2), np.concatenate([grid(2).faces, flat]))
    mesh.vertices[:] = mesh.vertices[:, [2, 0, 1]] * np.pi  # so that the line is one up to rounding only
    patch = prepare_mesh(mesh, ONLY_CLEAN)
    assert dict(patch.report.changes) == {"faces_zero_area": 3} and len(patch.faces) == 8


def test_faces_at_nan_and_unused_vertices_go():
    mesh = grid(3)
    vertices = np.concatenate([mesh.vertices, [[np.inf, 0, 0], [1e9, 1e9, 1e9]]])  # the last is far off, and unused
    vertices[5] = np.nan
    patch = prepare_mesh(TriangleMesh(vertices, mesh.faces), ONLY_CLEAN)
    assert dict(patch.report.changes) == {"faces_not_finite": 6, "vertices_unused": 4}  # with the corner beside
    assert np.isfinite(patch.vertices).all() and len(patch.faces) == 12


def test_a_soup_is_welded():
    soup = ball(6)
    vertices = soup.vertices[soup.faces].reshape(-1, 3)
    rng = np.random.default_rng(0)
    vertices += rng.uniform(-1e-7, 1e-7, vertices.shape)  # one place, several roundings
    faces = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
    patch = prepare_mesh(TriangleMesh(vertices, faces), MeshOptions(target_faces=0, crease_angle_deg=180.0))
    assert len(patch.vertices) == len(soup.vertices) == patch.welded_vertex.max() + 1
    assert topology.shared_edges(patch.faces).num_boundary == 0
    assert patch.report.changes["vertices_merged"] == len(vertices) - len(soup.vertices)


def test_flipped_faces_turn_to_the_majority():
    mesh, wrong = ball(8), [3, 50, 51, 100]
    faces = mesh.faces.copy()
    faces[wrong] = faces[wrong][:, ::-1]
    faces[0] = faces[0][::-1]  # the first face is no better a judge than another
    patch = prepare_mesh(with_faces(mesh, faces), ONLY_CLEAN)
    assert dict(patch.report.changes) == {"faces_flipped": 5}
    assert (patch.face_normals * patch.vertices[patch.faces].mean(axis=1)).sum(axis=1).min() > 0


def test_vertex_normals_judge_the_winding():
    mesh = ball(8, with_normals=True)
    inside_out = replace(mesh, faces=np.ascontiguousarray(mesh.faces[:, ::-1]))
    patch = prepare_mesh(inside_out, ONLY_CLEAN)
    assert dict(patch.report.changes) == {"faces_flipped": len(mesh.faces)}
    assert (patch.face_normals * patch.vertices[patch.faces].mean(axis=1)).sum(axis=1).min() > 0


def test_a_face_that_its_normals_confirm_is_never_turned():
    two = with_faces(grid(1), [[0, 2, 3], [0, 1, 3]])  # the second faces down, and its own normals say so
    vertices = two.vertices[two.faces].reshape(-1, 3)
    normals = np.repeat(np.array([[0, 0, 1], [0, 0, -1]], dtype=np.float32), 3, axis=0)
    patch = prepare_mesh(TriangleMesh(vertices, np.arange(6, dtype=np.int32).reshape(2, 3), normals), ONLY_CLEAN)
    assert dict(patch.report.changes) == {}
    assert patch.face_normals[:, 2].tolist() == [1, -1]


def test_a_moebius_strip_is_named_and_kept():
    patch = prepare_mesh(moebius(), MeshOptions(target_faces=1000))
    assert patch.report.changes["components_not_orientable"] == 1 and "faces_flipped" not in patch.report.changes
    assert any("cannot be oriented" in note for note in patch.report.notes)
    # The seam is a crease, and stays closed: one boundary goes around the strip.
    edges = topology.shared_edges(patch.welded_vertex[patch.faces])
    assert edges.num_non_manifold == 0 and (~edges.is_coherent).sum() > 0


def folded_kite():
    """A kite of four faces about the edge 01. Face 012 lies back on 041: vertex 2 is on the wrong side of the edge."""
    vertices = np.array([[0, 0, 0], [4, 0, 0], [2, -0.5, 0], [2, 3, 0], [2, -3, 0]], dtype=np.float64)
    return TriangleMesh(vertices, np.array([[0, 1, 2], [0, 2, 3], [1, 3, 2], [0, 4, 1]], dtype=np.int32))


def test_a_folded_face_is_unfolded():
    kite = folded_kite()
    uvs = kite.vertices[kite.faces][..., :2].astype(np.float32)
    patch = prepare_mesh(replace(kite, corner_uvs=uvs), ONLY_CLEAN)
    assert dict(patch.report.changes) == {"faces_unfolded": 2}
    assert patch.face_normals[:, 2].tolist() == [1, 1, 1, 1]
    assert patch.face_areas.sum() == pytest.approx(12.0)  # the outline 0413, covered once; 12.0 + 2 * 1.0 before
    assert np.array_equal(patch.corner_uvs, patch.vertices[patch.faces][..., :2].astype(np.float32))


def test_no_label_crosses_a_fold():
    labels = np.array([0, 1, 1, 2], dtype=np.int32)
    kite = replace(folded_kite(), object_id=labels)
    patch = prepare_mesh(kite, ONLY_CLEAN)
    assert dict(patch.report.changes) == {}
    assert np.array_equal(patch.vertices[patch.faces], kite.vertices[kite.faces])
    assert np.array_equal(patch.object_id, labels)


def test_bad_normals_are_replaced_by_computed_ones():
    mesh = ball(20, with_normals=True)
    mesh.vertex_normals[[3, 100, 200]] = np.array([[0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 0]], dtype=np.float32)
    mesh.vertex_normals[300] *= 7
    patch = prepare_mesh(mesh, ONLY_CLEAN)
    assert dict(patch.report.changes) == {"normals_repaired": 3}
    # The mean of the faces about a vertex of a 9-degree mesh is off by a fraction of a degree.
    cosine = (patch.vertex_normals * patch.vertices).sum(axis=1)
    assert cosine.min() > np.cos(np.deg2rad(1.0))


@pytest.mark.parametrize(
    "vertices, faces, line",
    [
        (np.zeros((3, 3)), [[0, 1, 2]], "without area"),
        (np.full((3, 3), np.nan), [[0, 1, 2]], "NaN"),
        (np.eye(3), [[0, 1, 3]], "index 3"),
        (np.eye(3), [[0, 1, -1]], "index -1"),
        (np.eye(3), np.empty((0, 3)), "no faces"),
        (np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2.0]]), [[0, 1, 2]], "without area"),
    ],
)
def test_a_hopeless_mesh_is_one_clear_line(vertices, faces, line):
    with pytest.raises(MeshError, match=line) as caught:
        prepare_mesh(TriangleMesh(vertices, np.asarray(faces, dtype=np.int32)))
    assert "\n" not in str(caught.value)


# -------------------------------------------------------------------------------------------- normals


def test_a_cube_without_normals_gets_its_sides():
    patch = prepare_mesh(cube(), MeshOptions(target_faces=200))
    assert len(np.unique(patch.welded_vertex)) < len(patch.vertices)
    # Flat shading is exact: each corner's normal is its face's.
    assert np.abs(patch.vertex_normals[patch.faces] - patch.face_normals[:, None]).max() < 1e-6


def test_a_ball_without_normals_is_smooth():
    patch = prepare_mesh(ball(16), ONLY_CLEAN)
    assert len(patch.vertices) == len(ball(16).vertices)
    angle = np.arccos(np.clip((patch.vertex_normals * patch.vertices).sum(axis=1), -1, 1))
    assert np.rad2deg(angle).max() < 0.7  # faces of 11 degrees; a face's own normal would be 5 off


def test_the_crease_angle_decides():
    for crease_angle_deg, num_vertices in ((89.0, 24), (91.0, 8)):
        patch = prepare_mesh(cube(), MeshOptions(target_faces=0, crease_angle_deg=crease_angle_deg))
        assert len(patch.vertices) == num_vertices
    # Around a corner three sides at right angles meet: the mean is the diagonal, however a side is cut in two.
    diagonal = patch.vertices * 2 - 1
    assert patch.vertex_normals == pytest.approx(diagonal / np.sqrt(3), abs=1e-6)


def test_normals_of_split_edges_are_between_their_ends():
    patch = prepare_mesh(ball(10, with_normals=True), MeshOptions(target_faces=3000))
    cosine = (patch.vertex_normals * patch.vertices).sum(axis=1) / np.linalg.norm(patch.vertices, axis=1)
    assert cosine.min() > np.cos(np.deg2rad(0.6))  # a blend of normals bends as the sphere does, to third order
    assert np.linalg.norm(patch.vertex_normals, axis=1) == pytest.approx(1, abs=1e-6)


# ---------------------------------------------------------------------------------------- subdivision

SHAPES = {
    "one triangle": with_faces(grid(1), [[0, 1, 2]]),
    "a needle": TriangleMesh(np.array([[0, 0, 0], [1, 0, 0], [0.3, 1e-5, 0]]), np.array([[0, 1, 2]], dtype=np.int32)),
    "cube": cube(),
    "ball": ball(20),
    "moebius": moebius(),
    "table and ball": join(grid(1, 100.0), ball(12, 0.5)),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("target", [1_000, 120_732])
def test_at_least_the_faces_that_were_asked_for(name, target):
    patch = prepare_mesh(SHAPES[name], MeshOptions(target_faces=target))
    # Equal edges are split together, so the count can overshoot, by no more than one uniform step.
    assert target <= len(patch.faces) == patch.report.num_faces_out < 4 * target


@pytest.mark.parametrize("name", SHAPES)
def test_parts_cover_their_parents(name):
    mesh = SHAPES[name]
    patch = prepare_mesh(mesh, MeshOptions(target_faces=2_000))
    assert area_by_parent(patch, len(mesh.faces)) == pytest.approx(areas_of(mesh), rel=1e-9)
    assert patch.face_areas.min() > 0
    # Every part lies within its parent: its middle has barycentric coordinates in (0, 1), and no height over it.
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[patch.parent_face]], 1, 0)
    middle = patch.vertices[patch.faces].mean(axis=1)
    normal = np.cross(b - a, c - a)
    for one, other in ((a, b), (b, c), (c, a)):
        weight = (np.cross(other - one, middle - one) * normal).sum(axis=1) / (normal * normal).sum(axis=1)
        assert weight.min() > 0 and weight.max() < 1
    if mesh.object_id is not None:
        assert np.array_equal(patch.object_id, mesh.object_id[patch.parent_face])


def test_large_faces_are_split_and_small_ones_left():
    mesh = SHAPES["table and ball"]
    patch = prepare_mesh(mesh, MeshOptions(target_faces=5_000))
    on_ball = patch.object_id == 1
    assert on_ball.sum() == len(ball(12).faces)  # the ball's edges are 0.13 long
    assert areas_of(patch)[~on_ball].max() < 4 * areas_of(patch)[~on_ball].min()


@pytest.mark.parametrize("name", ["cube", "table and ball", "moebius"])
def test_no_crack_opens(name):
    mesh = SHAPES[name]
    patch = prepare_mesh(mesh, MeshOptions(target_faces=3_000))
    welded = patch.welded_vertex[patch.faces]
    edges = topology.shared_edges(welded)
    before = topology.shared_edges(mesh.faces)
    assert edges.num_non_manifold == 0 and (edges.num_boundary > 0) == (before.num_boundary > 0)
    # Euler's number tells a hole of any size.
    euler = [
        len(np.unique(faces)) - (len(e.pairs) + e.num_boundary) + len(faces)
        for faces, e in ((welded, edges), (mesh.faces, before))
    ]
    assert euler[0] == euler[1]


def test_welded_vertices_are_places():
    patch = prepare_mesh(join(cube(), cube(1.0, (1, 0, 0))), MeshOptions(target_faces=500))
    places = np.unique(patch.vertices, axis=0)
    assert patch.welded_vertex.max() + 1 == len(places)
    first = np.full(len(places), -1)
    first[patch.welded_vertex[::-1]] = np.arange(len(patch.vertices))[::-1]
    assert np.array_equal(patch.vertices[first[patch.welded_vertex]], patch.vertices)


def test_uvs_stay_the_same_function_of_place():
    mesh, matrix = grid(2), np.array([[0.3, -0.7], [0.2, 0.1], [0.0, 0.0]])
    uvs = ((mesh.vertices @ matrix)[mesh.faces] + 0.5).astype(np.float32)
    patch = prepare_mesh(replace(mesh, corner_uvs=uvs), MeshOptions(target_faces=700))
    # float32 UVs of about 1 are rounded to 6e-8; a UV of another corner would be 0.01 off.
    assert np.abs(patch.corner_uvs - ((patch.vertices @ matrix)[patch.faces] + 0.5)).max() < 5e-7


def test_uvs_follow_a_turned_face():
    mesh = ball(6)
    uvs = mesh.vertices[mesh.faces][..., :2].astype(np.float32)
    mesh.faces[7], uvs[7] = mesh.faces[7, ::-1].copy(), uvs[7, ::-1].copy()
    patch = prepare_mesh(replace(mesh, corner_uvs=uvs), ONLY_CLEAN)
    assert dict(patch.report.changes) == {"faces_flipped": 1}
    assert np.array_equal(patch.corner_uvs, patch.vertices[patch.faces][..., :2].astype(np.float32))


def test_overlapping_faces_end_without_duplicates():
    one, two = grid(2), grid(1)
    patch = prepare_mesh(join(one, two), MeshOptions(target_faces=2_000))
    assert len(patch.faces) >= 2_000
    assert not topology.repeated_faces(patch.welded_vertex[patch.faces]).any()


def test_max_edge_length_is_reached_or_reported():
    patch = prepare_mesh(cube(2.0), MeshOptions(target_faces=0, max_edge_length=0.1))
    place = patch.vertices[patch.faces]
    assert np.linalg.norm(np.roll(place, -1, axis=1) - place, axis=2).max() <= 0.1
    stopped = prepare_mesh(cube(2.0), MeshOptions(target_faces=0, max_edge_length=0.01, max_faces=10_000))
    assert len(stopped.faces) <= 10_000
    assert any("max_edge_length is not reached" in note for note in stopped.report.notes)


# ---------------------------------------------------------------------------------- units and places


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e4, 1e9])
@pytest.mark.parametrize("offset", [0.0, 1e6], ids=["at the origin", "georeferenced"])
def test_neither_unit_nor_place_matters(scale, offset):
    mesh = join(ball(8), cube(0.5, (2, 0, 0)), grid(3, 7.0))
    # Between equal diagonals rounding chooses: the regular shapes are made irregular, so that connectivity compares.
    mesh.vertices[:] += np.random.default_rng(0).uniform(-0.01, 0.01, mesh.vertices.shape)
    mesh.faces[5] = mesh.faces[5, ::-1].copy()
    faces = np.concatenate([mesh.faces, mesh.faces[:2], [[0, 0, 1]]]).astype(np.int32)
    mesh = replace(mesh, faces=faces, object_id=np.append(mesh.object_id, [0, 0, 0]).astype(np.int32))
    here = prepare_mesh(mesh, MeshOptions(target_faces=4_000))
    there = prepare_mesh(
        replace(mesh, vertices=(mesh.vertices + offset) * scale),
        MeshOptions(target_faces=4_000),
    )
    assert dict(there.report.changes) == dict(here.report.changes)
    assert {"faces_flipped", "faces_duplicate", "faces_zero_area", "faces_added"} == set(here.report.changes)
    assert np.array_equal(there.faces, here.faces) and np.array_equal(there.parent_face, here.parent_face)
    # A million away a double holds ten digits of a metre.
    assert there.vertices / scale - offset == pytest.approx(here.vertices, abs=1e-9)
    assert there.vertex_normals == pytest.approx(here.vertex_normals, abs=1e-6)


def test_the_same_mesh_twice_is_the_same():
    one, other = (prepare_mesh(SHAPES["table and ball"]) for _ in range(2))
    for name in ("vertices", "faces", "vertex_normals", "welded_vertex", "parent_face", "object_id"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


@pytest.mark.parametrize(
    "name, value",
    [
        ("target_faces", -1),
        ("target_faces", 5_000_000),
        ("max_faces", 0),
        ("max_edge_length", 0.0),
        ("max_edge_length", float("nan")),
        ("crease_angle_deg", 181.0),
        ("weld_tolerance", -1e-9),
        ("weld_tolerance", 1.0),
        ("min_face_height", float("inf")),
        ("denoise_steps", -1),
    ],
)
def test_options_are_checked(name, value):
    with pytest.raises(InputError, match=rf"MeshOptions\.{name}: got "):
        MeshOptions(**{name: value})


def rough_ball(noise: float, rings: int = 48) -> TriangleMesh:
    """A ball whose vertices are off by a part of an edge; places stay together at the seam and the poles."""
    mesh = sphere(1.0, rings)
    _, place = np.unique(mesh.vertices.round(9), axis=0, return_inverse=True)
    off = np.random.default_rng(4).normal(size=(int(place.max()) + 1, 3)) / 3**0.5
    edge = np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)
    return replace(mesh, vertices=mesh.vertices + noise * np.median(edge) * off[place.ravel()])


def test_a_rough_scan_is_smoothed_and_said_to_be() -> None:
    given = rough_ball(0.25)
    out, left = (prepare_mesh(given, MeshOptions(target_faces=0, denoise_steps=steps)) for steps in (None, 0))
    assert any("smoothed" in note for note in out.report.notes)
    off, was_off = (np.abs(np.linalg.norm(each.vertices, axis=1) - 1).mean() for each in (out, left))
    assert off < 0.6 * was_off
    middle = out.vertices[out.faces].mean(axis=1)
    turned, was_turned = (
        np.degrees(np.arccos(np.clip(np.einsum("fi,fi->f", each.face_normals, middle), -1, 1))).mean()
        for each in (out, left)
    )
    assert turned < 0.5 * was_turned
    # What stood at one place, at the seam and the poles, still does, to the last bit.
    place = np.unique(given.vertices[np.unique(given.faces)].round(9), axis=0)
    assert len(np.unique(out.vertices, axis=0)) == len(place) < len(out.vertices)


def test_an_even_mesh_and_a_coarse_one_keep_every_vertex() -> None:
    room = join(*(cube(1.0, (2.0 * k, 0.0, 0.0)) for k in range(200)))
    for given in (ball(48), rough_ball(0.02), rough_ball(0.3, 12), room):
        out = prepare_mesh(given, MeshOptions(target_faces=0))
        assert not any("smoothed" in note for note in out.report.notes)
        assert {tuple(row) for row in out.vertices} <= {tuple(row) for row in given.vertices}


def test_smoothing_can_be_asked_for() -> None:
    given = rough_ball(0.02)
    out, left = (prepare_mesh(given, MeshOptions(target_faces=0, denoise_steps=steps)) for steps in (5, 0))
    assert any("smoothed" in note for note in out.report.notes)
    assert 0 < np.abs(out.vertices - left.vertices).max() < 0.02

"""The division into surfaces, held to painted objects of known materials and to the labels of the tiny capture."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from relight3d.camera import Camera, look_at
from relight3d.errors import InputError
from relight3d.evaluate import shapes
from relight3d.io.capture import load_capture, read_photograph
from relight3d.io.images import read_image
from relight3d.maths import topology
from relight3d.records import PatchMesh, ShadingPoints, TriangleMesh
from relight3d.recover import surfaces
from relight3d.recover.diffuse import pixel_albedo
from relight3d.recover.mesh import MeshOptions, prepare_mesh
from relight3d.recover.segmentation import SegmentationOptions
from relight3d.recover.surfaces import SurfaceOptions, surfaces_from_labels, surfaces_from_photographs
from relight3d.recover.visibility import VisibilityOptions, observe
from relight3d.shading import points_seen, ray_scene

RED, BLUE = np.array([0.6, 0.3, 0.2]), np.array([0.2, 0.35, 0.5])
WHITE, GRAY, BLACK = np.full(3, 0.8), np.full(3, 0.35), np.full(3, 0.08)
DESK = Path(__file__).parents[2] / "data" / "desk_tiny"
SHARED = Path(__file__).parents[3] / "shared" / "captures"


@dataclass(frozen=True)
class View:
    mesh: PatchMesh
    camera: Camera
    points: ShadingPoints

    def divide(self, paint, seed=0, noise=0.06, tells=None, scale=1.0, options=None):
        """Surfaces from an albedo painted by place and normal, with the indirect light, highlight and noise left in."""
        place, normal = self.points.position.astype(np.float64), self.points.normal
        indirect = np.exp(0.3 * place @ [[0.5], [-0.3], [0.6]] * (1.0, 0.95, 0.85))
        highlight = 0.3 * np.exp(-((place - (0.3, -0.7, 0.6)) ** 2).sum(axis=1) / 0.01)[:, None]
        grain = np.exp(np.random.default_rng(seed).normal(0, noise, (len(place), 3)))
        albedo = (scale * (paint(place, normal) * indirect * grain + highlight)).astype(np.float32)
        information = np.ones(len(place), np.float32) if tells is None else tells.astype(np.float32)
        return surfaces_from_photographs(
            self.mesh, self.points, self.camera, albedo, information, options or SurfaceOptions()
        )

    def seen(self, found):
        return found.surface_of_face[self.points.face]


@cache
def view(shape: str) -> View:
    mesh = {"ball": ball, "box": lambda: shapes.box(1.4, 1.4, 1.4, 10), "slab": slab, "two": two_balls}[shape]()
    camera = Camera(
        180, 150, 230.0, 230.0, 90.0, 75.0, world_from_camera=look_at(np.array([2.2, -3.4, 2.0]), np.zeros(3))
    )
    patches = prepare_mesh(replace(mesh, object_id=None), MeshOptions(target_faces=0))
    return View(patches, camera, points_seen(ray_scene(patches), patches, camera))


def ball() -> TriangleMesh:
    return shapes.sphere(1.0, 32)


def slab() -> TriangleMesh:
    return shapes.box(1.7, 0.1, 1.3, 10)


def two_balls() -> TriangleMesh:
    left = shapes.transformed(shapes.sphere(0.45, 16), translation=(-0.6, 0.0, 0.0))
    return shapes.joined(
        {"left": left, "right": shapes.transformed(shapes.sphere(0.45, 16), translation=(0.6, 0.0, 0.0))}
    )


def rounded_slab() -> TriangleMesh:
    """A slab as a scan has it: one smooth piece, its edges round and its normals smooth."""
    mesh = shapes.box(1.7, 0.5, 1.3, 28)
    inner = np.clip(mesh.vertices, (-0.65, -0.05, -0.45), (0.65, 0.05, 0.45))
    normal = mesh.vertices - inner
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return TriangleMesh(inner + 0.2 * normal, mesh.faces, normal.astype(np.float32))


def either(is_first, first, second):
    return np.where(is_first[:, None], first, second)


def agreement(one, other):
    """The share of pixels on which two divisions agree, under the best matching of their surfaces."""
    table = np.zeros((one.max() + 1, other.max() + 1))
    np.add.at(table, (one, other), 1)
    return table[linear_sum_assignment(-table)].sum() / len(one)


def angles(place):
    direction = place / np.linalg.norm(place, axis=1, keepdims=True)
    return np.arctan2(direction[:, 1], direction[:, 0]) / np.pi, np.arccos(direction[:, 2]) / np.pi


def checker(number, first=WHITE, second=BLACK):
    return lambda place, _: either(np.floor(np.stack(angles(place)) * number).sum(axis=0) % 2 == 0, first, second)


def cube_checker(number, first=WHITE, second=BLACK):
    return lambda place, _: either(np.floor((place + 0.7001) / 1.4 * number).sum(axis=1) % 2 == 0, first, second)


def mosaic(place, _):
    colors = np.random.default_rng(0).uniform(0.05, 0.9, (4096, 3))
    return colors[np.floor(place * 7).astype(int) @ (1, 16, 256) % 4096]


PRINTS = {
    "plain": lambda place, _: np.broadcast_to(RED, place.shape),
    "coarse checker": checker(6),
    "checker": checker(12),
    "fine checker": checker(40),
    "coloured checker": checker(10, RED, BLUE),
    "stripes": lambda place, _: either(np.floor(angles(place)[1] * 14) % 2 == 0, RED, BLUE),
    "soft waves": lambda place, _: RED * np.exp(0.2 * np.sin(place @ np.array([[5, 1, 3], [1, -5, 3], [-2, 3, 5.0]]))),
    "mosaic": mosaic,
}


@pytest.mark.parametrize("name", PRINTS)
def test_a_print_does_not_divide_a_ball(name):
    found = view("ball").divide(PRINTS[name])
    # Up to a tenth may be lost at the rim, where a patch is seen edge-on and holds a few colours only.
    assert np.bincount(view("ball").seen(found)).max() > 0.9 * len(view("ball").points)


MATERIALS = {
    "hue": (RED, BLUE, lambda place: place[:, 0] > 0),
    "luminance": (GRAY, 2.2 * GRAY, lambda place: place[:, 2] > 0.3),
    "cap": (RED, BLUE, lambda place: place[:, 2] > 0.7),
}


@pytest.mark.parametrize("name", MATERIALS)
def test_two_materials_divide_a_ball_where_they_meet(name):
    first, second, where = MATERIALS[name]
    found = view("ball").divide(lambda place, _: either(where(place), first, second))
    truth = where(view("ball").points.position).astype(int)
    assert found.num_surfaces == 2 and found.surface_of_face[0] == 0
    assert agreement(truth, view("ball").seen(found)) > 0.96  # a pixel or two along the border, where faces straddle it


def test_a_print_and_a_plain_material_on_one_ball_are_two_surfaces():
    found = view("ball").divide(lambda place, n: either(place[:, 0] > 0, checker(16)(place, n), RED))
    assert agreement((view("ball").points.position[:, 0] > 0).astype(int), view("ball").seen(found)) > 0.94


BOXES = {
    "plain": (PRINTS["plain"], 1),
    "unequal indirect light": (lambda _, normal: either(normal[:, 1] < -0.9, 1.5 * GRAY, GRAY), 1),
    "checker": (cube_checker(6), 1),
    "few squares": (cube_checker(3, RED, BLUE), 1),
    "one side of another material": (lambda _, normal: either(normal[:, 1] < -0.9, RED, BLUE), 2),
    "a print on one side": (lambda p, n: either(n[:, 1] < -0.9, cube_checker(8, RED, WHITE)(p, n), RED), 2),
}


@pytest.mark.parametrize("name", BOXES)
def test_the_sides_of_a_box_are_one_surface_where_they_are_one_material(name):
    paint, number = BOXES[name]
    found = view("box").divide(paint)
    assert found.num_surfaces == number
    side = view("box").points.normal[:, 1] < -0.9
    if number == 2:
        assert agreement(side.astype(int), view("box").seen(found)) == 1.0, "a crease is exact"


def shown(place):
    """What a mirror's front may show: other things."""
    return either((place[:, 0] > 0.2) & (place[:, 2] < 0.2), BLUE, either(place[:, 2] > 0.1, 0.6 * RED, 0.7 * WHITE))


def test_a_mirror_is_one_surface_whatever_it_shows_and_its_edges_are_another():
    found = view("slab").divide(lambda place, normal: either(normal[:, 1] < -0.9, shown(place), BLACK))
    assert found.num_surfaces == 2
    assert agreement((view("slab").points.normal[:, 1] < -0.9).astype(int), view("slab").seen(found)) == 1.0


def test_a_scanned_mirror_with_round_edges_is_not_cut_by_what_it_shows():
    patches = prepare_mesh(rounded_slab(), MeshOptions(target_faces=0))
    camera = Camera(
        300, 250, 420.0, 420.0, 150.0, 125.0, world_from_camera=look_at(np.array([1.4, -3.4, 1.2]), np.zeros(3))
    )
    scan = View(patches, camera, points_seen(ray_scene(patches), patches, camera))
    front = scan.points.normal[:, 1] < -0.999

    def reflections(place, normal):
        return either(normal[:, 1] < -0.99, shown(place), BLACK)

    whole = np.bincount(scan.seen(scan.divide(reflections))[front])
    assert whole.max() == front.sum()
    cut = replace(SegmentationOptions(), facet_deg=1e-3)  # no facets: the picture in the mirror divides it
    shattered = np.bincount(scan.seen(scan.divide(reflections, options=SurfaceOptions(parts=cut)))[front])
    assert shattered.max() < 0.95 * front.sum()


def test_a_bent_mirror_between_creases_is_not_cut_either():
    straight = slab()
    bent = straight.vertices + (0.0, 0.08, 0.0) * straight.vertices[:, :1] ** 2
    patches = prepare_mesh(TriangleMesh(bent, straight.faces), MeshOptions(target_faces=0))
    mirror = View(patches, view("slab").camera, points_seen(ray_scene(patches), patches, view("slab").camera))
    found = mirror.divide(lambda place, normal: either(normal[:, 1] < -0.9, shown(place), BLACK))
    assert agreement((mirror.points.normal[:, 1] < -0.9).astype(int), mirror.seen(found)) > 0.99
    cut = SurfaceOptions(parts=SegmentationOptions(flat_deg=1.0))
    found = mirror.divide(lambda place, normal: either(normal[:, 1] < -0.9, shown(place), BLACK), options=cut)
    assert agreement((mirror.points.normal[:, 1] < -0.9).astype(int), mirror.seen(found)) < 0.9


def test_a_small_part_does_not_join_its_two_neighbours():
    samples = np.random.default_rng(0).normal(0, 0.02, (2040, 3))
    samples[1000:2000] += (0.0, 0.5, 0.0)
    samples[2000:] += np.linspace(0, 0.5, 40)[:, None] * (0.0, 1.0, 0.0)
    part = np.repeat(np.arange(3, dtype=np.int32), (1000, 1000, 40))
    touching = np.repeat(np.array([[0, 2], [2, 1]], np.int32), 40, axis=0)
    found = surfaces.merge_parts(part, part, samples, touching, SegmentationOptions())
    assert found[0] != found[1] and found[2] in found[:2]


def test_small_panels_of_a_piece_are_one():
    panel = np.repeat(np.arange(4, dtype=np.int32), (200, 10, 20, 30))
    piece = np.repeat(np.array([0, 1], np.int32), (230, 30))
    found = surfaces.large_panels(panel, piece, SegmentationOptions())
    assert len(np.unique(found[200:230])) == 1 and len(np.unique(found)) == 3


def test_pieces_that_do_not_touch_are_surfaces_of_their_own():
    found = view("two").divide(PRINTS["plain"])
    assert found.num_surfaces == 2
    centre = view("two").mesh.vertices[view("two").mesh.faces].mean(axis=1)
    assert agreement((centre[:, 0] > 0).astype(int), found.surface_of_face) == 1.0


@pytest.mark.parametrize(("is_split", "cuts"), [(True, True), (False, False)])
def test_a_shallow_edge_cuts_where_the_vertex_normals_say_so(is_split, cuts):
    ridge = np.array([[0, 0, 0], [0, 1, 0], [1, 0, -0.25], [0, 0, 0], [0, 1, 0], [-1, 0, -0.25]], np.float64)
    sides = np.array([[0.243, 0, 0.97], [-0.243, 0, 0.97]]) if is_split else np.tile([0, 0, 1.0], (2, 1))
    faces = np.array([[0, 2, 1], [3, 4, 5]], np.int32)
    roof = TriangleMesh(ridge, faces, np.repeat(sides, 3, axis=0).astype(np.float32))
    mesh = prepare_mesh(roof, MeshOptions(target_faces=0))
    edges = topology.shared_edges(mesh.welded_vertex[mesh.faces])
    np.testing.assert_array_equal(surfaces.creases(mesh, edges, SurfaceOptions()), [cuts])
    assert surfaces.creases(mesh, edges, SurfaceOptions(crease_deg=20.0)).all(), "28 degrees are sharp enough then"
    assert not surfaces.creases(mesh, edges, SurfaceOptions(split_normal_deg=40.0)).any()


def test_a_sharp_edge_cuts_whatever_the_vertex_normals_say():
    sharp = shapes.box(1.4, 1.4, 1.4, 10)
    place = sharp.vertices / np.linalg.norm(sharp.vertices, axis=1, keepdims=True)
    patches = prepare_mesh(replace(sharp, vertex_normals=place.astype(np.float32)), MeshOptions(target_faces=0))
    edges = topology.shared_edges(patches.welded_vertex[patches.faces])
    cuts = surfaces.creases(patches, edges, SurfaceOptions())
    np.testing.assert_array_equal(cuts, topology.dihedral_angles(patches.face_normals, edges.pairs) > 1.0)
    assert cuts.sum() == 12 * 10


def test_the_creases_of_a_rough_scan_are_noise():
    smooth = shapes.sphere(1.0, 32)
    jitter = np.random.default_rng(0).normal(0, 0.03, smooth.vertices.shape)[topology.weld(smooth.vertices, 1e-6)]
    rough = TriangleMesh(
        (smooth.vertices + jitter)[smooth.faces].reshape(-1, 3),
        np.arange(smooth.faces.size).reshape(-1, 3).astype(np.int32),
    )
    patches = prepare_mesh(rough, MeshOptions(target_faces=0, denoise_steps=0))
    edges = topology.shared_edges(patches.welded_vertex[patches.faces])
    assert surfaces.creases(patches, edges, SurfaceOptions()).mean() > 0.1
    scan = View(patches, view("ball").camera, points_seen(ray_scene(patches), patches, view("ball").camera))
    found = scan.seen(scan.divide(PRINTS["plain"]))
    assert np.bincount(found).max() > 0.97 * len(found)


@pytest.mark.parametrize("name", ["hue", "cap"])
def test_other_photographs_give_the_same_division(name):
    first, second, where = MATERIALS[name]
    paint = lambda place, _: either(where(place), first, second)  # noqa: E731
    lit = np.random.default_rng(5).random((2, len(view("ball").points))) > 0.2
    halves = [view("ball").seen(view("ball").divide(paint, seed=k, noise=0.1, tells=lit[k])) for k in (0, 1)]
    assert agreement(*halves) > 0.97


def test_unseen_faces_follow_their_piece_and_numbers_follow_the_faces():
    found = view("two").divide(PRINTS["plain"], tells=view("two").points.position[:, 0] < 0)
    assert found.num_surfaces == 1, "no pixel tells of the right ball: it takes the nearest label"
    half = view("box").divide(BOXES["one side of another material"][0])
    normal = view("box").mesh.face_normals
    assert len(np.unique(half.surface_of_face[normal[:, 1] < -0.9])) == 1
    assert half.surface_of_face[0] == 0 and half.names == ("surface 0", "surface 1")
    assert half.kinds == (("diffuse",), ("diffuse",))


@pytest.mark.parametrize("telling", [0, 5])
def test_a_scene_hardly_lit_is_one_surface(telling):
    tells = np.arange(len(view("box").points)) < telling
    found = view("box").divide(PRINTS["plain"], tells=tells)
    assert found.num_surfaces == 1 and len(found.surface_of_face) == len(view("box").mesh.faces)


def test_a_large_picture_is_thinned_and_divided_alike(monkeypatch):
    paint = lambda place, _: either(place[:, 0] > 0, RED, BLUE)  # noqa: E731
    full = view("ball").divide(paint)
    monkeypatch.setattr(surfaces, "MAX_POINTS", len(view("ball").points) // 4)
    assert agreement(view("ball").seen(full), view("ball").seen(view("ball").divide(paint))) > 0.96


def test_the_scale_of_the_lights_does_not_matter():
    paint = BOXES["a print on one side"][0]
    one, other = (view("box").divide(paint, scale=scale) for scale in (1e-4, 1e4))
    np.testing.assert_array_equal(one.surface_of_face, other.surface_of_face)


def test_labels_are_taken_as_they_are():
    mesh = replace(view("box").mesh, object_id=np.where(view("box").mesh.face_normals[:, 2] > 0, 7, 3).astype(np.int32))
    found = surfaces_from_labels(replace(mesh, object_names={7: "lid"}))
    assert found is not None and found.names == ("object 3", "lid")
    np.testing.assert_array_equal(found.surface_of_face, (mesh.object_id == 7).astype(np.int32))
    assert surfaces_from_labels(view("box").mesh) is None


@pytest.mark.parametrize(
    "fields", [{"crease_deg": 0.0}, {"split_normal_deg": 180.0}, {"min_information": -0.1}, {"min_information": 1.0}]
)
def test_options_out_of_range_are_refused(fields):
    with pytest.raises(InputError, match=next(iter(fields))):
        SurfaceOptions(**fields)


@pytest.mark.parametrize(
    "fields", [{"same_material": 0.0}, {"patch_px": 4}, {"min_share": 0.5}, {"gradual": 1.0}, {"facet_deg": 90.0}]
)
def test_part_options_out_of_range_are_refused(fields):
    with pytest.raises(InputError, match=next(iter(fields))):
        SegmentationOptions(**fields)


@cache
def unlabelled(folder: Path):
    """A capture, its mesh without labels, and the mesh made ready for rays."""
    capture = load_capture(folder)
    mesh = prepare_mesh(replace(capture.mesh, object_id=None), MeshOptions())
    return capture, mesh, ray_scene(mesh)


def divided(folder: Path, choice: slice):
    """A capture's points and the surface of each, from some of its photographs and without its labels."""
    capture, mesh, rays = unlabelled(folder)
    points = points_seen(rays, mesh, capture.camera)
    photographs = capture.split("train")[choice]
    read = [read_photograph(capture, photograph) for photograph in photographs]
    radiance = np.stack([image.reshape(-1, 3)[points.pixel] for image, _ in read])
    is_valid = np.stack([valid.ravel()[points.pixel] for _, valid in read])
    lights = tuple(tuple(light.translated(-mesh.center) for light in p.lights) for p in photographs)
    observed = observe(rays, mesh, points, capture.camera, radiance, is_valid, lights, VisibilityOptions())
    weight = observed.weight * observed.is_safe * ~observed.is_highlight
    albedo, information = pixel_albedo(observed, observed.radiance, weight, observed.form, None)
    found = surfaces_from_photographs(mesh, points, capture.camera, albedo, information.mean(axis=1), SurfaceOptions())
    return points, found.surface_of_face[points.face]


def test_the_tiny_desk_is_divided_as_its_labels_say():
    points, surface = divided(DESK, slice(None))
    truth = read_image(DESK / "truth" / "surface_label.png")[0]
    truth = np.unique(truth.reshape(-1, 3)[points.pixel, 0], return_inverse=True)[1]
    assert agreement(truth, surface) > 0.97


def test_either_half_of_the_tiny_desks_photographs_divides_it_alike():
    assert agreement(divided(DESK, slice(0, None, 2))[1], divided(DESK, slice(1, None, 2))[1]) > 0.97


@pytest.mark.skipif(not SHARED.exists(), reason="the photographs of DiLiGenT are not part of the project")
@pytest.mark.parametrize(("name", "least", "most"), [("diligent_cat", 1, 1), ("diligent_reading", 2, 5)])
def test_a_real_scan_is_one_surface_or_few(name, least, most):
    _, surface = divided(SHARED / name, slice(None, None, 2))
    assert least <= len(np.unique(surface)) <= most

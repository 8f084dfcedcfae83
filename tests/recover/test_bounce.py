"""Light from surface to surface, held to form factors known in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.camera import Camera, look_at
from relight3d.errors import InputError
from relight3d.evaluate import shapes
from relight3d.evaluate.shapes import joined, transformed, turn_about
from relight3d.lights import DirectionalLight, PointLight
from relight3d.maths.light_basis import BASES, embedding, evaluate_basis
from relight3d.records import Indirect, Mirror, PatchMesh, TriangleMesh
from relight3d.recover import bounce, patches, sites
from relight3d.recover.bounce import BounceOptions
from relight3d.recover.mesh import MeshOptions, prepare_mesh
from relight3d.shading import points_seen, ray_scene

DOWN = DirectionalLight((0.0, 0.0, 1.0), (1.0, 1.0, 1.0))
# A directional lamp lights the floor by E; then a square wall on one of its edges gets albedo * E * 0.20004 on average
# (two unit squares at right angles with a common edge: every table of form factors has it).
CORNER_FACTOR = 0.20004


def patches_of(mesh: TriangleMesh) -> PatchMesh:
    return prepare_mesh(mesh, MeshOptions(target_faces=0))


def corner(num_cells: int = 16) -> TriangleMesh:
    """A floor, and a wall on its edge x = 0 that faces +x."""
    floor = transformed(shapes.plane(1.0, 1.0, num_cells, num_cells), None, (0.5, 0.0, 0.0))
    wall = transformed(shapes.plane(1.0, 1.0, num_cells, num_cells), turn_about("y", 90.0), (0.0, 0.0, 0.5))
    return joined({"floor": floor, "wall": wall})


def transport(mesh: PatchMesh, lights=(DOWN,), mirrors=(), eye=(3.0, -3.0, 2.5), **options) -> bounce.Transport | None:
    camera = Camera(40, 30, 40.0, 40.0, 20.0, 15.0, world_from_camera=look_at(np.array(eye), np.zeros(3)))
    scene = ray_scene(mesh)
    points = points_seen(scene, mesh, camera)
    surface = mesh.object_id if mesh.object_id is not None else np.zeros(len(mesh.faces), np.int32)
    vertices = sites.site_vertices(mesh, points, "vertex")
    heard = np.ones(len(points), bool)
    return bounce.trace_transport(
        scene, mesh, surface, points, heard, vertices, lights, mirrors, BounceOptions(**options)
    )


def mean_over(mesh: PatchMesh, surface: int, values: np.ndarray) -> np.ndarray:
    """The area's mean of what vertices have, over one surface's faces."""
    mine = mesh.object_id == surface
    areas = mesh.face_areas[mine]
    return np.einsum("f,fkc->c", areas, values[mesh.faces[mine]]) / (3 * areas.sum())


def arrived(given: bounce.Transport, albedo: float, mirrors=(), num_bounces: int = 1) -> np.ndarray:
    num_points = given.hear.shape[1]
    of_points = np.full((num_points, 3), albedo, np.float32)
    return bounce.bounced(given, of_points, np.full((4, 3), albedo), mirrors, num_bounces)[:, 0]


def test_a_wall_gets_the_form_factors_share_of_what_the_floor_sends() -> None:
    mesh = patches_of(corner())
    given = transport(mesh, num_rays=512)
    assert given is not None
    assert mean_over(mesh, 1, arrived(given, 0.6)) == pytest.approx(0.6 * CORNER_FACTOR, rel=0.03)
    # The second bounce comes back to the floor, which a first one does not reach.
    assert mean_over(mesh, 0, arrived(given, 0.6)).max() < 1e-12
    back = mean_over(mesh, 0, arrived(given, 0.6, num_bounces=2))
    assert (back > 0).all() and (back < 0.6 * 0.6 * 2 * CORNER_FACTOR**2).all()


def test_the_unit_and_the_place_do_not_matter() -> None:
    here, far = corner(8), corner(8)
    far = replace(far, vertices=1e3 * far.vertices + [1e5, -2e5, 3e4])
    ours, theirs = (mean_over(m, 1, arrived(transport(m), 0.5)) for m in map(patches_of, (here, far)))
    np.testing.assert_allclose(ours, theirs, rtol=0.02)


def test_a_point_lamp_lights_as_its_distance_says() -> None:
    mesh = patches_of(corner(8))
    lamps = (DOWN, PointLight((0.5, 0.0, 200.0), (200.0**2,) * 3))
    given = transport(mesh, lights=lamps)
    both = bounce.bounced(given, np.full((given.hear.shape[1], 3), 0.5, np.float32), np.full((2, 3), 0.5), ())
    # Both are for a power of 1: an intensity of 1 is an irradiance of 1 / 200^2 there.
    np.testing.assert_allclose(both[:, 1] * 200.0**2, both[:, 0], atol=0.02 * both[:, 0].max())


def test_inside_a_closed_box_every_ray_arrives() -> None:
    box = shapes.box(1.0, 1.0, 1.0, 4)
    inside = patches_of(replace(box, faces=box.faces[:, ::-1].copy(), vertex_normals=None))
    outward = np.einsum("fi,fi->f", inside.face_normals, inside.centered_vertices[inside.faces].mean(axis=1))
    assert (outward < 0).all(), "the clean-up must leave the box inside out"
    scene = ray_scene(inside)
    normals = inside.vertex_normals
    points = patches.as_points(inside, normals, inside.face_normals, np.arange(len(inside.vertices)))
    nearest = np.arange(len(inside.vertices))
    seen, _ = patches.hemispheres(
        scene, inside, inside.face_normals, points, nearest, (), np.zeros(len(inside.faces), np.int32), 64
    )
    assert np.asarray(seen.sum(axis=1)).ravel() == pytest.approx(1.0, abs=0.1)


def test_a_mirror_shows_the_floor_a_second_time() -> None:
    """A mirror for a ceiling above a small white patch of floor: the wall gets the patch's image as well."""
    ceiling = transformed(shapes.plane(1.6, 1.6, 2, 2), turn_about("x", 180.0), (0.5, 0.0, 1.0))
    mesh = patches_of(joined({"corner": corner(8), "ceiling": ceiling}))
    is_wall = np.abs(mesh.face_normals[:, 0]) > 0.9
    mirror = Mirror(
        1, np.array([0.0, 0.0, 1.0]) - mesh.center, np.array([0.0, 0.0, -1.0]), np.full(3, 0.8), True, 6.0, False, 1.0
    )
    sideways = DirectionalLight((0.894, 0.0, 0.447), (1.0, 1.0, 1.0))  # under the ceiling
    room = {"lights": (sideways,), "eye": (3.0, -3.0, 0.6), "num_rays": 256}
    without = transport(mesh, **room)
    with_it = transport(mesh, mirrors=(mirror,), **room)
    assert with_it.mirrored[0].nnz > 0 and without.mirrored == ()
    wall = np.unique(mesh.faces[is_wall])
    plain, reflected = arrived(without, 0.5)[wall].mean(), arrived(with_it, 0.5, (mirror,))[wall].mean()
    assert reflected > 1.1 * plain  # 1.13 was measured; without the image they are equal


def test_convex_things_in_the_void_send_each_other_nothing() -> None:
    assert transport(patches_of(shapes.sphere(0.5, 12))) is None
    assert transport(patches_of(corner(4)), num_rays=0) is None
    assert transport(patches_of(corner(4)), lights=()) is None


def test_a_fine_mesh_uses_no_more_patches_than_allowed() -> None:
    mesh = patches_of(corner(16))
    fine, coarse = transport(mesh, num_rays=256), transport(mesh, num_rays=256, max_patches=120)
    assert len(coarse.surface) <= 120 < len(fine.surface)
    assert coarse.to_sites.shape[0] == len(mesh.vertices)
    spread = coarse.to_sites @ arrived(coarse, 0.6)
    assert mean_over(mesh, 1, spread) == pytest.approx(
        mean_over(mesh, 1, arrived(fine, 0.6)), rel=0.15
    )  # 13 % was measured: a patch is a seventh of an edge


def test_functions_of_the_light_read_back_what_they_were_fitted_to() -> None:
    mesh = patches_of(corner(4))
    anchors = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, -0.6, 0.8]])
    lights = bounce.lights_to_try(((DOWN,),), anchors[:1], 1.2, 60)
    given = transport(mesh, lights=lights)
    ways = np.array([light.to_light for light in lights])
    wanted = evaluate_basis("sh2", ways) @ np.arange(1.0, 10.0)
    irradiance = np.broadcast_to(wanted[None, :, None], (len(given.surface), len(lights), 3)).astype(np.float32)
    found = bounce.as_functions(given, irradiance, "sh2", anchors, 0.1)
    rows = evaluate_basis("sh2", ways)[None, :, None, :]
    np.testing.assert_allclose(bounce.at_photographs(found, rows), irradiance, rtol=2e-2, atol=0.05)


@pytest.mark.parametrize(
    ("name", "into"), [("constant", "sh2"), ("linear", "sh2"), ("sh2", "sh3"), ("linear", "cosines2")]
)
def test_a_wider_basis_holds_the_narrower_one(name: str, into: str) -> None:
    rng = np.random.default_rng(0)
    omega = rng.normal(size=(50, 3))
    omega /= np.linalg.norm(omega, axis=1, keepdims=True)
    np.testing.assert_allclose(
        evaluate_basis(into, omega) @ embedding(name, into).T, evaluate_basis(name, omega), atol=1e-9
    )


def test_a_narrower_basis_does_not_hold_the_wider_one() -> None:
    with pytest.raises(ValueError, match="linear does not hold"):
        embedding("sh2", "linear")


@pytest.mark.parametrize(("fit", "of_mesh"), [("linear", "sh2"), ("sh2", "linear"), ("linear", "linear")])
def test_fitted_and_computed_light_add_up(fit: str, of_mesh: str) -> None:
    """In the functions of whichever has more."""
    rng = np.random.default_rng(1)
    fitted = Indirect(
        fit, "vertex", rng.normal(size=(5, BASES[fit], 3)).astype(np.float32), np.zeros((5, 3), np.float32),
        np.array([[0.0, 0.0, 1.0]]), 0.5, 0.1, False,
    )  # fmt: skip
    computed = bounce.Bounced(of_mesh, rng.normal(size=(5, BASES[of_mesh], 3)))
    total = bounce.added(fitted, computed)
    assert total.basis == ("sh2" if "sh2" in (fit, of_mesh) else "linear")
    omega = np.array([[0.6, 0.0, 0.8], [0.0, -0.6, 0.8]])
    wanted = np.einsum("lb,nbc->nlc", evaluate_basis(fit, omega), fitted.coefficients)
    wanted = wanted + np.einsum("lb,nbc->nlc", evaluate_basis(of_mesh, omega), computed.coefficients)
    got = np.einsum("lb,nbc->nlc", evaluate_basis(total.basis, omega), total.coefficients)
    np.testing.assert_allclose(got, wanted, atol=1e-5)


@pytest.mark.parametrize(
    "wrong",
    [{"num_rays": -1}, {"num_lights": -2}, {"max_patches": 0}, {"bases": ("linear", "sh9")}, {"bases": ()}],
    ids=str,
)
def test_options_are_checked(wrong: dict) -> None:
    with pytest.raises(InputError, match=r"bounce\."):
        BounceOptions(**wrong)

"""Shapes, rigs and photographs of synthetic scenes, against what can be said of them in closed form."""

import numpy as np
import pytest

from relight3d.errors import InputError
from relight3d.evaluate.scenes import Material, Scene, hemisphere_lights, plastic, scene_camera
from relight3d.evaluate.shapes import box, joined, plane, sphere, transformed, turn_about
from relight3d.evaluate.synthetic import synthesize
from relight3d.evaluate.truth import true_model, truth_of
from relight3d.lights import DirectionalLight, PointLight
from relight3d.records import TriangleMesh
from tests.scenes import desk, desk_capture

SHAPES = {"plane": plane(2.0, 1.0, 3, 2), "box": box(1.0, 2.0, 3.0, 2), "sphere": sphere(1.5, 8)}


def face_normals(mesh: TriangleMesh) -> np.ndarray:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return np.cross(b - a, c - a)


@pytest.mark.parametrize("name", SHAPES)
def test_faces_have_area_and_go_round_their_normals(name: str):
    mesh = SHAPES[name]
    across = face_normals(mesh)
    assert (np.linalg.norm(across, axis=1) > 1e-6).all()
    assert mesh.vertex_normals is not None and mesh.corner_uvs is not None
    np.testing.assert_allclose(np.linalg.norm(mesh.vertex_normals, axis=1), 1.0, rtol=1e-5)
    assert (np.einsum("fi,fi->f", across, mesh.vertex_normals[mesh.faces].mean(axis=1)) > 0).all()
    assert mesh.corner_uvs.min() == 0.0 and mesh.corner_uvs.max() == 1.0


def test_closed_shapes_have_their_volume_and_face_outward():
    def volume(mesh: TriangleMesh) -> float:
        return float(np.linalg.det(mesh.vertices[mesh.faces]).sum() / 6)

    assert volume(SHAPES["box"]) == pytest.approx(6.0)
    # A polyhedron of 16 x 32 facets keeps 3 % less than the ball.
    assert volume(sphere(1.0, 16)) == pytest.approx(4 / 3 * np.pi, rel=0.03)


def test_parts_are_turned_moved_and_joined():
    turned = transformed(SHAPES["plane"], turn_about("x", 90.0), (0.0, 0.0, 5.0))
    assert turned.vertex_normals is not None
    np.testing.assert_allclose(turned.vertex_normals[0], [0, -1, 0], atol=1e-7)
    np.testing.assert_allclose(turned.vertices[:, 2].mean(), 5.0)
    both = joined({"floor": SHAPES["plane"], "ball": SHAPES["sphere"]})
    assert both.object_id is not None and both.object_names == {0: "floor", 1: "ball"}
    assert np.bincount(both.object_id).tolist() == [len(SHAPES["plane"].faces), len(SHAPES["sphere"].faces)]
    assert both.faces.max() == len(both.vertices) - 1
    with pytest.raises(InputError, match="mirroring"):
        transformed(turned, np.diag([1.0, 1.0, -1.0]))


def test_a_rig_keeps_to_its_zone_and_is_spread():
    lights = hemisphere_lights(40, 20.0, 70.0, seed=5)
    omega = np.array([each[0].to_light for each in lights])
    elevation_deg = np.rad2deg(np.arcsin(omega[:, 2]))
    assert elevation_deg.min() >= 20.0 and elevation_deg.max() <= 70.0
    # Without a preferred side, and no two nearly in one place.
    assert np.linalg.norm(omega[:, :2].mean(axis=0)) < 0.05
    nearest_deg = np.rad2deg(np.arccos(np.sort(omega @ omega.T, axis=1)[:, -2]))
    assert nearest_deg.min() > 8.0
    assert not np.allclose(omega, [each[0].to_light for each in hemisphere_lights(40, 20.0, 70.0, seed=6)])


def test_point_and_distant_rigs_agree_at_the_center():
    center = (0.1, 0.2, 0.3)
    near, far = hemisphere_lights(5, distance=2.5, center=center), hemisphere_lights(5)
    for (a,), (b,) in zip(near, far):
        at_a, at_b = (light.incident(np.array([center])) for light in (a, b))
        np.testing.assert_allclose(at_a.to_light, at_b.to_light, atol=1e-12)
        np.testing.assert_allclose(at_a.irradiance, at_b.irradiance, rtol=1e-12)


def one_plane(material: Material, ambient: float = 0.0) -> Scene:
    camera = scene_camera(16, 12, eye=(0.0, 0.0, 2.0), target=(0.0, 0.0, 0.0))
    return Scene(joined({"plane": plane(4.0, 4.0)}), (material,), camera, (ambient, ambient, ambient))


def test_a_facing_white_surface_has_radiance_irradiance_over_pi():
    scene = one_plane(Material((1.0, 0.5, 0.25)), ambient=0.3)
    lights = [(DirectionalLight((0.0, 0.6, 0.8), (np.pi, np.pi, np.pi)),), ()]
    lit, dark = (p.pixels for p in synthesize(scene, lights).photographs)
    expected = np.array([1.0, 0.5, 0.25]) * (0.8 + 0.3 / np.pi)
    np.testing.assert_allclose(lit, np.broadcast_to(expected, lit.shape), rtol=1e-6)
    np.testing.assert_allclose(dark[5, 5], np.array([1.0, 0.5, 0.25]) * 0.3 / np.pi, rtol=1e-6)


def test_a_highlight_peaks_in_the_mirror_direction():
    scene = one_plane(Material((0.0, 0.0, 0.0), lobes=(plastic(0.5, 60.0),)))
    image = synthesize(scene, [(PointLight((0.0, 0.0, 2.0), (4.0, 4.0, 4.0)),)]).photographs[0].pixels
    assert image is not None
    row, column = np.unravel_index(image[..., 0].argmax(), image.shape[:2])
    assert abs(row + 0.5 - 6) <= 0.5 and abs(column + 0.5 - 8) <= 0.5
    # The lamp stands at the camera. The brightest pixel's centre is half a pixel off the axis, both ways, at cosine c:
    # color * (2 c^2 - 1)^60, times c, times the irradiance 4 / (2 / c)^2.
    squared = 1 / (1 + 0.5 / scene.camera.fx**2)
    # Rays pass 0.0017 px beside the centre (shading.NUDGE_PX), which the lobe's slope there makes 7e-4.
    assert image.max() == pytest.approx(0.5 * (2 * squared - 1) ** 60 * squared**1.5, rel=1e-3)


def test_interreflection_fills_a_corner_and_not_a_plane():
    """Two walls of albedo a at a right angle, one lit: half of the other wall's sky, seen from the edge, is lit."""
    light = (DirectionalLight((1.0, 0.0, 0.0), (np.pi, np.pi, np.pi)),)  # along the floor: it faces the wall alone
    parts = {
        "floor": transformed(plane(40.0, 40.0), None, (20.0, 0.0, 0.0)),
        "wall": transformed(plane(40.0, 40.0), turn_about("y", 90.0), (0.0, 0.0, 20.0)),
    }
    camera = scene_camera(16, 12, eye=(1.0, -0.6, 1.0), target=(0.02, 0.0, 0.0))
    scene = Scene(joined(parts), (Material((0.5, 0.5, 0.5)), Material((0.8, 0.4, 0.2))), camera)
    floor = truth_of(scene).object_id == 0
    plain, bounced = (synthesize(scene, [light], num_bounce_rays=n).photographs[0].pixels for n in (0, 256))
    assert np.abs(plain[floor]).max() == 0.0
    # Form factor 1/2 at the edge, less farther out: radiance up to 0.5 * 0.8 / 2, in the wall's colour.
    assert 0.1 < bounced[floor][:, 0].max() < 0.205
    np.testing.assert_allclose(bounced[floor][:, 2], bounced[floor][:, 0] / 4, rtol=1e-4)
    alone = one_plane(Material((0.5, 0.5, 0.5)))
    flat = [synthesize(alone, hemisphere_lights(1), num_bounce_rays=n).photographs[0].pixels for n in (0, 64)]
    np.testing.assert_array_equal(*flat)


def test_a_mirror_shows_the_scene_and_throws_light():
    scene = desk(mirror=True)
    is_mirror = truth_of(scene).object_id == 3
    # From the camera's side, so that the mirror is lit and throws light on the table before it.
    light = (DirectionalLight((0.0, -0.7, 0.7), (np.pi, np.pi, np.pi)),)
    with_mirror = synthesize(scene, [light]).photographs[0].pixels
    without = synthesize(desk(), [light]).photographs[0].pixels
    assert is_mirror.sum() > 100
    assert (with_mirror[is_mirror].max(axis=1) > 0.02).mean() > 0.3
    elsewhere = truth_of(scene).object_id == 0
    gain = (with_mirror - without)[elsewhere].max(axis=1)
    assert gain.min() >= -1e-6 or (gain < -1e-6).mean() < 0.2  # its shadow takes light from a few pixels
    assert (gain > 0.05).sum() > 20


def test_relief_tilts_normals_only():
    smooth, waved = (truth_of(one_plane(Material((0.5,) * 3, relief_slope=slope))) for slope in (0.0, 0.2))
    np.testing.assert_array_equal(smooth.albedo, waved.albedo)
    tilt_deg = np.rad2deg(np.arccos(waved.normal[..., 2]))
    assert 5.0 < tilt_deg.max() < 16.0
    assert (smooth.normal == [0, 0, 1]).all()


def test_a_capture_has_its_splits_and_groups():
    capture = desk_capture(num_lights=3, ambient=0.1, lights_off=True)
    assert [p.split for p in capture.photographs] == ["train"] * 4 + ["test"] * 5
    assert [p.group for p in capture.split("test")] == ["light"] * 4 + ["viewpoint"]
    assert capture.split("train")[3].lights == ()
    assert not capture.split("test")[-1].camera.same_as(capture.camera)
    for photograph in capture.photographs:
        assert photograph.pixels is not None and np.isfinite(photograph.pixels).all() and photograph.pixels.max() > 0


def test_bounces_brighten_and_never_darken():
    direct, bounced = (desk_capture(num_lights=3, bounce=bounce) for bounce in (False, True))
    for a, b in zip(direct.photographs, bounced.photographs):
        assert (b.pixels >= a.pixels - 1e-6).all()
        assert b.pixels.mean() > 1.01 * a.pixels.mean()


def test_the_true_model_holds_the_truth():
    scene = desk(glossy=True, textured=True, mirror=True, ambient=0.2)
    model, truth = true_model(scene, hemisphere_lights(3)), truth_of(scene)
    assert model.surfaces.names == ("table", "box", "sphere", "mirror")
    assert model.surfaces.kinds == (("textured",), ("diffuse",), ("diffuse", "glossy"), ("mirror",))
    image = np.zeros((scene.camera.num_pixels, 3), np.float32)
    image[model.pixels.points.pixel] = model.pixels.albedo
    np.testing.assert_array_equal(image.reshape(truth.albedo.shape), truth.albedo)
    assert len(np.unique(truth.albedo[truth.object_id == 0], axis=0)) == 2
    assert model.mirrors[0].surface == 3 and model.mirrors[0].normal[1] < -0.9

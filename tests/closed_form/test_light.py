"""Light on a plane and in a sphere, against formulae."""

import numpy as np
import pytest

from relight3d.evaluate.scenes import Material, Scene, scene_camera
from relight3d.evaluate.shapes import joined, plane, sphere, transformed, turn_about
from relight3d.evaluate.synthetic import synthesize
from relight3d.evaluate.truth import true_model
from relight3d.evaluate.world import World
from relight3d.lights import DirectionalLight, PointLight, RectangleLight, SphereLight, SpotLight
from relight3d.relight.relighter import Relighter
from relight3d.shading import cast_light, cast_thrown, mirrored_light, points_seen

# float32 carries 6e-8; a position of 1 is known to 1e-7 and enters squared, beside a normalised cosine.
FLOAT32 = 1e-5

ALBEDO = np.array([0.7, 0.5, 0.2])
FLOOR = Scene(
    joined({"floor": plane(4.0, 4.0, 3, 3)}), (Material(tuple(ALBEDO)),), scene_camera(24, 18, (0.3, -1.0, 2.5))
)


def floor_points():
    world = World(FLOOR)
    points = points_seen(world.rays, world.mesh, FLOOR.camera)
    return points, points.position.astype(np.float64) + world.mesh.center


def radiance_of(light):
    frame = Relighter(true_model(FLOOR)).render([light]).radiance.reshape(-1, 3)
    points, place = floor_points()
    return frame[points.pixel], place


@pytest.mark.parametrize("elevation_deg", [90.0, 45.0, 5.0])
def test_plane_under_a_directional_light(elevation_deg):
    e = np.radians(elevation_deg)
    radiance, _ = radiance_of(DirectionalLight((np.cos(e), 0.0, np.sin(e)), (3.0, 2.0, 1.0)))
    wanted = ALBEDO / np.pi * np.array([3.0, 2.0, 1.0]) * np.sin(e)
    np.testing.assert_allclose(radiance, np.broadcast_to(wanted, radiance.shape), rtol=FLOAT32)


def point_irradiance(place, lamp, intensity):
    offset = lamp - place
    squared = (offset**2).sum(axis=1)
    return intensity * offset[:, 2] / squared**1.5


def test_plane_under_a_point_light():
    lamp = np.array([0.4, -0.2, 1.3])
    radiance, place = radiance_of(PointLight(tuple(lamp), 2.0))
    wanted = ALBEDO / np.pi * point_irradiance(place, lamp, 2.0)[:, None]
    np.testing.assert_allclose(radiance, wanted, rtol=FLOAT32)


def test_plane_under_a_spot_light():
    lamp, direction = np.array([0.4, -0.2, 1.3]), np.array([-0.1, 0.2, -1.0])
    inner, outer = 0.2, 0.6
    radiance, place = radiance_of(SpotLight(tuple(lamp), tuple(direction), 2.0, inner, outer))
    way = place - lamp
    cosine = way @ direction / np.linalg.norm(way, axis=1) / np.linalg.norm(direction)
    cone = np.clip((cosine - np.cos(outer)) / (np.cos(inner) - np.cos(outer)), 0, 1) ** 2
    wanted = ALBEDO / np.pi * (point_irradiance(place, lamp, 2.0) * cone)[:, None]
    assert (cone == 0).any() and (cone == 1).any() and ((cone > 0) & (cone < 1)).any()
    # The ramp's slope magnifies the rounding of the cosine by 1 / (cos inner - cos outer) = 6; absolute where it is 0.
    np.testing.assert_allclose(radiance, wanted, rtol=10 * FLOAT32, atol=1e-6)


def test_samples_of_a_sphere_light_add_up_to_a_point_light_far_away():
    ball = SphereLight((0.0, 0.0, 50.0), 2500.0, radius=0.5)
    points, place = floor_points()
    total = sum(each.incident(points.position)[1][:, 0] for each in ball.samples(64))
    centre = PointLight(ball.position, ball.intensity).incident(points.position)[1][:, 0]
    # A ball of radius r at distance d differs from its centre by order (r / d)^2 = 1e-4.
    np.testing.assert_allclose(total, centre, rtol=3e-4)


def test_samples_of_a_panel_fall_with_the_cosine():
    panel = RectangleLight((0.0, 0.0, 50.0), 2500.0, edge_u=(0.5, 0.0, 0.0), edge_v=(0.0, -0.5, 0.0))
    points, _ = floor_points()
    total = sum(each.incident(points.position)[1][:, 0] for each in panel.samples(16))
    to_light, irradiance, _ = PointLight(panel.position, panel.intensity).incident(points.position)
    # Shining down: to a direction off the axis it falls with the cosine. (size / distance)^2 = 1e-4.
    np.testing.assert_allclose(total, irradiance[:, 0] * to_light[:, 2], rtol=3e-4)


def test_closed_sphere_with_a_lamp_at_its_centre():
    # Style rule 30: radius 1, albedo 0.5, intensity pi. Irradiance is pi everywhere, so direct radiance is
    # 0.5 * pi / pi = 0.5; every bounce returns half of the one before: 0.5 + 0.25 + ... = 1.
    ball = joined({"ball": sphere(1.0, 64)})
    inside = Scene(ball, (Material((0.5, 0.5, 0.5)),), scene_camera(16, 12, (0.0, -0.5, 0.1), (0.0, 1.0, 0.0)))
    lamp = PointLight((0.0, 0.0, 0.0), np.pi)
    # 64 rows: the facets' middles lie (pi / 128)^2 = 6e-4 inside the sphere, and cosines differ by as much.
    facet = 2e-3
    # Smooth normals turn with their facet to the viewer, who is inside; one pixel of 192 may sit on the pole's seam.
    direct = synthesize(inside, [[lamp]]).photographs[0].pixels
    np.testing.assert_allclose(direct, 0.5, rtol=facet)
    first = synthesize(inside, [[lamp]], num_bounce_rays=256).photographs[0].pixels
    # One bounce: irradiance from all around is pi * 0.5, radiance 0.25 more. The closed surface loses no ray.
    np.testing.assert_allclose(first - direct, 0.25, rtol=4 * facet)
    all_bounces = direct + (first - direct) * 2  # a geometric series with ratio 1/2 from the first bounce on
    np.testing.assert_allclose(all_bounces, 1.0, rtol=4 * facet)


def test_a_far_point_light_tends_to_a_directional_one():
    toward = np.array([0.3, -0.4, 0.85])
    toward /= np.linalg.norm(toward)
    wanted, place = radiance_of(DirectionalLight(tuple(toward), 3.0))
    errors = []
    for distance in (1e2, 1e3, 1e4):
        radiance, _ = radiance_of(PointLight(tuple(distance * toward), 3.0 * distance**2))
        errors.append(np.abs(radiance / wanted - 1).max())
    # First order in extent / distance: a tenth at each step, until float32's rounding of the offset.
    size = np.linalg.norm(place, axis=1).max()
    for distance, error in zip((1e2, 1e3, 1e4), errors):
        assert error < 4 * size / distance + FLOAT32
    assert errors[2] < errors[0] / 50


def test_light_thrown_by_a_plane_mirror():
    # An upright mirror at x = 1, one high and two wide, faces -x. A lamp at (-1, 0, 1): its image is at (3, 0, 1).
    parts = {
        "floor": plane(4.0, 4.0, 3, 3),
        "mirror": transformed(plane(1.0, 2.0, 2, 2), turn_about("y", -90.0), (1.0, 0.0, 0.5)),
    }
    scene = Scene(
        joined(parts),
        (Material((0.5, 0.5, 0.5)), Material((0.0, 0.0, 0.0), mirror=0.8)),
        scene_camera(64, 48, (-1.5, -2.0, 2.5)),
    )
    world = World(scene)
    mirror = world.mirrors[0]
    np.testing.assert_allclose(mirror.normal, (-1, 0, 0), atol=1e-6)
    points = points_seen(world.rays, world.mesh, scene.camera)
    points = points.take(world.object_of_face[points.face] == 0)
    place = points.position.astype(np.float64) + world.mesh.center
    lamp = PointLight((-1.0, 0.0, 1.0), 2.0)
    centred = lamp.translated(-world.mesh.center)
    np.testing.assert_allclose(
        np.asarray(mirrored_light(centred, mirror).position) + world.mesh.center, (3.0, 0.0, 1.0), atol=1e-6
    )
    form, _ = cast_thrown(world.rays, points, centred, points.normal, mirror, world.object_of_face)
    # By hand: the line from the floor to the image crosses x = 1 at height and width that must lie on the mirror.
    share = (1.0 - place[:, 0]) / (3.0 - place[:, 0])
    height, across = share * 1.0, place[:, 1] * (1 - share)
    margin = np.minimum(1.0 - height, 1.0 - np.abs(across))
    inside = (place[:, 0] < 1.0) & (margin > 0)
    wanted = point_irradiance(place, np.array([3.0, 0.0, 1.0]), 1.0) * inside
    sure = np.abs(margin) > 1e-3  # on the outline itself rounding decides
    assert inside.sum() > 100 and (~inside).sum() > 100
    np.testing.assert_allclose(form[sure], wanted[sure], rtol=10 * FLOAT32, atol=1e-6)


def test_a_shadow_on_the_floor_is_where_the_line_says():
    board = transformed(plane(1.0, 1.0), None, (0.0, 0.0, 1.0))
    scene = Scene(
        joined({"floor": plane(4.0, 4.0, 3, 3), "board": board}),
        (Material((0.5, 0.5, 0.5)),) * 2,
        scene_camera(64, 48, (0.0, -3.0, 2.0)),
    )
    world = World(scene)
    points = points_seen(world.rays, world.mesh, scene.camera)
    points = points.take(world.object_of_face[points.face] == 0)
    place = points.position.astype(np.float64) + world.mesh.center
    lit = cast_light(world.rays, points, DirectionalLight((0.5, 0.0, 1.0), 1.0)).is_lit
    # The board's shadow is the board moved by -0.5 in x.
    edge = 0.5 - np.maximum(np.abs(place[:, 0] + 0.5), np.abs(place[:, 1]))
    sure = np.abs(edge) > 1e-4
    np.testing.assert_array_equal(lit[sure], edge[sure] < 0)

"""The camera around the scene, and the captured picture from there."""

import numpy as np
import pytest

from relight3d.display.orbit import orbited, panned, seen_from, vertex_colors, zoomed
from relight3d.display.subject import Subject
from relight3d.maths.color import display_u8
from relight3d.records import RelightModel

UP = np.array([0.0, 0.0, 1.0])


def test_an_orbit_keeps_distance_and_comes_back(model: RelightModel):
    pivot, camera = model.mesh.center, model.camera
    moved = orbited(camera, pivot, UP, 0.4, 0.2)
    np.testing.assert_allclose(np.linalg.norm(moved.center - pivot), np.linalg.norm(camera.center - pivot))
    assert moved.center[2] > camera.center[2]  # up
    around = moved
    for _ in range(7):
        around = orbited(around, pivot, UP, 2 * np.pi / 7, 0.0)
    np.testing.assert_allclose(around.world_from_camera, moved.world_from_camera, atol=1e-9)
    before, after = (c.project(pivot[None])[0][0] for c in (camera, moved))
    np.testing.assert_allclose(before, after, atol=1e-6)  # the pivot stays where it is in the picture


@pytest.mark.parametrize("up_rad", [10.0, -10.0])
def test_an_orbit_stops_before_the_pole(model: RelightModel, up_rad: float):
    moved = orbited(model.camera, model.mesh.center, UP, 0.0, up_rad)
    height = (moved.center - model.mesh.center) / np.linalg.norm(moved.center - model.mesh.center)
    np.testing.assert_allclose(abs(height[2]), np.cos(np.radians(5.0)))


def test_zoom_and_pan_do_what_they_say(model: RelightModel):
    pivot, camera = model.mesh.center, model.camera
    nearer = zoomed(camera, pivot, 0.5)
    np.testing.assert_allclose(np.linalg.norm(nearer.center - pivot), 0.5 * np.linalg.norm(camera.center - pivot))
    before, after = (c.project(pivot[None])[0][0] for c in (camera, panned(camera, pivot, 7.0, -3.0)))
    np.testing.assert_allclose(after - before, (7.0, -3.0), atol=1e-9)


def test_a_picture_laid_over_the_mesh_is_itself_from_where_it_was_taken(subject: Subject):
    model = subject.model
    picture = display_u8(subject.render(subject.default_lights).radiance, model.exposure)
    again = seen_from(subject.scene, model, model.camera, picture)
    is_hit = subject.relighter.render(()).is_hit
    assert np.mean(np.abs(again.astype(int) - picture)[is_hit]) < 0.5  # the rays pass beside pixel centres


def test_from_elsewhere_it_is_the_same_scene(subject: Subject):
    model = subject.model
    flat = np.zeros((model.camera.height, model.camera.width, 3), np.uint8)
    surface = np.full(model.camera.num_pixels, -1)
    surface[model.pixels.points.pixel] = model.pixels.surface
    flat[(surface == 2).reshape(flat.shape[:2])] = 250
    moved = orbited(model.camera, model.mesh.center, UP, 0.3, 0.1)
    there = seen_from(subject.scene, model, moved, flat)
    middle = moved.project(np.array([[0.45, -0.15, 0.35]]))[0][0].astype(int)  # of the sphere
    assert (there[middle[1], middle[0]] > 200).all()


def test_vertices_take_the_colours_of_the_picture(model: RelightModel):
    white = np.full((model.camera.height, model.camera.width, 3), 255, np.uint8)
    colors = vertex_colors(model, white)
    assert colors.shape == (len(model.mesh.vertices), 3) and colors.dtype == np.float32
    np.testing.assert_allclose(colors, 1.0, atol=1e-6)  # seen ones by the picture, the others by their surface's mean

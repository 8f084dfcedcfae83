"""Pixels that the mesh covers only in part: their share of it, what stands beside it, and an albedo of their own."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from relight3d.camera import Camera
from relight3d.evaluate.scenes import desk_scene
from relight3d.evaluate.truth import true_model
from relight3d.records import RelightModel
from relight3d.recover.mesh import MeshOptions
from relight3d.recover.run import RecoverOptions, recover
from relight3d.shading import ray_scene
from relight3d.views import View, ViewOptions, build_view
from tests.plan.models import plain_model
from tests.scenes import desk_capture, desk_truth


@cache
def model() -> RelightModel:
    return true_model(desk_scene(60, 45, textured=True))


def view_of(model: RelightModel, camera: Camera | None = None, **options) -> View:
    return build_view(ray_scene(model.mesh), model, camera or model.camera, ViewOptions(**options))


def shares(view: View) -> np.ndarray:
    """How much of each pixel the view's points stand for (the scene has no mirror)."""
    return np.bincount(view.points.pixel, view.throughput[:, 0], view.camera.num_pixels)


def covered(model: RelightModel, side: int = 32) -> np.ndarray:
    """The share of each pixel that sees the mesh, from side x side rays."""
    camera = model.camera
    hit = view_of(model, camera.resized(camera.width * side, camera.height * side), edge_samples=1).is_hit
    return hit.reshape(camera.height, side, camera.width, side).mean(axis=(1, 3)).ravel()


def test_before_black_a_pixel_has_the_share_that_the_mesh_covers():
    black = replace(model(), outlines_end="black")
    view = view_of(black)
    part, wanted = shares(view), covered(black)
    outline = view.is_hit.ravel() & (wanted < 1)
    assert outline.sum() > 20
    # 16 rays a pixel, no two in a row or a column; 4 in a grid are off by up to a quarter.
    assert np.abs(part - wanted)[outline].mean() < 0.045
    assert np.abs(part - wanted)[view.is_hit.ravel()].max() < 0.13


def test_before_more_of_the_object_a_pixel_is_all_mesh():
    view = view_of(model())
    assert np.allclose(shares(view)[view.is_hit.ravel()], 1.0, atol=1e-6)


@pytest.mark.parametrize("end", ["black", "object"])
def test_a_side_of_an_outline_has_the_share_that_it_covers(end):
    """Of a pixel that two surfaces share, as many rays tell the shares as would take four times the points."""
    scene = replace(model(), outlines_end=end)
    view, fine = view_of(scene), view_of(scene, scene.camera.resized(60 * 16, 45 * 16), edge_samples=1)
    label = np.full(fine.camera.num_pixels, -1)
    label[fine.points.pixel] = fine.surface
    label = label.reshape(45, 16, 60, 16).transpose(0, 2, 1, 3).reshape(45 * 60, 256)
    for surface in range(scene.surfaces.num_surfaces):
        mine = view.surface == surface
        part = np.bincount(view.points.pixel[mine], view.throughput[mine, 0], view.camera.num_pixels)
        wanted = (label == surface).mean(axis=1)
        mixed = (wanted > 0) & (wanted < 1) & (label >= 0).all(axis=1) & view.is_hit.ravel()
        assert np.abs(part - wanted)[mixed].mean() < 0.045
    assert len(view.points) < 1.2 * len(view_of(scene, edge_samples=1).points) * 4


def test_recovery_tells_what_is_beside_the_mesh():
    """Two objects photographed before nothing."""
    assert plain_model().outlines_end == "black"


def test_an_outline_of_a_textured_surface_has_an_albedo_of_its_own():
    """The surface's mean is another shade than either of a checkered table's squares."""
    truth = desk_truth(textured=True)
    found = recover(desk_capture(textured=True), RecoverOptions(mesh=MeshOptions(target_faces=1200)), quiet=True)
    table = truth.object_id == 0
    is_outline = table & ~binary_erosion(table, np.ones((3, 3)))
    albedo = np.zeros((found.camera.num_pixels, 3))
    albedo[found.pixels.points.pixel] = found.pixels.albedo
    error = np.abs(albedo.reshape(truth.albedo.shape) / np.maximum(truth.albedo, 1e-6) - 1).mean(axis=2)
    assert is_outline.sum() > 100
    assert np.median(error[is_outline]) < 0.1

"""Which pixels are cut into several points, and what part of the pixel each has."""

import numpy as np
import pytest

from relight3d.camera import Camera
from relight3d.outlines import grid_places, is_break
from relight3d.records import RelightModel, ShadingPoints
from relight3d.shading import NUDGE_PX, points_along, ray_scene
from relight3d.views import View, ViewOptions, build_view
from tests.relight import models


def view_of(model: RelightModel, camera: Camera, samples: int = 4) -> View:
    return build_view(ray_scene(model.mesh), model, camera, ViewOptions(edge_samples=samples))


def looked_through(model: RelightModel, camera: Camera, pixel: np.ndarray, samples: int) -> ShadingPoints:
    """What rays through all places of some pixels see."""
    corner = np.stack([pixel % camera.width, pixel // camera.width], axis=1)
    places = (corner[:, None] + grid_places(samples) + NUDGE_PX).reshape(-1, 2)
    return points_along(ray_scene(model.mesh), model.mesh, camera, np.repeat(pixel, samples), places)


@pytest.mark.parametrize("samples", [4, 9])
@pytest.mark.parametrize("where", ["captured", "beside"])
def test_a_pixel_is_cut_only_where_it_shows_several_things(where: str, samples: int) -> None:
    model = models.full()
    camera = model.camera if where == "captured" else models.other_camera(model)
    view, middle = view_of(model, camera, samples), view_of(model, camera, samples=1)
    pixel, count = np.unique(view.points.pixel, return_counts=True)
    cut = pixel[count > 1]
    assert len(cut) > 50
    point = np.full(camera.num_pixels, -1)
    point[middle.points.pixel] = np.arange(len(middle.points))
    at, ours, theirs = point[view.points.pixel], view.points, middle.points
    differs = is_break(ours.depth, theirs.depth[at], ours.normal, theirs.normal[at]) | (at < 0)
    differs |= (view.surface != middle.surface[at]) | (view.is_mirrored != middle.is_mirrored[at])
    shows_several = np.isin(cut, view.points.pixel[differs]) | np.isin(cut, view.miss_pixel)
    ends = looked_through(model, camera, cut, samples=24**2)
    ends_beside_the_mesh = np.bincount(ends.pixel, minlength=camera.num_pixels)[cut] < 24**2
    # One in hundreds has a sliver beside the mesh that none of these rays meets.
    assert (shows_several | ends_beside_the_mesh).mean() > 0.99


def test_a_pixel_beside_an_outline_is_a_point_with_neighbours() -> None:
    model = models.plain()
    camera = models.other_camera(model)
    view, plain = view_of(model, camera), view_of(model, camera, samples=1)
    count = np.bincount(view.points.pixel, minlength=camera.num_pixels)
    grid = np.full(camera.num_pixels, -1)
    grid[plain.points.pixel] = plain.surface
    grid = grid.reshape(camera.height, camera.width)
    beside = np.zeros_like(grid, bool)
    beside[:, :-1] |= grid[:, :-1] != grid[:, 1:]
    beside[:, 1:] |= grid[:, :-1] != grid[:, 1:]
    whole = beside.ravel() & (count == 1) & (grid.ravel() >= 0)
    assert whole.sum() > 0.3 * (beside.ravel() & (grid.ravel() >= 0)).sum()
    assert (view.neighbour[np.isin(view.points.pixel, np.flatnonzero(whole))] >= 0).any(axis=1).mean() > 0.9


@pytest.mark.parametrize("samples", [4, 9])
def test_shares_are_those_of_rays_through_all_places(samples: int) -> None:
    model = models.plain()
    camera = models.other_camera(model)
    view = view_of(model, camera, samples)
    pixel, count = np.unique(view.points.pixel, return_counts=True)
    pixel = pixel[count > 1]
    ends = looked_through(model, camera, pixel, samples)
    num = model.surfaces.num_surfaces

    def shares(of_pixel: np.ndarray, surface: np.ndarray, share: np.ndarray) -> np.ndarray:
        out = np.bincount(of_pixel * num + surface, share, camera.num_pixels * num)
        return out.reshape(-1, num)[pixel]

    all_places = shares(ends.pixel, model.surfaces.surface_of_face[ends.face], np.ones(len(ends)))
    all_places /= all_places.sum(axis=1, keepdims=True)
    ours = shares(view.points.pixel, view.surface, view.throughput[:, 0])
    np.testing.assert_allclose(ours.sum(axis=1), 1.0, atol=1e-5)
    # The sphere's outline is round: a place on the far side of a middle may be cut off by it.
    is_other = np.abs(ours - all_places).max(axis=1) > 1e-4
    assert is_other.mean() < 0.05
    assert np.abs(ours - all_places)[is_other].max(initial=0) < 1.01 / samples

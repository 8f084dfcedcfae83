"""Texture where hardly any light falls, from photographs in which all of a panel is in shadow."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.camera import Camera
from relight3d.evaluate.scenes import Material, Scene, hemisphere_lights, scene_camera
from relight3d.evaluate.shapes import box, joined, plane, transformed, turn_about
from relight3d.evaluate.synthetic import synthesize
from relight3d.evaluate.truth import truth_of
from relight3d.records import Observations, ShadingPoints
from relight3d.recover.rounds.alternation import _medians_by_owner, _shares_of_surface
from relight3d.recover.run import recover
from relight3d.recover.shade import ShadeTexture, texture_in_shade
from relight3d.recover.surfaces import neighbours
from tests.plan.models import QUICK

WIDTH, HEIGHT, PHOTOS = 40, 30, 4
X, Y = (each.ravel() for each in np.meshgrid(np.linspace(-1, 1, WIDTH), np.linspace(-1, 1, HEIGHT)))
STRIPES = np.where((np.arange(WIDTH * HEIGHT) % WIDTH // 4 % 2 == 0)[:, None], [1.0, 1.0, 1.0], [0.3, 0.5, 0.9])
# Light from beside, from above and from a corner, three times as strong as at its weakest.
INDIRECT = np.stack([np.exp(0.5 * X), np.exp(-0.5 * Y), np.exp(0.4 * X * Y), np.exp(-0.5 * X**2)])


def found_in(
    texture: np.ndarray, light: np.ndarray, direct: np.ndarray | None = None, noise: float = 0.01, asked: float = 1.0
) -> ShadeTexture:
    """What is found of a flat panel (point x 3, or photo x point x 3 albedos) under light (photo x point)."""
    num = WIDTH * HEIGHT
    rng = np.random.default_rng(0)
    direct = np.zeros((PHOTOS, num, 1), np.float32) if direct is None else direct
    radiance = np.broadcast_to(texture, (PHOTOS, num, 3)) * (light[..., None] + direct)
    radiance = (radiance * rng.normal(1.0, noise, radiance.shape)).astype(np.float32)
    up, yes = np.tile(np.float32([0, 0, 1]), (num, 1)), np.ones((PHOTOS, num), bool)
    points = ShadingPoints(
        pixel=np.arange(num, dtype=np.int32), face=np.zeros(num, np.int32),
        barycentric=np.full((num, 3), 1 / 3, np.float32), position=np.stack([X, Y, 0 * X], 1).astype(np.float32),
        geometric_normal=up, normal=up, to_viewer=up, depth=np.full(num, 2.0, np.float32),
    )  # fmt: skip
    observed = Observations(
        radiance, yes.astype(np.float32), np.ones((PHOTOS, 3)), ((),) * PHOTOS, direct, None, direct[..., 0] > 0, yes, yes,
        ~yes, np.ones(num, bool),
    )  # fmt: skip
    near = neighbours(points, Camera(WIDTH, HEIGHT, 40.0, 40.0, WIDTH / 2, HEIGHT / 2))
    panel, is_asked = np.zeros(num, np.int32), np.arange(num) < asked * num
    return texture_in_shade(observed, radiance, direct, points, panel, is_asked, near, white=1.0)


@pytest.mark.parametrize("scale", [1.0, 0.02])
def test_stripes_are_found_without_a_lit_photograph(scale: float) -> None:
    found = found_in(STRIPES, scale * INDIRECT)
    assert found.is_found.all()
    ink, albedo = STRIPES[:, 0] < 1, 1 + found.away
    np.testing.assert_allclose(albedo[ink].mean(axis=0) / albedo[~ink].mean(axis=0), [0.3, 0.5, 0.9], rtol=0.08)
    np.testing.assert_allclose(albedo / albedo[~ink].mean(axis=0), STRIPES, rtol=0.3)  # slow functions take some of it


def test_lit_photographs_tell_too() -> None:
    direct = np.zeros((PHOTOS, WIDTH * HEIGHT, 1), np.float32)
    direct[2, X < 0], direct[3] = 4.0, 2.0
    light = INDIRECT.copy()
    light[2:] *= 0.05
    found = found_in(STRIPES, light, direct)
    assert found.is_found.all()
    assert np.corrcoef(1 + found.away[:, 0], STRIPES[:, 0])[0, 1] > 0.95


def test_what_is_no_texture_is_not_found() -> None:
    plain = np.ones_like(STRIPES)
    corner = 1 - 0.7 * np.exp(-(1 + X) / 0.2)  # of a wall: as dark in all photographs, but slowly
    for light in (INDIRECT, INDIRECT * corner):
        assert not found_in(plain, light).is_found.any()
    assert not found_in(plain, INDIRECT, noise=0.3).is_found.any()
    moving = np.stack([np.roll(STRIPES.reshape(HEIGHT, WIDTH, 3), 2 * k, axis=1).reshape(-1, 3) for k in range(PHOTOS)])
    assert not found_in(moving, INDIRECT).is_found.any()  # bright spots thrown by something, one in each photograph
    assert not found_in(STRIPES, 1e-4 * INDIRECT).is_found.any()  # too dark to tell
    for few in (0.0, 0.2):  # where most of a panel is told, the rest is better told by what is beside it
        assert not found_in(STRIPES, INDIRECT, asked=few).is_found.any()
    assert found_in(STRIPES, INDIRECT, asked=0.3).is_found.all()
    nothing = found_in(0 * STRIPES, INDIRECT)
    assert not nothing.is_found.any() and (nothing.away == 0).all()


def test_a_panel_leans_on_others_as_far_as_they_know_more() -> None:
    """A surface of one panel has nobody to lean on, however little light it gets."""
    information, owner = np.array([4.0, 4.0, 1.0, 1.0, 0.5, 0.0]), np.array([0, 0, 1, 1, 2, 4])
    of_owner = np.array([0, 0, 1, 0, 2])  # the fourth is not seen, the last not lit
    np.testing.assert_allclose(_shares_of_surface(information, owner, of_owner), [0.8, 0.2, 1.0, 0.0, 1.0])
    told = np.array([0.9, 0.7, 0.1, 0.3, 0.2, 0.0])
    np.testing.assert_allclose(_medians_by_owner(told, owner, 5), [0.9, 0.3, 0.2, 0.0, 0.0])


def test_a_side_that_no_light_reaches_keeps_its_print() -> None:
    """Where light hardly falls a texture leant on its mean: a box's side was left plain, in shadow and in light."""
    parts = {
        "table": plane(2.4, 2.0, 6, 5),
        "box": transformed(box(0.9, 0.6, 0.6), turn_about("z", 30.0), (0.0, 0.0, 0.3)),
    }
    checkers = Material((0.2, 0.25, 0.5), checker_albedo=(0.7, 0.6, 0.3), num_checkers=6)
    scene = Scene(joined(parts), (Material((0.6, 0.55, 0.5)), checkers), scene_camera(96, 72))
    front = np.array([np.sin(np.radians(30)), -np.cos(np.radians(30)), 0.0])
    from_behind = [each for each in hemisphere_lights(60, 15.0, 70.0, seed=1) if each[0].to_light @ front < -0.1][:6]
    model = recover(synthesize(scene, from_behind, num_bounce_rays=64), replace(QUICK, num_rounds=0), quiet=True)
    points, truth = model.pixels.points, truth_of(scene).albedo.reshape(-1, 3)
    side = (model.pixels.surface == 1) & (points.geometric_normal @ front > 0.9)
    assert (model.pixels.num_lit[side] == 0).all()
    assert side.sum() > 100
    albedo, given = model.pixels.albedo[side], truth[points.pixel[side]]
    is_ink = given[:, 0] < 0.3
    ratio = np.median(albedo[is_ink], axis=0) / np.median(albedo[~is_ink], axis=0)
    np.testing.assert_allclose(ratio, np.array([0.2, 0.25, 0.5]) / np.array([0.7, 0.6, 0.3]), rtol=0.25)

"""De-lit texture by eq. (2), face by face."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.camera import Camera
from relight3d.evaluate.scenes import Material, Scene, hemisphere_lights, scene_camera
from relight3d.evaluate.shapes import joined, plane, sphere, transformed, turn_about
from relight3d.evaluate.synthetic import synthesize
from relight3d.evaluate.truth import truth_of
from relight3d.records import Observations, ShadingPoints
from relight3d.recover.run import recover
from relight3d.recover.texture import TextureOptions, by_reciprocals, left_out_gain, unlike_share
from tests.plan.models import QUICK, rich_capture
from tests.scenes import metal_capture


def face_of_pixels(rng: np.random.Generator, sizes: list[int]) -> np.ndarray:
    face = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
    return face[rng.permutation(len(face))]


def test_ratios_inside_a_face_are_found_and_its_mean_is_kept() -> None:
    rng = np.random.default_rng(0)
    face = face_of_pixels(rng, [1, 4, 4, 7, 12])
    num, photos = len(face), 8
    truth = rng.uniform(0.1, 0.8, (num, 3)).astype(np.float32)
    direct = rng.uniform(0.2, 2.0, (photos, num, 1)).astype(np.float32)
    indirect = rng.uniform(0.05, 0.3, (photos, 5, 3)).astype(np.float32)[:, face]
    target = (truth / np.pi * (direct + indirect)).astype(np.float32)
    weight = np.ones((photos, num), np.float32)
    weight[3, 5] = 0.0  # a pixel that is not to be believed there: the photograph is left out for its face
    target[3, 5] = 50.0
    guess = np.full((num, 3), 0.4, np.float32)
    found = by_reciprocals(target, weight, direct, face, guess)
    for index in range(5):
        mine = face == index
        np.testing.assert_allclose(found[mine].mean(axis=0), 0.4, rtol=1e-5)
        if mine.sum() > 1:
            # float32 photographs, condition about 100.
            np.testing.assert_allclose(
                found[mine] / found[mine].mean(axis=0), truth[mine] / truth[mine].mean(axis=0), rtol=1e-3
            )


def test_dark_faces_and_large_ones_keep_what_they_have() -> None:
    rng = np.random.default_rng(1)
    face = face_of_pixels(rng, [5, 9])
    guess = rng.uniform(0.1, 0.8, (14, 3)).astype(np.float32)
    nothing, ones = np.zeros((3, 14, 3), np.float32), np.ones((3, 14), np.float32)
    np.testing.assert_array_equal(by_reciprocals(nothing, ones, np.ones((3, 14, 1), np.float32), face, guess), guess)
    lit = rng.uniform(0.1, 1.0, (3, 14, 3)).astype(np.float32)
    few = by_reciprocals(lit, ones, rng.uniform(0.5, 1, (3, 14, 1)).astype(np.float32), face, guess, max_pixels=4)
    np.testing.assert_array_equal(few, guess)


def test_recovery_by_the_papers_equation_is_close_to_the_default() -> None:
    capture = rich_capture()
    ours, papers = (
        recover(capture, replace(QUICK, texture=TextureOptions(method=method)), quiet=True)
        for method in ("alternating", "reciprocal")
    )
    textured = [s for s, kinds in enumerate(ours.surfaces.kinds) if "textured" in kinds]
    assert textured
    mine = np.isin(ours.pixels.surface, textured) & (ours.pixels.num_lit > 3)
    difference = np.abs(papers.pixels.albedo[mine] / np.maximum(ours.pixels.albedo[mine], 1e-3) - 1)
    assert 0 < np.median(difference) < 0.1


@pytest.mark.parametrize("method", ["", "eq2"])
def test_other_methods_are_refused(method: str) -> None:
    from relight3d.errors import InputError

    with pytest.raises(InputError, match=r"texture\.method"):
        TextureOptions(method=method)


def test_a_highlight_in_one_photograph_does_not_make_a_texture_doubtful() -> None:
    """What a lobe misses in one photograph of nine drowns the gain there: by folds its scatter is 4 dB of a gain of 6."""
    rng = np.random.default_rng(3)
    photos, num = 9, 400
    albedo = np.repeat(rng.choice([0.2, 0.5], num)[:, None], 3, axis=1)
    light = np.repeat(rng.uniform(1.0, 3.0, (photos, 1, 3)), num, axis=1)
    target = albedo / np.pi * light * rng.normal(1.0, 0.02, (photos, num, 3))
    target[4] += rng.uniform(0.0, 0.5, (num, 1))
    arrays = [a.astype(np.float32) for a in (target, np.ones((photos, num)), light)]
    (gain, by_folds, error), *none = left_out_gain(*arrays, np.zeros(num, np.int32), 2, white=1.0)
    assert 3 * by_folds > gain > 3 * error > 0
    assert none == [(0.0, 0.0, 0.0)]
    flat = (0.3 / np.pi * light * rng.normal(1.0, 0.02, (photos, num, 3))).astype(np.float32)
    ((gain, _, _),) = left_out_gain(flat, *arrays[1:], np.zeros(num, np.int32), 1, white=1.0)
    assert gain < 0


WIDTH, HEIGHT, PHOTOS = 80, 60, 6


def wall_seen(albedo: np.ndarray, indirect: np.ndarray) -> tuple[Observations, ShadingPoints, Camera]:
    """A wall that fills the picture (row x column x 3 albedos), lit evenly, a sixth of it in shadow in each photograph."""
    num = WIDTH * HEIGHT
    form = np.repeat(np.linspace(0.5, 1.0, PHOTOS, dtype=np.float32)[:, None, None], num, axis=1)
    is_lit = np.arange(num)[None] % WIDTH // 14 != np.arange(PHOTOS)[:, None]
    light = form * is_lit[..., None] + indirect.reshape(1, num, 1)
    radiance = (albedo.reshape(num, 3) / np.pi * light).astype(np.float32)
    yes, ones = np.ones((PHOTOS, num), bool), np.ones((PHOTOS, num), np.float32)
    points = ShadingPoints(
        pixel=np.arange(num, dtype=np.int32), face=np.zeros(num, np.int32),
        barycentric=np.full((num, 3), 1 / 3, np.float32), position=np.zeros((num, 3), np.float32),
        geometric_normal=np.tile(np.float32([0, 0, 1]), (num, 1)), normal=np.tile(np.float32([0, 0, 1]), (num, 1)),
        to_viewer=np.tile(np.float32([0, 0, 1]), (num, 1)), depth=np.ones(num, np.float32),
    )  # fmt: skip
    observed = Observations(
        radiance, ones, np.ones((PHOTOS, 3)), ((),) * PHOTOS, form * is_lit[..., None], None, is_lit, yes, yes, ~yes,
        np.ones(num, bool),
    )  # fmt: skip
    return observed, points, Camera(WIDTH, HEIGHT, 80.0, 80.0, WIDTH / 2, HEIGHT / 2)


def unlike_of(albedo: np.ndarray, indirect: np.ndarray, is_matte: bool = True) -> float:
    observed, points, camera = wall_seen(albedo, indirect)
    surface, matte = np.zeros(len(points), np.int32), np.full(len(points), is_matte)
    return float(unlike_share(observed, points, surface, matte, observed.form, camera, 1)[0])


def test_two_paints_are_told_from_light_that_comes_from_beside() -> None:
    """A paint has an edge; what a wall close by sends over has none, as strong as it may be."""
    none, right = np.zeros((HEIGHT, WIDTH)), np.arange(WIDTH) >= 50
    two = np.where(right[None, :, None], [0.2, 0.3, 0.5], [0.6, 0.55, 0.5]) * np.ones((HEIGHT, 1, 1))
    one, slope = np.full((HEIGHT, WIDTH, 3), 0.5), np.linspace(0, 2.5, WIDTH) ** 2 * np.ones((HEIGHT, 1))
    assert unlike_of(two, none) == pytest.approx(30 / 80, abs=0.05)
    assert unlike_of(two, 0.1 * slope) > 0.25
    assert unlike_of(one, slope) == 0.0  # up to six times the direct light
    assert unlike_of(one, none) == 0.0
    assert unlike_of(two, none, is_matte=False) == 0.0  # a mirror shows what it likes
    noisy = one * np.random.default_rng(0).normal(1.0, 0.3, one.shape)
    assert unlike_of(noisy, none) == 0.0


@pytest.mark.parametrize("num_lights", [6, 12])
def test_a_wall_of_two_paints_is_no_wall_of_one(num_lights: int) -> None:
    """Its step is few pixels long: taken for one albedo at first, the other paint was counted as indirect light."""
    parts = {
        "wall": transformed(plane(2.0, 1.4, 8, 8), turn_about("x", 90.0), (0.0, 0.6, 0.7)),
        "floor": plane(2.4, 1.6, 8, 8),
        "ball": transformed(sphere(0.25), None, (0.3, 0.1, 0.25)),
    }
    paints = Material((0.1, 0.3, 0.35), checker_albedo=(0.7, 0.65, 0.5), num_checkers=2)
    camera = scene_camera(96, 72, eye=(0.0, -3.2, 1.3), target=(0.0, 0.2, 0.6))
    scene = Scene(joined(parts), (paints, Material((0.4, 0.36, 0.3)), Material((0.8, 0.8, 0.78))), camera)
    from_the_front = [each for each in hemisphere_lights(40, 15.0, 70.0, seed=1) if each[0].to_light[1] < -0.2]
    model = recover(synthesize(scene, from_the_front[:num_lights], num_bounce_rays=48), QUICK, quiet=True)
    wall = model.pixels.surface == 0
    truth = truth_of(scene).albedo.reshape(-1, 3)[model.pixels.points.pixel[wall]]
    assert np.median(np.abs(model.pixels.albedo[wall] / truth - 1)) < 0.027  # 0.035 and 0.038 before


def test_a_panel_that_lobes_explain_whole_keeps_an_albedo() -> None:
    """Of an albedo next to nothing, indirect light would be endless: a metal pot's rim blazed under every light."""
    model = recover(metal_capture(0.02), replace(QUICK, num_rounds=2), quiet=True)
    assert model.indirect is not None
    assert np.abs(model.indirect.coefficients).max() < 200.0
    assert model.pixels.albedo.min() > 1e-4

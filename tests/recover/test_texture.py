"""De-lit texture by eq. (2), face by face."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.recover.run import recover
from relight3d.recover.texture import TextureOptions, by_reciprocals, left_out_gain
from tests.plan.models import QUICK, rich_capture


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

"""The contract's metrics, against hand-made values and against the libraries on whole pictures."""

import flip_evaluator
import numpy as np
import pytest
from skimage.metrics import structural_similarity

from relight3d.errors import InputError
from relight3d.evaluate.metrics import (
    PSNR_CEILING_DB,
    FrameMetrics,
    Metrics,
    capture_exposure,
    display_values,
    flip_map,
    measure_frame,
    psnr_db,
    relative_rmse,
    ssim_map,
)

ALL = np.ones((24, 32), bool)


def picture(seed: int = 0, low: float = 0.05, high: float = 0.9) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(low, high, (24, 32, 3)).astype(np.float32)


def frame(name: str, group: str, figure: float) -> FrameMetrics:
    return FrameMetrics(name, group, 10, figure, figure / 100, 1 - figure / 100, 1 / figure)


def test_psnr_of_known_noise():
    image = np.full((200, 200, 3), 0.5)
    noise = 0.02 * np.random.default_rng(0).standard_normal(image.shape)
    # 120,000 draws: the variance is known to 0.4 %, which is 0.02 dB.
    assert psnr_db(image + noise, image) == pytest.approx(-20 * np.log10(0.02), abs=0.05)


def test_psnr_of_a_constant_difference_is_exact():
    assert psnr_db(np.full(10, 0.6), np.full(10, 0.5)) == pytest.approx(20.0, abs=1e-9)


def test_equal_pictures_have_finite_figures():
    image = picture()
    got = measure_frame("a", image, image, ALL, 1.0)
    assert (got.psnr_db, got.relative_rmse, got.flip) == (PSNR_CEILING_DB, 0.0, 0.0)
    assert got.ssim == pytest.approx(1.0, abs=1e-6)


def test_relative_rmse_of_a_scaled_picture_is_the_scale():
    image = picture()
    assert relative_rmse(1.1 * image, image, floor=0.0) == pytest.approx(0.1, rel=1e-6)
    # Against black the floor counts, so that the figure is finite.
    assert relative_rmse(np.full(3, 0.5), np.zeros(3), floor=0.25) == pytest.approx(2.0)


def test_whole_pictures_agree_with_the_libraries():
    image, reference = picture(1), picture(2)
    shown, wanted = display_values(image, 1.0), display_values(reference, 1.0)
    got = measure_frame("a", image, reference, ALL, 1.0)
    _, similarity = structural_similarity(wanted, shown, data_range=1.0, channel_axis=-1, full=True)
    assert got.ssim == pytest.approx(float(similarity.mean()), abs=1e-6)
    per_channel = [structural_similarity(wanted[..., c], shown[..., c], data_range=1.0, full=True)[1] for c in range(3)]
    assert got.ssim == pytest.approx(float(np.mean(per_channel)), abs=1e-5)
    _, mean, _ = flip_evaluator.evaluate(wanted, shown, "LDR")
    assert got.flip == pytest.approx(mean, abs=1e-5)
    assert got.psnr_db == pytest.approx(-10 * np.log10(np.mean((shown - wanted) ** 2)), abs=1e-3)


def test_maps_have_one_value_a_pixel():
    image, reference = picture(1), picture(2)
    assert ssim_map(image, reference).shape == flip_map(image, reference).shape == (24, 32)


@pytest.mark.parametrize("shape", [(1, 1), (2, 2), (1, 20), (4, 6)])
def test_pictures_smaller_than_the_window_have_figures(shape: tuple[int, int]):
    """Windows of 3 pixels and more, those of a picture of one or two pixels over its doubled edge."""
    image, reference = (picture(seed)[: shape[0], : shape[1]] for seed in (1, 2))
    assert ssim_map(image, reference).shape == shape
    other = measure_frame("a", image, reference, np.ones(shape, bool), 1.0)
    same = measure_frame("a", image, image, np.ones(shape, bool), 1.0)
    assert same.ssim == pytest.approx(1.0, abs=1e-6) and same.psnr_db == PSNR_CEILING_DB
    assert -1.0 <= other.ssim < 0.95 and other.flip > 0.0


def test_nothing_outside_the_mask_counts():
    image, reference, mask = picture(1), picture(2), ALL.copy()
    mask[:, :9] = False
    other_image, other_reference = image.copy(), reference.copy()
    other_image[~mask], other_reference[~mask] = 7.0, np.nan
    before, after = (
        measure_frame("a", *pair, mask, 1.0) for pair in ((image, reference), (other_image, other_reference))
    )
    assert before == after
    assert before.num_pixels == mask.sum()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("which", ["rendered radiance", "photograph"])
def test_a_hole_in_a_frame_is_an_error(bad: float, which: str):
    image, reference = picture(1), picture(2)
    (image if which == "rendered radiance" else reference)[3, 4, 1] = bad
    with pytest.raises(InputError, match=f"frame a: {which}: got 1 pixels"):
        measure_frame("a", image, reference, ALL, 1.0)


def test_an_empty_mask_is_an_error():
    with pytest.raises(InputError, match="no pixel"):
        measure_frame("a", picture(), picture(), ~ALL, 1.0)


def test_one_exposure_for_all_frames_over_their_masks():
    images = [np.full((10, 10, 3), value, np.float32) for value in (1.0, 4.0)]
    whole = np.ones((10, 10), bool)
    assert capture_exposure(images, [whole, whole]) == pytest.approx(1 / 4)
    # Masked away, the brighter frame says nothing.
    assert capture_exposure(images, [whole, ~whole]) == pytest.approx(1.0)
    ramp = np.linspace(0, 1, 3000, dtype=np.float32).reshape(10, 100, 3)
    assert capture_exposure([ramp], [np.ones((10, 100), bool)]) == pytest.approx(1 / 0.995, rel=1e-3)


def test_display_values_are_clipped_and_encoded():
    shown = display_values(np.array([[-1.0, 0.0, 0.5], [1.0, 2.0, 0.25]], np.float32), 2.0)
    assert shown[0] == pytest.approx([0.0, 0.0, 1.0])
    assert shown[1, 2] == pytest.approx(0.7354, abs=1e-4)  # sRGB of 0.5


def test_means_worst_frame_and_groups():
    metrics = Metrics((frame("a", "light", 30.0), frame("b", "view", 20.0), frame("c", "light", 40.0)))
    assert metrics.mean.psnr_db == pytest.approx(30.0)
    assert metrics.mean.num_frames == 3 and metrics.mean.num_pixels == 30
    assert metrics.worst.name == "b"
    assert {name: mean.psnr_db for name, mean in metrics.groups.items()} == {"light": 35.0, "view": 20.0}
    assert [row.name for row in metrics.rows()] == ["a", "b", "c", "light", "view", "mean"]
    assert metrics.only(["c", "b"]).mean.psnr_db == pytest.approx(30.0)
    assert metrics.to_dict()["worst"]["psnr_db"] == 20.0

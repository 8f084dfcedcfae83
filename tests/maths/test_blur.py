"""Means over the pixels that are known."""

import numpy as np
from scipy.ndimage import gaussian_filter

from relight3d.maths.blur import blur_known

SHAPE, PIXEL = (9, 11), np.arange(99, dtype=np.int32)


def test_unknown_pixels_do_not_count() -> None:
    rng = np.random.default_rng(0)
    values, is_known = np.full((99, 2), (3.0, -1.0), np.float32), rng.random(99) > 0.4
    values[~is_known] = np.nan
    blurred = blur_known(values, is_known, PIXEL, SHAPE, 1.5)
    assert blurred.shape == (2, *SHAPE)
    np.testing.assert_allclose(blurred[0], 3.0, rtol=1e-5)
    np.testing.assert_allclose(blurred[1], -1.0, rtol=1e-5)


def test_where_all_is_known_it_is_a_gaussian() -> None:
    picture = np.random.default_rng(1).random(SHAPE).astype(np.float32)
    blurred = blur_known(picture.reshape(-1, 1), np.ones(99, bool), PIXEL, SHAPE, 1.0)
    np.testing.assert_allclose(blurred[0], gaussian_filter(picture, 1.0), rtol=1e-5)

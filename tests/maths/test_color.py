"""The sRGB curve against its standard (IEC 61966-2-1), and what no curve is defined for."""

import numpy as np
import pytest

from relight3d.maths.color import display_u8, exposure_of, linear_from_srgb, luminance, srgb_from_linear

# Linear and encoded: black, the end of the straight part, a tenth, middle grey, a half, white.
PAIRS = np.array([(0.0, 0.0), (0.0031308, 0.04045), (0.1, 0.349190), (0.18, 0.461356), (0.5, 0.735357), (1.0, 1.0)])


def test_both_ways_are_the_standards() -> None:
    np.testing.assert_allclose(srgb_from_linear(PAIRS[:, 0]), PAIRS[:, 1], atol=1e-6)  # the table has six digits
    np.testing.assert_allclose(linear_from_srgb(PAIRS[:, 1]), PAIRS[:, 0], atol=2e-6)


def test_there_and_back_is_the_same() -> None:
    values = np.linspace(0.0, 1.0, 4096, dtype=np.float32)
    back = linear_from_srgb(srgb_from_linear(values))
    assert back.dtype == np.float32
    np.testing.assert_allclose(back, values, atol=5e-7)  # float32, through a power of 2.4


def test_what_no_display_shows_is_clipped() -> None:
    shown = srgb_from_linear(np.array([-1.0, -np.inf, np.nan, 1.5, np.inf]))
    np.testing.assert_allclose(shown, [0.0, 0.0, 0.0, 1.0, 1.0], atol=1e-15)
    np.testing.assert_array_equal(linear_from_srgb(np.array([-0.1292])), [-0.01])  # noise about black stays


def test_luminance_is_that_of_bt709() -> None:
    np.testing.assert_allclose(luminance(np.eye(3)), [0.2126, 0.7152, 0.0722], atol=1e-7)
    assert luminance(np.ones((2, 4, 3), np.float32)) == pytest.approx(np.ones((2, 4)), abs=1e-6)


def test_the_exposure_shows_a_percentile_as_white() -> None:
    values = np.append(np.linspace(0.0, 4.0, 1001), [np.nan, np.inf])
    assert exposure_of(values) == pytest.approx(1 / (0.995 * 4.0))
    assert exposure_of(values, 50.0) == pytest.approx(0.5)
    assert exposure_of(1e-6 * values) == pytest.approx(1e6 / (0.995 * 4.0))  # radiance has a unit of its own
    # Nothing to expose for: a factor that changes nothing.
    assert exposure_of(np.zeros(3)) == exposure_of(np.zeros(0)) == exposure_of(np.full(2, np.nan)) == 1.0


def test_display_values_are_rounded_not_cut() -> None:
    bytes_of = display_u8(linear_from_srgb(np.array([0.0, 100.4, 100.6, 255.0]) / 255) / 2, exposure=2.0)
    assert bytes_of.dtype == np.uint8
    np.testing.assert_array_equal(bytes_of, [0, 100, 101, 255])

"""What carries over from photograph to photograph, judged by photographs left out of all fits."""

import numpy as np
import pytest

from relight3d.evaluate.scenes import hemisphere_lights
from relight3d.recover.residual import Misfits, ResidualOptions, choose_kernel

RNG = np.random.default_rng(5)


def lights(num: int) -> np.ndarray:
    return np.array([photo[0].to_light for photo in hemisphere_lights(num, 40.0, 85.0, seed=3)])


def left_by_the_fits(misfit: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    """What is left of a misfit after a fit of all that is linear in the light, as the indirect light's."""
    functions = np.column_stack([np.ones(len(anchors)), anchors])
    return misfit - np.einsum("ij,jpc->ipc", functions @ np.linalg.pinv(functions), misfit)


def chosen(misfit: np.ndarray, anchors: np.ndarray, shared: np.ndarray):
    """As of pixels that have an albedo of their own."""
    known = np.ones(misfit.shape[:2], bool)
    given = Misfits(misfit, shared, np.ones_like(misfit), known.astype(float), anchors)
    return choose_kernel(given, known, ResidualOptions())


def test_few_photographs_tell_a_misfit_that_fits_have_taken_half_of():
    """Eight photographs less four functions of the light no longer resemble their neighbours; the misfit still does."""
    anchors = lights(8)
    angle = np.arccos(np.clip(anchors @ anchors.T, -1.0, 1.0))
    root = np.linalg.cholesky(np.exp(-((angle / np.radians(50.0)) ** 2)) + 1e-9 * np.eye(8))
    misfit = left_by_the_fits(np.einsum("ij,jpc->ipc", root, RNG.normal(size=(8, 500, 3))), anchors)
    fit = chosen(misfit, anchors, misfit)
    assert fit.gain_db > 0.3 and np.degrees(fit.length_rad) >= 30.0
    assert chosen(misfit, anchors, np.zeros_like(misfit)).gain_db < 0.1  # as though no fit had been there


@pytest.mark.parametrize("num", [4, 8, 24])
def test_noise_does_not_carry_over(num):
    """Every pixel has its own, of which an albedo has taken the mean."""
    anchors = lights(num)
    noise = RNG.normal(size=(num, 500, 3))
    assert chosen(noise - noise.mean(axis=0), anchors, np.zeros_like(noise)).gain_db < 0.1


def test_noise_is_left_behind_where_what_pixels_share_carries_over():
    anchors = lights(16)
    shared = np.einsum("lk,kpc->lpc", anchors**2, RNG.normal(size=(3, 500, 3)))
    shared, noise = left_by_the_fits(shared, anchors), RNG.normal(size=(16, 500, 3))
    noise -= noise.mean(axis=0)
    quiet, loud = (chosen(shared + size * noise, anchors, shared) for size in (0.001, 0.3))
    assert loud.is_shared and loud.gain_db > 0.5
    assert quiet.gain_db > 3.0

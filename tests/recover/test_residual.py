"""What carries over from photograph to photograph, judged by photographs left out of all fits."""

import numpy as np
import pytest

from relight3d.evaluate.scenes import hemisphere_lights
from relight3d.recover.residual import (
    Misfits,
    ResidualFit,
    ResidualOptions,
    carries_over,
    choose_kernel,
    fit_residual,
    kernel,
)

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
    assert loud.own_nugget is not None and loud.own_nugget >= 5.0 and loud.gain_db > 0.5
    assert quiet.gain_db > 3.0


# ------------------------------------------------------------------------- by hand: one photograph after the other

LENGTH_DEG, NUGGET, UNSEEN = 60.0, 0.4, 1e-6
ONE_KERNEL = ResidualOptions(lengths_deg=(LENGTH_DEG,), nuggets=(NUGGET,), own_nuggets=(NUGGET,))


def kriged(to: np.ndarray, anchors: np.ndarray, values: np.ndarray, length_deg: float = LENGTH_DEG) -> np.ndarray:
    """What photographs `values` predict under other lights: K(to, anchors) (K + nugget)^-1 values."""
    length = np.radians(length_deg)
    system = kernel(anchors, anchors, length) + NUGGET * np.eye(len(anchors))
    return kernel(to, anchors, length) @ np.linalg.solve(system, values)


def missed(functions: np.ndarray, values: np.ndarray, photos: np.ndarray) -> np.ndarray:
    """What a least-squares fit of the functions of the light to some of the photographs misses of all of them."""
    return values - functions @ np.linalg.lstsq(functions[photos], values[photos], rcond=None)[0]


@pytest.mark.parametrize("num", [5, 12])
@pytest.mark.parametrize("is_shared", [True, False])
def test_photographs_are_left_out_of_the_fits_before_too(num: int, is_shared: bool) -> None:
    """As though all had been fitted again without each: all that is linear in the light (constant, with few lights) of
    what pixels share, an albedo of what is a pixel's own.
    """
    anchors, rng = lights(num), np.random.default_rng(2)
    functions = np.column_stack([np.ones(num), anchors]) if num >= 6 else np.ones((num, 1))
    light = rng.uniform(0.5, 1.5, (num, 3))
    whole = np.einsum("lk,kpc->lpc", kernel(anchors, anchors, 1.0), rng.normal(size=(num, 3, 3)))  # it carries over

    def left(point: int, photos: np.ndarray) -> np.ndarray:
        return missed(functions if is_shared else light[:, point, None], whole[:, point], photos)

    misfit = np.stack([left(point, np.arange(num)) for point in range(3)], axis=1)
    before, after = np.zeros(num), np.zeros(num)
    for photo in range(num):
        others = np.delete(np.arange(num), photo)
        for point in range(3):
            again = left(point, others)
            error = again[photo] - kriged(anchors[photo : photo + 1], anchors[others], again[others])[0]
            before[photo] += (again[photo] ** 2).sum()
            after[photo] += np.minimum(error**2, 4.0 * again[photo] ** 2).sum()
    shared = misfit if is_shared else np.zeros_like(misfit)
    given = Misfits(misfit, shared, np.ones_like(misfit), light, anchors)
    fit = choose_kernel(given, np.ones((num, 3), bool), ONE_KERNEL)
    gain = 10 * np.log10(before.sum() / after.sum())
    assert gain > 0.1  # else the kernel chosen is the default
    assert fit.gain_db == pytest.approx(gain, abs=1e-4)


def test_what_is_left_out_is_predicted_from_what_is_known() -> None:
    """Entries that are scored and not known, such as dropped ones: kriging from the known photographs alone."""
    anchors, rng = lights(10), np.random.default_rng(3)
    whole = kernel(anchors, anchors, 1.0) @ rng.normal(size=(10, 30))
    known = np.ones((10, 30), bool)
    known[rng.integers(0, 10, 30), np.arange(30)] = False
    given = Misfits(
        *(np.repeat(a[..., None], 3, axis=2) for a in (whole, 0 * whole, whole * 0 + 1)), 0 * whole, anchors
    )
    fit = choose_kernel(given, known, ONE_KERNEL, is_scored=~known)
    squares = []
    for point in range(30):
        k = known[:, point]
        error = whole[~k, point] - kriged(anchors[~k], anchors[k], whole[k, point])
        squares.append(np.minimum(error**2, 4.0 * whole[~k, point] ** 2))
    gain = 10 * np.log10((whole[~known] ** 2).sum() / np.sum(squares))
    assert gain > 3.0 and fit.gain_db == pytest.approx(gain, abs=1e-3)


def with_gaps(num: int, num_points: int, rng: np.random.Generator) -> np.ndarray:
    """Entries known, two in three and at least three of a point."""
    known = rng.random((num, num_points)) < 0.65
    known[:3] = True
    return known


def test_gaps_do_not_tell_of_the_entry_that_is_left_out() -> None:
    """A pixel dark in some photographs: each of the others is predicted from the known ones, as by hand."""
    anchors, rng = lights(12), np.random.default_rng(6)
    whole = np.einsum("lk,kpc->lpc", kernel(anchors, anchors, 1.0), rng.normal(size=(12, 40, 3)))
    known = with_gaps(12, 40, rng)
    before = after = 0.0
    for photo, point in np.argwhere(known):
        others = known[:, point] & (np.arange(12) != photo)
        error = whole[photo, point] - kriged(anchors[photo][None], anchors[others], whole[others, point])[0]
        before += (whole[photo, point] ** 2).sum()
        after += np.minimum(error**2, 4.0 * whole[photo, point] ** 2).sum()
    given = Misfits(whole, 0 * whole, np.ones_like(whole), np.zeros((12, 40)), anchors)
    gain = 10 * np.log10(before / after)
    assert gain > 1.0 and choose_kernel(given, known, ONE_KERNEL).gain_db == pytest.approx(gain, abs=1e-3)


@pytest.mark.parametrize("share", [0.9, 0.5, 0.25])
def test_noise_does_not_carry_over_gaps(share: float) -> None:
    anchors, rng = lights(24), np.random.default_rng(7)
    noise, known = rng.normal(size=(24, 1000, 3)), rng.random((24, 1000)) < share
    given = Misfits(noise, 0 * noise, np.ones_like(noise), np.zeros((24, 1000)), anchors)
    assert choose_kernel(given, known, ResidualOptions()).gain_db < 0.1


def test_what_is_carried_over_gaps_is_kriging() -> None:
    """From the known entries alone, whatever stands in the others; points with equal gaps or not."""
    anchors, rng = lights(9), np.random.default_rng(8)
    value = rng.normal(size=(9, 20, 3)).astype(np.float32)
    known = with_gaps(9, 20, rng)
    known[:, 15:] = known[:, :5]
    given = Misfits(np.where(known[..., None], value, 1e3), value, np.ones_like(value), np.ones((9, 20)), anchors)
    fits = {name: ResidualFit(np.radians(LENGTH_DEG), NUGGET, 1.0) for name in ("lit", "dark")}
    found = fit_residual({n: given for n in fits}, {n: known for n in fits}, fits, ResidualOptions(energy=1.0), UNSEEN)
    new = np.array([[0.0, 0.6, 0.8], [0.48, -0.64, 0.6]])
    got = np.einsum("lk,pkc->lpc", kernel(new, anchors, np.radians(LENGTH_DEG)) @ found.lit_weights.T, found.lit_modes)
    for point, k in enumerate(known.T):
        np.testing.assert_allclose(got[:, point], kriged(new, anchors[k], value[k, point]), atol=2e-4)


def test_a_surface_keeps_the_misfits_that_its_other_photographs_foretell() -> None:
    """On one surface what passes is the crest of something smooth, on the other it is anybody's."""
    anchors, rng = lights(16), np.random.default_rng(4)
    crest = 10.0 * kernel(anchors, anchors[3:4], np.radians(40.0))
    values = np.concatenate([np.repeat(crest, 40, axis=1), rng.normal(size=(16, 40))], axis=1)
    values[3, 40:] = 10.0
    is_passing = np.zeros((16, 80), bool)
    is_passing[3] = True
    misfit = np.repeat(values[..., None], 3, axis=2)
    known = np.ones((16, 80), bool)
    given = Misfits(misfit, 0 * misfit, np.ones_like(misfit), 0 * values, anchors)
    surface = np.repeat([0, 1], 40).astype(np.int32)
    fit = ResidualFit(np.radians(LENGTH_DEG), NUGGET, 1.0)
    np.testing.assert_array_equal(carries_over(given, known, is_passing, fit, surface, 2), [True, False])


def test_the_record_predicts_what_the_photographs_do() -> None:
    """Lit and dark pixels by their own kernels, one of what pixels share alone; a state that gains nothing has no modes."""
    anchors, rng = lights(8), np.random.default_rng(5)
    value, shared = (rng.normal(size=(8, 5, 3)).astype(np.float32) for _ in range(2))
    given = Misfits(value, shared, np.ones_like(value), np.ones((8, 5)), anchors)
    known = np.ones((8, 5), bool)
    fits = {
        "lit": ResidualFit(np.radians(60.0), NUGGET, 1.0),
        "dark": ResidualFit(np.radians(30.0), NUGGET, 1.0, own_nugget=np.inf),
    }
    options = ResidualOptions(energy=1.0)
    found = fit_residual({"lit": given, "dark": given}, {"lit": known, "dark": known}, fits, options, UNSEEN)
    new = np.array([[0.0, 0.6, 0.8], [0.48, -0.64, 0.6]])
    for modes, weights, length, misfit, length_deg in (
        (found.lit_modes, found.lit_weights, found.lit_length_rad, value, 60.0),
        (found.dark_modes, found.dark_weights, found.dark_length_rad, shared, 30.0),
    ):
        got = np.einsum("lk,pkc->lpc", kernel(new, found.anchors, length) @ weights.T, modes)
        wanted = kriged(new, anchors, misfit.reshape(8, -1), length_deg).reshape(2, 5, 3)
        np.testing.assert_allclose(got, wanted, atol=1e-4)  # float32, and the jitter of 1e-6
    idle = {"lit": fits["lit"], "dark": ResidualFit(1.0, NUGGET, 0.05)}
    dark = fit_residual({"lit": given, "dark": given}, {"lit": known, "dark": known}, idle, options, UNSEEN).dark_modes
    assert dark.shape == (5, 0, 3)


def test_what_is_a_pixels_own_is_carried_by_a_nugget_of_its_own() -> None:
    anchors, rng = lights(8), np.random.default_rng(10)
    value, shared = (rng.normal(size=(8, 5, 3)).astype(np.float32) for _ in range(2))
    given, known = Misfits(value, shared, np.ones_like(value), np.ones((8, 5)), anchors), np.ones((8, 5), bool)
    fit = ResidualFit(np.radians(60.0), NUGGET, 1.0, own_nugget=5.0)
    states = {name: known for name in ("lit", "dark")}
    found = fit_residual(
        {n: given for n in states}, states, {n: fit for n in states}, ResidualOptions(energy=1.0), UNSEEN
    )
    system = kernel(anchors, anchors, fit.length_rad)
    parts = ((shared, NUGGET), (value - shared, 5.0))
    wanted = sum(system @ np.linalg.solve(system + n * np.eye(8), part.reshape(8, -1)) for part, n in parts)
    got = np.einsum("lk,pkc->lpc", system @ found.lit_weights.T, found.lit_modes)
    np.testing.assert_allclose(got.reshape(8, -1), wanted, atol=1e-4)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e6])
def test_modes_are_whole_steps_that_photographs_do_not_show(size: float) -> None:
    """What is unseen is 0, what two bytes cannot hold in such steps has larger ones, and what is between is off by them."""
    anchors, rng, unseen = lights(8), np.random.default_rng(11), 0.01
    value, known = size * rng.normal(size=(8, 50, 3)).astype(np.float32), np.ones((8, 50), bool)
    given = Misfits(value, value, np.ones_like(value), np.ones((8, 50)), anchors)
    states, fit = {name: known for name in ("lit", "dark")}, ResidualFit(1.0, NUGGET, 1.0)
    pairs = {name: given for name in states}, states, {name: fit for name in states}
    found = fit_residual(*pairs, ResidualOptions(energy=1.0), unseen)
    assert found.lit_modes.dtype == np.int16
    assert found.lit_modes.any() == (size > unseen)
    system = kernel(anchors, anchors, 1.0)
    got = np.einsum("lk,pkc->lpc", system @ found.lit_weights.T, found.lit_modes)
    wanted = (system @ np.linalg.solve(system + NUGGET * np.eye(8), value.reshape(8, -1))).reshape(value.shape)
    at_most = 8 * max(unseen, np.abs(wanted).max() * 8**0.5 / 32512) / 2  # each of eight modes by half a step
    assert np.abs(got - wanted).max() < at_most + 2e-5 * size


def test_the_modes_kept_are_those_that_show_most() -> None:
    """Two kinds of pixels, one ten times as strong: the first mode holds it, and 0.9 of the energy needs no other."""
    anchors = lights(8)
    strong, weak = (kernel(anchors, anchors[i : i + 1], 1.0)[:, 0] for i in (0, 5))
    weak = weak - strong * (weak @ strong) / (strong @ strong)
    misfit = np.stack([10 * strong, weak], axis=1)[..., None].repeat(3, axis=2).astype(np.float32)
    given = Misfits(misfit, misfit, np.ones_like(misfit), np.ones((8, 2)), anchors)
    states, fit = {name: np.ones((8, 2), bool) for name in ("lit", "dark")}, ResidualFit(1.0, NUGGET, 1.0)
    pairs = {name: given for name in states}, states, {name: fit for name in states}
    for options, num_modes in (
        (ResidualOptions(energy=0.9), 1),
        (ResidualOptions(energy=1.0, max_modes=1), 1),
        (ResidualOptions(energy=1.0, max_modes=2), 2),
    ):
        found = fit_residual(*pairs, options, UNSEEN)
        assert found.lit_modes.shape == (2, num_modes, 3)
        got = np.einsum("lk,pkc->lpc", kernel(anchors, anchors, 1.0) @ found.lit_weights.T, found.lit_modes)
        system = kernel(anchors, anchors, 1.0)
        wanted = system @ np.linalg.solve(system + NUGGET * np.eye(8), misfit.reshape(8, -1))
        error = np.abs(got.reshape(8, -1) - wanted).reshape(8, 2, 3).max(axis=(0, 2))
        assert error[0] < 0.02 * np.abs(wanted).max()
        assert (error[1] < 1e-3) == (num_modes == 2)


def test_a_pixel_that_one_photograph_lights_alone_is_not_divided_by_nothing() -> None:
    """That photograph is all its albedo: nothing is left of the fit without it."""
    anchors, light = lights(8), np.zeros((8, 4))
    light[2] = 1.0
    misfit = np.repeat(RNG.normal(size=(8, 4, 1)), 3, axis=2)
    misfit[2] = 1e-3
    given = Misfits(misfit, np.zeros_like(misfit), np.ones_like(misfit), light, anchors)
    assert np.isfinite(choose_kernel(given, np.ones((8, 4), bool), ResidualOptions()).gain_db)

"""Non-linear fits stay in their bounds, finite, and say when they failed."""

import numpy as np
import pytest

from relight3d.maths.bounded_fit import fit_bounded
from relight3d.maths.least_squares import Status

LOWER, UPPER = np.array([-5.0, -5.0]), np.array([5.0, 5.0])
X = np.linspace(0, 1, 50)


def misfit(x):
    return np.exp(x[0] * X) + x[1] - (np.exp(1.5 * X) - 0.5)


def test_exact_data_is_found_by_the_best_of_several_starts():
    # From (-4, 2) the exponential is flat and the fit ends at a bound, from outside the bounds it is moved inside.
    starts = [np.array(start) for start in ([-4.0, 2.0], [40.0, -40.0], [4.0, 4.0], [0.0, 0.0])]
    fit = fit_bounded(misfit, starts, LOWER, UPPER, max_evaluations=200)
    assert fit.status == Status.OK and fit.rank == 2
    # Of two columns of one length, of cosine c between them: sqrt((1 + c) / (1 - c)).
    slope = X * np.exp(1.5 * X)
    cosine = slope.mean() / np.sqrt((slope**2).mean())
    assert fit.condition == pytest.approx(np.sqrt((1 + cosine) / (1 - cosine)), rel=1e-3)
    # scipy stops when a step changes the cost by 1e-8 of itself; the square root of that in x.
    np.testing.assert_allclose(fit.value, [1.5, -0.5], atol=1e-4)


def test_an_answer_outside_the_bounds_ends_at_the_bound():
    fit = fit_bounded(misfit, [np.zeros(2)], LOWER, np.array([1.0, 5.0]))
    assert (fit.value <= [1.0, 5.0]).all() and fit.value[0] == pytest.approx(1.0, abs=1e-3)


def test_a_few_outliers_do_not_decide():
    noise = np.zeros(50)
    noise[::10] = 20.0
    fit = fit_bounded(lambda x: misfit(x) + noise, [np.zeros(2)], LOWER, UPPER, loss_scale=0.01, max_evaluations=200)
    # 5 of 50 residuals pull with at most the loss's scale 0.01 each, against 45 that hold.
    np.testing.assert_allclose(fit.value, [1.5, -0.5], atol=0.02)


def test_an_unknown_that_is_not_felt_is_rank_deficient():
    fit = fit_bounded(lambda x: np.full(10, x[0] - 1.0), [np.zeros(2)], LOWER, UPPER)
    assert fit.status == Status.RANK_DEFICIENT and fit.rank == 1 and np.isinf(fit.condition)
    assert fit.value[0] == pytest.approx(1.0, abs=1e-4) and np.isfinite(fit.value).all()


def test_fewer_residuals_than_unknowns_is_underdetermined():
    fit = fit_bounded(lambda x: x[:1] + x[1:], [np.ones(2)], LOWER, UPPER)
    assert fit.status == Status.UNDERDETERMINED


@pytest.mark.parametrize("starts", [[], [np.zeros(2)]])
def test_no_start_or_no_residual_is_no_data(starts):
    fit = fit_bounded(lambda x: np.zeros(0), starts, LOWER, UPPER)
    assert fit.status == Status.NO_DATA and np.isfinite(fit.value).all()


def test_the_limit_of_evaluations_is_reported():
    fit = fit_bounded(misfit, [np.array([-4.0, 4.0])], LOWER, UPPER, max_evaluations=2)
    assert fit.status == Status.DID_NOT_CONVERGE and np.isfinite(fit.value).all()


def test_a_region_that_is_not_finite_is_avoided():
    def broken(x):
        with np.errstate(invalid="ignore"):
            return np.sqrt(x[:1] - 1.0) - 1.0 + 0 * x[1]

    fit = fit_bounded(broken, [np.array([-2.0, 0.0]), np.array([4.0, 0.0])], LOWER, UPPER)
    assert fit.value[0] == pytest.approx(2.0, abs=1e-3)


def test_nothing_finite_anywhere_did_not_converge():
    fit = fit_bounded(lambda x: np.full(5, np.nan), [np.zeros(2)], LOWER, UPPER)
    assert fit.status == Status.DID_NOT_CONVERGE and np.isfinite(fit.value).all() and np.isfinite(fit.cost)

"""Every kind of weak problem gets a finite answer and the status that names its weakness."""

import numpy as np
import pytest

from relight3d.maths.least_squares import (
    Solution,
    Status,
    robust_scale,
    robust_weights,
    solve_normal,
    solve_rows,
    weighted_median,
)

# A well-posed 24 x 9 problem has condition about 5: float64 leaves 1e-15 of it, and the normal equations its square.
EXACT = 1e-12


def problems(num=40, rows=24, unknowns=9, colors=3, seed=0):
    rng = np.random.default_rng(seed)
    matrix, truth = rng.standard_normal((num, rows, unknowns)), rng.standard_normal((num, unknowns, colors))
    return matrix, truth, matrix @ truth


def normal_equations(matrix, target, weight=None):
    weight = np.ones(matrix.shape[:2]) if weight is None else weight
    gram = np.einsum("nr,nru,nrv->nuv", weight, matrix, matrix)
    moment = np.einsum("nr,nru,nrk->nuk", weight, matrix, target)
    power = np.einsum("nr,nrk->n", weight, target**2)
    return gram, moment, power, (weight > 0).sum(axis=1).astype(float)


def both_solvers(matrix, target, weight=None, damping=0.0) -> dict[str, Solution]:
    gram, moment, power, rows = normal_equations(matrix, target, weight)
    return {
        "rows": solve_rows(matrix, target, weight, damping),
        "normal": solve_normal(gram, moment, power, rows, damping),
    }


def test_exact_data_is_recovered_and_status_is_ok():
    matrix, truth, target = problems()
    for name, answer in both_solvers(matrix, target).items():
        assert (answer.status == Status.OK).all(), name
        assert (answer.rank == 9).all() and (answer.condition < 30).all()
        np.testing.assert_allclose(answer.value, truth, atol=EXACT)
        # The residual comes from a difference of squares in the normal equations: sqrt of eps.
        assert answer.residual.max() < 1e-6


def test_weights_decide_which_rows_count():
    matrix, truth, target = problems()
    weight = np.ones(matrix.shape[:2])
    weight[:, :6] = 0.0
    target[:, :6] = 1e3  # would spoil any answer that heard it
    for answer in both_solvers(matrix, target, weight).values():
        np.testing.assert_allclose(answer.value, truth, atol=EXACT)


def test_weighted_rows_equal_repeated_rows():
    matrix, _, target = problems()
    target = target + np.random.default_rng(1).standard_normal(target.shape)
    weight = np.ones(matrix.shape[:2])
    weight[:, :4] = 3.0
    repeated = [np.concatenate([a, a[:, :4], a[:, :4]], axis=1) for a in (matrix, target)]
    for answer in both_solvers(matrix, target, weight).values():
        np.testing.assert_allclose(answer.value, solve_rows(*repeated).value, atol=EXACT)


def test_both_solvers_damp_alike_and_pull_towards_zero():
    matrix, _, target = problems()
    damping = np.array([0.0] + [0.3] * 8)
    answers = both_solvers(matrix, target, damping=damping)
    np.testing.assert_allclose(answers["rows"].value, answers["normal"].value, atol=1e-10)
    free = both_solvers(matrix, target)["rows"]
    assert (np.linalg.norm(answers["rows"].value, axis=(1, 2)) < np.linalg.norm(free.value, axis=(1, 2))).all()


def test_damping_pulls_towards_the_prior_and_without_data_ends_there():
    matrix, truth, target = problems(num=3)
    gram, moment, power, rows = normal_equations(matrix, target)
    gram[0], moment[0], rows[0] = 0.0, 0.0, 0.0
    prior = truth + 1.0
    strong = solve_normal(gram, moment, power, rows, damping=1e6, prior=prior)
    np.testing.assert_allclose(strong.value[0], prior[0])
    # Damped a million times harder than the data speaks: a millionth of the way is left.
    np.testing.assert_allclose(strong.value, prior, atol=1e-4)
    assert list(strong.status) == [Status.NO_DATA, Status.OK, Status.OK]


def test_equal_columns_are_rank_deficient_and_share_the_answer_equally():
    matrix, _, _ = problems()
    matrix[:, :, 1] = matrix[:, :, 0]
    target = 2.0 * matrix[:, :, :1]
    for name, answer in both_solvers(matrix, target).items():
        assert (answer.status == Status.RANK_DEFICIENT).all(), name
        assert (answer.rank == 8).all() and np.isinf(answer.condition).all()
        # Minimum norm: of all x0 + x1 = 2 the shortest is 1, 1. Eigenvalues see a singular value's square: 1e-8.
        np.testing.assert_allclose(answer.value[:, :2, 0], 1.0, atol=1e-7)


def test_minimum_norm_equals_the_pseudoinverse():
    matrix, _, target = problems(rows=5)
    np.testing.assert_allclose(solve_rows(matrix, target).value, np.linalg.pinv(matrix) @ target, atol=1e-10)


def test_rank_cut_follows_the_stated_threshold():
    # Style rule 27: singular values below 2 eps max(n, m) s_max count as zero.
    eps = np.finfo(float).eps
    for factor, rank in ((0.5, 1), (8.0, 2)):
        matrix = np.diag([1.0, factor * 2 * eps * 2])[None]
        answer = solve_rows(matrix, np.ones((1, 2, 1)))
        assert answer.rank[0] == rank
        assert np.isfinite(answer.value).all()


def test_fewer_rows_than_unknowns_is_underdetermined():
    matrix, _, target = problems(rows=5)
    for answer in both_solvers(matrix, target).values():
        assert (answer.status == Status.UNDERDETERMINED).all() and (answer.rank == 5).all()
        assert np.isfinite(answer.value).all()


def test_no_weight_is_no_data_and_the_answer_zero():
    matrix, _, target = problems()
    for damping in (0.0, 0.1):
        for answer in both_solvers(matrix, target, np.zeros(matrix.shape[:2]), damping).values():
            assert (answer.status == Status.NO_DATA).all()
            assert not answer.value.any() and np.isfinite(answer.residual).all()


def test_rows_that_are_not_finite_weigh_nothing():
    matrix, truth, target = problems()
    target[:, 3] = np.nan
    matrix[:, 5, 2] = np.inf
    np.testing.assert_allclose(solve_rows(matrix, target).value, truth, atol=EXACT)


def test_normal_equations_that_are_not_finite_are_no_data():
    matrix, truth, target = problems(num=2)
    gram, moment, power, rows = normal_equations(matrix, target)
    moment[0, 0] = np.nan
    answer = solve_normal(gram, moment, power, rows)
    assert list(answer.status) == [Status.NO_DATA, Status.OK]
    np.testing.assert_allclose(answer.value[1], truth[1], atol=EXACT)
    assert not answer.value[0].any()


@pytest.mark.parametrize("size", [1e-150, 1e-30, 1e30, 1e150])
@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_answers_do_not_depend_on_the_unit(size, damping):
    # Both sides in another unit: the same x. Squares of 1e150 still fit into float64; the row solver never squares.
    matrix, _, target = problems()
    wanted = solve_rows(matrix, target, damping=damping)
    got = solve_rows(matrix * size, target * size, damping=damping)
    np.testing.assert_allclose(got.value, wanted.value, rtol=1e-10)
    np.testing.assert_array_equal(got.rank, wanted.rank)
    gram, moment, power, rows = normal_equations(matrix, target)
    normal = solve_normal(gram * size, moment * size, power * size, rows, damping)
    np.testing.assert_allclose(normal.value, wanted.value, rtol=1e-8)


def test_one_matrix_for_all_problems_gives_what_each_alone_does():
    matrix, _, target = problems()
    matrix = matrix[:1]
    target = target + np.random.default_rng(2).standard_normal(target.shape)
    for damping in (0.0, 0.05):
        shared = solve_rows(matrix, target, damping=damping)
        apart = solve_rows(np.repeat(matrix, len(target), axis=0), target, damping=damping)
        for name in ("value", "rank", "status", "condition", "residual"):
            np.testing.assert_allclose(getattr(shared, name), getattr(apart, name), rtol=1e-10, atol=EXACT)


def test_a_gap_in_one_problem_of_a_shared_matrix_stays_its_own():
    matrix, truth, _ = problems(num=3)
    target = matrix[:1] @ truth
    target[1, 4] = np.nan
    np.testing.assert_allclose(solve_rows(matrix[:1], target).value, truth, atol=EXACT)


def test_huber_holds_against_outliers_that_ruin_least_squares():
    matrix, truth, target = problems(rows=60)
    rng = np.random.default_rng(3)
    target = target + 0.01 * rng.standard_normal(target.shape)
    target[:, :9] += 50.0
    plain, robust = solve_rows(matrix, target), solve_rows(matrix, target, huber=1.345)
    assert np.abs(plain.value - truth).max() > 1.0  # what the option is for
    # 51 rows of noise 0.01 for 9 unknowns leave 0.01 / sqrt(51) ~ 0.0014; Huber's bias by 15 % outliers is a few
    # times that.
    assert np.abs(robust.value - truth).max() < 0.02
    assert set(robust.counts()) <= {"ok", "did_not_converge"}


def test_huber_on_exact_data_is_least_squares():
    matrix, truth, target = problems()
    answer = solve_rows(matrix, target, huber=1.345)
    np.testing.assert_allclose(answer.value, truth, atol=1e-10)
    assert (answer.status == Status.OK).all()


def test_huber_without_data_is_finite():
    matrix, _, target = problems(num=2)
    weight = np.ones(matrix.shape[:2])
    weight[0] = 0.0
    answer = solve_rows(matrix, target, weight, huber=1.345)
    assert list(answer.status) == [Status.NO_DATA, Status.OK] and np.isfinite(answer.value).all()


def test_leaving_the_diagnosis_out_changes_no_answer():
    matrix, _, target = problems()
    matrix[0] = 0.0
    gram, moment, power, rows = normal_equations(matrix, target)
    rows[0] = 0.0
    full = solve_normal(gram, moment, power, rows, damping=1e-3)
    quick = solve_normal(gram, moment, power, rows, damping=1e-3, diagnose=False)
    np.testing.assert_array_equal(quick.value, full.value)
    np.testing.assert_array_equal(quick.residual, full.residual)
    np.testing.assert_array_equal(quick.status, full.status)
    assert (quick.rank == -1).all()


def test_conditions_up_to_a_million_leave_the_digits_they_should():
    rng = np.random.default_rng(4)
    for condition in (1e2, 1e4, 1e6):
        u, _ = np.linalg.qr(rng.standard_normal((24, 9)))
        v, _ = np.linalg.qr(rng.standard_normal((9, 9)))
        matrix = (u * np.geomspace(1, 1 / condition, 9) @ v.T)[None]
        truth = rng.standard_normal((1, 9, 1))
        answers = both_solvers(matrix, matrix @ truth)
        assert answers["rows"].condition[0] == pytest.approx(condition, rel=1e-6)
        # eps * condition for rows, eps * condition^2 for normal equations; 100 for the constants.
        assert np.abs(answers["rows"].value - truth).max() < 100 * 2.2e-16 * condition
        assert np.abs(answers["normal"].value - truth).max() < 100 * 2.2e-16 * condition**2


def test_robust_helpers_sweep_zero_tiny_and_huge():
    values = np.array([0.0, 1e-300, 1.0, 1e300])
    for scale in (0.0, 1e-300, 1.0, 1e300):
        weights = robust_weights(values, scale)
        assert np.isfinite(weights).all() and (weights <= 1).all() and weights[0] == 1
    assert robust_scale(np.zeros(0)) == 0.0
    assert robust_scale(np.random.default_rng(5).standard_normal(100_000)) == pytest.approx(1.0, abs=0.02)


def test_weighted_median_is_between_its_neighbours_and_zero_without_weight():
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.array([1.0, 1.0, 1.0])) == 2.0
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.array([10.0, 1.0, 1.0])) == 3.0
    assert weighted_median(np.zeros(0), np.zeros(0)) == 0.0
    assert weighted_median(np.ones(3), np.zeros(3)) == 0.0

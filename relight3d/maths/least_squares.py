"""Batches of small least-squares problems, each answered with its rank, condition and status.

A batch is N problems with the same number of unknowns U and, each, K right sides (the colours). Problems come as
rows (`solve_rows`), or already summed as normal equations (`solve_normal`), which is how data scattered over pixels
and photographs arrives. Everything is float64 inside. Nothing raises for a weak problem and nothing returns NaN: the
status says what the answer is worth. Non-linear fits are in `bounded_fit`.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from jaxtyping import Float, Float64, Int8, Int32, Real

EPS, TINY = np.finfo(np.float64).eps, np.finfo(np.float64).tiny


class Status(IntEnum):
    """What an answer is worth, best first."""

    OK = 0
    RANK_DEFICIENT = 1  # the data leaves a direction open: the minimum-norm answer is given
    UNDERDETERMINED = 2  # fewer observations than unknowns
    NO_DATA = 3  # no observation with weight: the answer is 0 (or the prior)
    DID_NOT_CONVERGE = 4  # an iteration ended at its limit: its last finite answer is given
    FALLBACK = 5  # a stage replaced the answer; its Health says by what


@dataclass(frozen=True, eq=False)
class Solution:
    """Answers of a batch of solves, and how far to trust each."""

    value: Float64[np.ndarray, "problem unknown color"]
    status: Int8[np.ndarray, " problem"]
    rank: Int32[np.ndarray, " problem"]
    condition: Float64[np.ndarray, " problem"]  # of the undamped matrix; inf where the rank is short
    residual: Float64[np.ndarray, " problem"]  # weighted RMS over observations and colours

    def counts(self) -> dict[str, int]:
        """How many problems ended in each status, by its lower-case name."""
        return {s.name.lower(): int((self.status == s).sum()) for s in Status if (self.status == s).any()}


def solve_rows(
    matrix: Float[np.ndarray, "#problem row unknown"],
    target: Float[np.ndarray, "problem row color"],
    weight: Float[np.ndarray, "problem row"] | None = None,
    damping: float | Float[np.ndarray, " unknown"] = 0.0,
    huber: float | None = None,
) -> Solution:
    """Weighted, damped least squares of each problem by its singular values.

    Minimises sum w (A x - b)^2 + damping * mean column power * x^2. Singular values below
    2 * eps * max(rows, unknowns) * s_max count as zero (minimum norm). Rows that are not finite weigh nothing. One
    matrix serves all problems that have no weights and no gaps of their own. With `huber`, residuals beyond so many
    robust scales of their own problem weigh less; DID_NOT_CONVERGE where the weights have not settled in 50 rounds.
    """
    matrix, target = np.asarray(matrix, np.float64), np.asarray(target, np.float64)
    is_shared = len(matrix) == 1 < len(target) and weight is None and huber is None
    if is_shared and np.isfinite(target).all():
        return _solve_shared(matrix, target, damping)
    matrix = np.broadcast_to(matrix, (len(target), *matrix.shape[1:]))
    weight = np.ones(matrix.shape[:2]) if weight is None else np.asarray(weight, np.float64)
    finite = np.isfinite(matrix).all(-1) & np.isfinite(target).all(-1) & np.isfinite(weight)
    weight = np.where(finite, np.maximum(weight, 0.0), 0.0)
    matrix, target = np.where(finite[..., None], matrix, 0.0), np.where(finite[..., None], target, 0.0)
    if huber is None:
        return _solve_weighted(matrix, target, weight, damping)
    return _solve_huber(matrix, target, weight, damping, huber)


def solve_normal(
    gram: Float[np.ndarray, "problem unknown unknown"],
    moment: Float[np.ndarray, "problem unknown color"],
    power: Float[np.ndarray, " problem"] | None = None,
    num_rows: Real[np.ndarray, " problem"] | None = None,
    damping: float | Float[np.ndarray, " unknown"] = 0.0,
    prior: Float[np.ndarray, "problem unknown color"] | None = None,
    diagnose: bool = True,
) -> Solution:
    """Least squares from summed normal equations A'WA x = A'Wb, damped, or else of minimum norm.

    `power` is sum w b^2 over rows and colours (for the residual), `num_rows` the number of observations. Damping is
    relative to the mean diagonal and pulls towards `prior` (default 0). Rank and condition are those of the gram
    matrix with its columns brought to one scale, so that they speak of directions and not of units. Squared
    conditions cannot be told from rank loss beyond 1e8, so the cut is at sqrt of the row solver's: 2 * eps * unknowns
    on the eigenvalues. They cost four times the damped answer itself: with `diagnose` off the same answer comes
    with rank -1, condition 0 and a status by the number of rows alone.
    """
    gram, moment = np.asarray(gram, np.float64), np.asarray(moment, np.float64)
    unknowns = gram.shape[1]
    finite = np.isfinite(gram).all(axis=(1, 2)) & np.isfinite(moment).all(axis=(1, 2))
    if not finite.all():
        gram, moment = np.where(finite[:, None, None], gram, 0.0), np.where(finite[:, None, None], moment, 0.0)
    diagonal = np.einsum("nuu->nu", gram)
    rows = diagonal[:, 0] if num_rows is None else np.asarray(num_rows, np.float64)
    rows = np.where(finite, rows, 0.0)
    start = np.zeros_like(moment) if prior is None else np.asarray(prior, np.float64)
    side = moment if prior is None else moment - gram @ start
    is_damped = bool(np.any(np.asarray(damping) > 0))
    rank, condition = np.full(len(gram), -1, np.int32), np.zeros(len(gram))
    if is_damped:
        step = _damped_step(gram, side, diagonal, damping)
        if diagnose:
            # The vectors would cost as much again as the values, and only the minimum-norm answer needs them.
            values = np.linalg.eigvalsh(_scaled(gram, diagonal)[0])
            rank, condition, _ = _rank_of_squares(values)
    else:
        step, rank, condition = _minimum_norm_step(gram, side, diagonal)
    value = start + step
    residual = _normal_residual(gram, moment, value, power, rows)
    known = rank if diagnose else np.where(diagonal.any(axis=1), np.minimum(rows, unknowns), 0).astype(np.int32)
    return Solution(value, _status(rows, known, unknowns), rank, condition, residual)


def robust_weights(
    residual: Float[np.ndarray, "*axes"], scale: float | Float[np.ndarray, "*#axes"], tuning: float = 1.345
) -> Float[np.ndarray, "*axes"]:
    """Huber's weights: 1 within `tuning` scales, falling as 1/|residual| beyond. A scale of 0 leaves zeros at 1."""
    limit = np.maximum(np.asarray(scale) * tuning, TINY)
    return limit / np.maximum(np.abs(residual), limit)


def robust_scale(residual: Float[np.ndarray, "*axes"], axis: int | None = None) -> Float[np.ndarray, "*rest"] | float:
    """The standard deviation that the median absolute value stands for, were the residual normal; 0 for no values."""
    if residual.size == 0:
        return 0.0 if axis is None else np.zeros(np.delete(residual.shape, axis))
    scale = 1.4826 * np.median(np.abs(residual), axis=axis)
    return float(scale) if axis is None else scale


def weighted_median(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]) -> float:
    """The value with half of the weight on either side; NaN-free: 0 for no weight."""
    order = np.argsort(values, kind="stable")
    cumulative = np.cumsum(weights[order])
    if len(values) == 0 or cumulative[-1] <= 0:
        return 0.0
    return float(values[order[np.searchsorted(cumulative, cumulative[-1] / 2)]])


def _solve_shared(matrix: np.ndarray, target: np.ndarray, damping: float | np.ndarray) -> Solution:
    """One singular value decomposition for all problems: their right sides are columns of one."""
    num, rows, colors = target.shape
    unknowns = matrix.shape[2]
    columns = target.transpose(1, 0, 2).reshape(1, rows, num * colors)
    one = solve_rows(matrix, columns, None, damping)
    value = one.value[0].reshape(unknowns, num, colors).transpose(1, 0, 2)
    is_row = np.isfinite(matrix[0]).all(axis=1)
    miss = (np.where(is_row[:, None], matrix[0], 0.0) @ value - target) * is_row[:, None]
    residual = np.sqrt((miss**2).sum(axis=(1, 2)) / max(is_row.sum() * colors, 1))
    status, rank, condition = (np.repeat(a, num) for a in (one.status, one.rank, one.condition))
    return Solution(np.ascontiguousarray(value), status, rank, condition, residual)


def _solve_weighted(
    matrix: np.ndarray, target: np.ndarray, weight: np.ndarray, damping: float | np.ndarray
) -> Solution:
    root = np.sqrt(weight)[..., None]
    # Each problem is brought to a largest entry of 1: squares of 1e200 would be infinite.
    size = np.abs(matrix * root).max(axis=(1, 2), initial=0.0)[:, None, None]
    size = np.where(size > 0, size, 1.0)
    rows, sides = matrix * root / size, target * root / size
    unknowns = rows.shape[2]
    u, s, vt = np.linalg.svd(rows, full_matrices=False)
    rank, condition, keep = _rank(s, max(rows.shape[1:]), unknowns)
    prior = np.broadcast_to(np.asarray(damping, np.float64), (unknowns,))
    if (prior > 0).any():
        value = _damped(rows, sides, prior)
    else:
        inverse = np.where(keep, 1.0 / np.where(keep, s, 1.0), 0.0)
        value = np.einsum("nij,ni,nik->njk", vt, inverse, np.einsum("nri,nrk->nik", u, sides))
    miss = (rows @ value - sides) * size
    total = np.maximum(weight.sum(axis=1) * sides.shape[2], TINY)
    residual = np.sqrt((miss**2).sum(axis=(1, 2)) / total)
    return Solution(value, _status((weight > 0).sum(axis=1), rank, unknowns), rank, condition, residual)


def _solve_huber(
    matrix: np.ndarray, target: np.ndarray, weight: np.ndarray, damping: float | np.ndarray, tuning: float
) -> Solution:
    """Iteratively reweighted; each problem's scale is the robust one of its own residuals (trap 13)."""
    answer = _solve_weighted(matrix, target, weight, damping)
    is_moving = np.ones(len(matrix), bool)
    for _ in range(50):
        miss = np.linalg.norm(matrix @ answer.value - target, axis=2)
        used = np.where(weight > 0, miss, np.nan)
        has_rows = (weight > 0).any(axis=1)
        scale = np.zeros(len(miss))
        scale[has_rows] = 1.4826 * np.nanmedian(used[has_rows], axis=1)
        # Exact data leaves rounding errors for residuals: they are no scale to judge by.
        floor = 1e-12 * np.abs(target).max(axis=(1, 2), initial=0.0)
        robust = robust_weights(miss, np.broadcast_to(np.maximum(scale, floor)[:, None], miss.shape), tuning)
        last, answer = answer.value, _solve_weighted(matrix, target, weight * robust, damping)
        step = np.abs(answer.value - last).max(axis=(1, 2), initial=0.0)
        is_moving = step > 1e-6 * np.abs(answer.value).max(axis=(1, 2), initial=0.0) + TINY
        if not is_moving.any():
            break
    status = np.where(is_moving & (answer.status == Status.OK), Status.DID_NOT_CONVERGE, answer.status)
    return Solution(answer.value, status.astype(np.int8), answer.rank, answer.condition, answer.residual)


def _damped_step(gram: np.ndarray, side: np.ndarray, diagonal: np.ndarray, damping: float | np.ndarray) -> np.ndarray:
    mean = np.maximum(diagonal.mean(axis=1), TINY)
    # A direction that neither data nor damping holds stays at the prior.
    ridge = mean[:, None] * np.maximum(np.broadcast_to(damping, (gram.shape[1],)), EPS)
    damped = gram.copy()
    np.einsum("nuu->nu", damped)[:] += ridge
    # Brought to a mean of 1, so that tiny sums cannot underflow in the elimination.
    return np.linalg.solve(damped / mean[:, None, None], side / mean[:, None, None])


def _minimum_norm_step(
    gram: np.ndarray, side: np.ndarray, diagonal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The step of minimum norm in the scaled unknowns, rank and condition."""
    scaled, scale = _scaled(gram, diagonal)
    values, vectors = np.linalg.eigh(scaled)
    rank, condition, keep = _rank_of_squares(values)
    inverse = np.where(keep, 1.0 / np.where(keep, values, 1.0), 0.0)
    rotated = np.einsum("nvu,nvk->nuk", vectors, side * scale[:, :, None])
    return scale[:, :, None] * np.einsum("nvu,nu,nuk->nvk", vectors, inverse, rotated), rank, condition


def _scaled(gram: np.ndarray, diagonal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The gram matrix with a diagonal of ones, and the factors of its columns."""
    scale = np.where(diagonal > 0, 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 0.0)
    return gram * scale[:, :, None] * scale[:, None, :], scale


def _rank_of_squares(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rank, condition and which count, from the eigenvalues of a gram matrix: squares of singular values."""
    rank, squared, keep = _rank(np.maximum(values, 0.0), values.shape[1], values.shape[1])
    return rank, np.sqrt(squared), keep


def _rank(singular: np.ndarray, larger: int, unknowns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rank, condition (inf where short of rank) and which singular values count."""
    largest = singular.max(axis=1, initial=0.0)
    keep = singular > 2 * EPS * larger * largest[:, None]
    rank = keep.sum(axis=1).astype(np.int32)
    smallest = np.where(keep, singular, np.inf).min(axis=1, initial=np.inf)
    full = rank == unknowns
    condition = np.where(full, largest / np.where(full, smallest, 1.0), np.inf)
    return rank, condition, keep


def _status(num_rows: np.ndarray, rank: np.ndarray, unknowns: int) -> np.ndarray:
    status = np.full(len(rank), Status.OK, dtype=np.int8)
    status[rank < unknowns] = Status.RANK_DEFICIENT
    status[(rank < unknowns) & (num_rows < unknowns)] = Status.UNDERDETERMINED
    status[(num_rows == 0) | (rank == 0)] = Status.NO_DATA
    return status


def _damped(rows: np.ndarray, sides: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Damped rows are stacked under the data, so that the condition is not squared."""
    power = np.einsum("nru,nru->n", rows, rows) / rows.shape[2]
    ridge = np.sqrt(prior[None] * np.where(power > 0, power, 1.0)[:, None])[:, :, None] * np.eye(rows.shape[2])
    stacked = np.concatenate([rows, ridge], axis=1)
    padded = np.concatenate([sides, np.zeros((len(rows), rows.shape[2], sides.shape[2]))], axis=1)
    return np.linalg.pinv(stacked) @ padded


def _normal_residual(
    gram: np.ndarray, moment: np.ndarray, value: np.ndarray, power: np.ndarray | None, rows: np.ndarray
) -> np.ndarray:
    if power is None:
        return np.zeros(len(gram))
    explained = 2 * np.einsum("nuk,nuk->n", value, moment) - np.einsum("nuk,nuk->n", value, gram @ value)
    missing = np.maximum(np.asarray(power, np.float64) - explained, 0.0)
    return np.sqrt(missing / np.maximum(rows * moment.shape[2], 1.0))

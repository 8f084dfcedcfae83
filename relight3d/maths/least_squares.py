"""Batches of small least-squares problems, each answered with its rank, condition and status.

A batch is N problems with the same number of unknowns U and, each, K right sides (the colours). Problems come as
rows (`solve_rows`), or already summed as normal equations (`solve_normal`), which is how data scattered over pixels
and photographs arrives. Everything is float64 inside. Nothing raises for a weak problem and nothing returns NaN: the
status says what the answer is worth.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from jaxtyping import Float, Float64, Int8, Int32


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
    matrix: Float[np.ndarray, "problem row unknown"],
    target: Float[np.ndarray, "problem row color"],
    weight: Float[np.ndarray, "problem row"] | None = None,
    damping: float | Float[np.ndarray, " unknown"] = 0.0,
) -> Solution:
    """Weighted, damped least squares of each problem by its singular values.

    Minimises sum w (A x - b)^2 + damping * mean column power * x^2. Singular values below
    2 * eps * max(rows, unknowns) * s_max count as zero (minimum norm). Rows that are not finite weigh nothing.
    """
    matrix, target = np.asarray(matrix, np.float64), np.asarray(target, np.float64)
    weight = np.ones(matrix.shape[:2]) if weight is None else np.asarray(weight, np.float64)
    finite = np.isfinite(matrix).all(-1) & np.isfinite(target).all(-1) & np.isfinite(weight)
    weight = np.where(finite, np.maximum(weight, 0.0), 0.0)
    root = np.sqrt(weight)[..., None]
    rows = np.where(finite[..., None], matrix, 0.0) * root
    sides = np.where(finite[..., None], target, 0.0) * root
    u, s, vt = np.linalg.svd(rows, full_matrices=False)
    rank, condition, keep = _rank(s, max(rows.shape[1:]), rows.shape[2])
    prior = np.broadcast_to(np.asarray(damping, np.float64), (rows.shape[2],))
    if (prior > 0).any():
        value = _damped(rows, sides, prior)
    else:
        inverse = np.where(keep, 1.0 / np.where(keep, s, 1.0), 0.0)
        value = np.einsum("nij,ni,nik->njk", vt, inverse, np.einsum("nri,nrk->nik", u, sides))
    miss = np.einsum("nru,nuk->nrk", rows, value) - sides
    num_rows = (weight > 0).sum(axis=1)
    total = np.maximum(weight.sum(axis=1) * sides.shape[2], np.finfo(np.float64).tiny)
    residual = np.sqrt((miss**2).sum(axis=(1, 2)) / total)
    return Solution(value, _status(num_rows, rank, rows.shape[2]), rank, condition, residual)


def solve_normal(
    gram: Float[np.ndarray, "problem unknown unknown"],
    moment: Float[np.ndarray, "problem unknown color"],
    power: Float[np.ndarray, " problem"] | None = None,
    num_rows: Float[np.ndarray, " problem"] | None = None,
    damping: float | Float[np.ndarray, " unknown"] = 0.0,
    prior: Float[np.ndarray, "problem unknown color"] | None = None,
) -> Solution:
    """Least squares from summed normal equations A'WA x = A'Wb, by the eigenvalues of the scaled gram matrix.

    `power` is sum w b^2 over rows and colours (for the residual), `num_rows` the number of observations. Damping is
    relative to the mean diagonal and pulls towards `prior` (default 0). Squared conditions cannot be told from
    rank loss beyond 1e8, so the cut is at sqrt of the row solver's: eps * unknowns on the eigenvalues.
    """
    gram, moment = np.asarray(gram, np.float64), np.asarray(moment, np.float64)
    num, unknowns, _ = gram.shape
    finite = np.isfinite(gram).all(axis=(1, 2)) & np.isfinite(moment).all(axis=(1, 2))
    gram, moment = np.where(finite[:, None, None], gram, 0.0), np.where(finite[:, None, None], moment, 0.0)
    # Columns are brought to one scale first, so that rank speaks of directions and not of units.
    diagonal = np.einsum("nuu->nu", gram)
    scale = np.where(diagonal > 0, 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(gram * scale[:, :, None] * scale[:, None, :])
    values = np.maximum(values, 0.0)
    largest = values[:, -1:]
    keep = values > 2 * np.finfo(np.float64).eps * unknowns * np.maximum(largest, np.finfo(np.float64).tiny)
    rank = keep.sum(axis=1).astype(np.int32)
    smallest = np.where(keep, values, np.inf).min(axis=1, initial=np.inf)
    full = rank == unknowns
    condition = np.where(full, np.sqrt(largest[:, 0] / np.where(full, smallest, 1.0)), np.inf)
    start = np.zeros_like(moment) if prior is None else np.asarray(prior, np.float64)
    side = moment - np.einsum("nuv,nvk->nuk", gram, start)
    if np.any(np.asarray(damping) > 0):
        mean = diagonal.mean(axis=1)
        ridge = np.where(mean > 0, mean, 1.0)[:, None] * np.broadcast_to(damping, (unknowns,))
        # A direction that neither data nor damping holds stays at the prior.
        ridge = np.maximum(ridge, np.finfo(np.float64).eps * np.where(mean > 0, mean, 1.0)[:, None])
        step = np.linalg.solve(gram + ridge[:, :, None] * np.eye(unknowns), side)
    else:
        inverse = np.where(keep, 1.0 / np.where(keep, values, 1.0), 0.0)
        rotated = np.einsum("nvu,nvk->nuk", vectors, side * scale[:, :, None])
        step = scale[:, :, None] * np.einsum("nvu,nu,nuk->nvk", vectors, inverse, rotated)
    value = start + step
    rows = diagonal[:, 0] if num_rows is None else np.asarray(num_rows, np.float64)
    rows = np.where(finite, rows, 0.0)
    residual = _normal_residual(gram, moment, value, power, rows)
    return Solution(value, _status(rows, rank, unknowns), rank, condition, residual)


def robust_weights(
    residual: Float[np.ndarray, "*axes"], scale: float | Float[np.ndarray, "*axes"], tuning: float = 1.345
) -> Float[np.ndarray, "*axes"]:
    """Huber's weights: 1 within `tuning` scales, falling as 1/|residual| beyond. A scale of 0 gives weight 1 to zeros."""
    ratio = np.abs(residual) / np.maximum(scale, np.finfo(np.float64).tiny)
    return 1.0 / np.maximum(1.0, ratio / tuning)


def robust_scale(residual: Float[np.ndarray, "*axes"], axis: int | None = None) -> Float[np.ndarray, "*rest"]:
    """The standard deviation that the median absolute value stands for, were the residual normal."""
    return 1.4826 * np.median(np.abs(residual), axis=axis)


def weighted_median(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]) -> float:
    """The value with half of the weight on either side; NaN-free: 0 for no weight."""
    order = np.argsort(values, kind="stable")
    cumulative = np.cumsum(weights[order])
    if len(values) == 0 or cumulative[-1] <= 0:
        return 0.0
    return float(values[order[np.searchsorted(cumulative, cumulative[-1] / 2)]])


@dataclass(frozen=True, eq=False)
class BoundedFit:
    """The answer of a bounded, robust non-linear fit, of the same kind as a Solution's."""

    value: Float64[np.ndarray, " unknown"]
    status: Status
    rank: int
    condition: float
    cost: float
    num_evaluations: int


def fit_bounded(
    residual: Callable[[np.ndarray], np.ndarray],
    starts: list[np.ndarray],
    lower: np.ndarray,
    upper: np.ndarray,
    loss: str = "soft_l1",
    loss_scale: float = 0.1,
    max_evaluations: int = 60,
) -> BoundedFit:
    """The best of several starts of a trust-region fit within bounds (scipy.optimize.least_squares).

    A residual that is not finite is taken as a large one, so the region shrinks away from it. The status is
    DID_NOT_CONVERGE when the best start ended at its limit of evaluations, NO_DATA when there is no residual.
    """
    from scipy.optimize import least_squares

    def guarded(x: np.ndarray) -> np.ndarray:
        return np.nan_to_num(residual(x), nan=1e6, posinf=1e6, neginf=-1e6)

    if not starts or guarded(starts[0]).size == 0:
        return BoundedFit((lower + upper) / 2, Status.NO_DATA, 0, np.inf, 0.0, 0)
    best, evaluations = None, 0
    for start in starts:
        inside = np.clip(start, lower + 1e-9 * (upper - lower), upper - 1e-9 * (upper - lower))
        answer = least_squares(
            guarded, inside, bounds=(lower, upper), loss=loss, f_scale=loss_scale, max_nfev=max_evaluations
        )
        evaluations += answer.nfev
        if best is None or answer.cost < best.cost:
            best = answer
    assert best is not None
    s = np.linalg.svd(best.jac, compute_uv=False)
    rank, condition, _ = _rank(s[None], max(best.jac.shape), len(lower))
    status = _status(np.array([best.jac.shape[0]]), rank, len(lower))[0]
    status = Status.DID_NOT_CONVERGE if best.status == 0 else Status(int(status))
    return BoundedFit(best.x, status, int(rank[0]), float(condition[0]), float(best.cost), evaluations)


def _rank(singular: np.ndarray, larger: int, unknowns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rank, condition (inf where short of rank) and which singular values count."""
    largest = singular.max(axis=1, initial=0.0)
    keep = singular > 2 * np.finfo(np.float64).eps * larger * largest[:, None]
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
    explained = 2 * np.einsum("nuk,nuk->n", value, moment) - np.einsum("nuk,nuv,nvk->n", value, gram, value)
    missing = np.maximum(np.asarray(power, np.float64) - explained, 0.0)
    return np.sqrt(missing / np.maximum(rows * moment.shape[2], 1.0))

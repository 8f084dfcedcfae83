"""Non-linear least squares within bounds, answered with the same status as the linear solves."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float64

from relight3d.maths.least_squares import EPS, Status

TOO_LARGE = 1e6  # what a residual that is not finite counts as, so that the trust region shrinks away from it


@dataclass(frozen=True, eq=False)
class BoundedFit:
    """The answer of a bounded, robust non-linear fit, of the same kind as a Solution's."""

    value: Float64[np.ndarray, " unknown"]
    status: Status
    rank: int  # of the Jacobian at the answer
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
    step: float | None = None,
) -> BoundedFit:
    """The best of several starts of a trust-region fit within bounds (scipy.optimize.least_squares).

    `step`: how far each unknown is moved for the Jacobian, where the residual is too rough for scipy's smallest steps.

    A start outside the bounds is moved inside. The status is DID_NOT_CONVERGE when the best start ended at its limit
    of evaluations, or where no residual was ever finite; NO_DATA, with the middle of the bounds, when there is no
    residual or no start; RANK_DEFICIENT where the answer has a direction that the residual does not feel.
    """
    from scipy.optimize import least_squares

    latest: list[tuple[bytes, np.ndarray]] = [(b"", np.zeros(0))]

    def guarded(x: np.ndarray) -> np.ndarray:
        if latest[0][0] != x.tobytes():  # a Jacobian begins where the residual was just asked for
            value = np.nan_to_num(residual(x), nan=TOO_LARGE, posinf=TOO_LARGE, neginf=-TOO_LARGE)
            latest[0] = x.tobytes(), value
        return latest[0][1].copy()  # scipy scales what it is given

    def differences(x: np.ndarray, size: float) -> np.ndarray:
        here = guarded(x)
        moves = np.where(x + size <= upper, size, -size)
        return np.stack([(guarded(x + move) - here) / move.sum() for move in np.diag(moves)], axis=1)

    if not starts or guarded(starts[0]).size == 0:
        return BoundedFit((lower + upper) / 2, Status.NO_DATA, 0, np.inf, 0.0, 0)
    best, evaluations = None, 0
    for start in starts:
        inside = np.clip(start, lower + 1e-9 * (upper - lower), upper - 1e-9 * (upper - lower))
        answer = least_squares(
            guarded, inside, "2-point" if step is None else partial(differences, size=step), bounds=(lower, upper),
            loss=loss, f_scale=loss_scale, max_nfev=max_evaluations,
        )  # fmt: skip
        evaluations += answer.nfev
        if best is None or answer.cost < best.cost:
            best = answer
    assert best is not None
    rank, condition = _rank_of(best.jac)
    is_finite = bool(np.isfinite(residual(best.x)).all())
    if best.status == 0 or not is_finite:
        status = Status.DID_NOT_CONVERGE
    elif rank < len(lower):
        status = Status.UNDERDETERMINED if len(best.fun) < len(lower) else Status.RANK_DEFICIENT
    else:
        status = Status.OK
    return BoundedFit(best.x, status, rank, condition, float(best.cost), evaluations)


def _rank_of(jacobian: np.ndarray) -> tuple[int, float]:
    """Rank and condition of a Jacobian whose columns are brought to one length: the unknowns differ in unit."""
    length = np.linalg.norm(jacobian, axis=0)
    s = np.linalg.svd(jacobian / np.where(length > 0, length, 1.0), compute_uv=False)
    rank = int((s > 2 * EPS * max(jacobian.shape) * s.max(initial=0.0)).sum())
    is_full = rank == jacobian.shape[1]
    return rank, float(s.max() / s.min()) if is_full else np.inf

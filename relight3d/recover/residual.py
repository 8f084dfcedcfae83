"""What the model still misses at each pixel, carried from the photographs to lights between them.

Differs from the paper: it has no such term. The misfit of each pixel (normals half a degree off, a reflection in
glaze, a wall seen in a mirror) is interpolated over the light's direction by kriging with an exponential kernel, whose
length and nugget are those that predict left-out photographs best, in closed form. Far from every photograph the
kernel, and with it the correction, dies away, so nothing is extrapolated. It is kept per scene only on that evidence.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32

from relight3d.errors import InputError
from relight3d.records import Residual


@dataclass(frozen=True)
class ResidualOptions:
    """How the misfit is carried over."""

    lengths_deg: tuple[float, ...] = (8.0, 15.0, 30.0, 60.0)  # of the kernel, tried in turn
    nuggets: tuple[float, ...] = (0.02, 0.1, 0.4, 1.5)  # the part of the misfit that does not carry over
    max_modes: int = 16  # the misfits of all pixels are kept as combinations of so many
    energy: float = 0.995  # or of as many as hold this share of what is predicted
    min_gain_db: float = 0.1  # of left-out photographs, for a state's misfit to be carried at all

    def __post_init__(self) -> None:
        if self.max_modes < 0:
            raise InputError("residual.max_modes", self.max_modes, "0 or more")


@dataclass(frozen=True, eq=False)
class ResidualFit:
    """The kernel chosen, and what it is worth on left-out photographs."""

    length_rad: float
    nugget: float
    gain_db: float


def kernel(a: Float64[np.ndarray, "light 3"], b: Float64[np.ndarray, "anchor 3"], length_rad: float) -> np.ndarray:
    """exp(-angle / length) between unit directions: rough enough to follow a shading that is not smooth."""
    return np.exp(-np.arccos(np.clip(a @ b.T, -1.0, 1.0)) / length_rad)


def choose_kernel(
    misfit: Float32[np.ndarray, "photo point 3"],
    is_known: Bool[np.ndarray, "photo point"],
    slope: Float32[np.ndarray, "photo point 3"],
    anchors: Float64[np.ndarray, "photo 3"],
    options: ResidualOptions,
    is_scored: Bool[np.ndarray, "photo point"] | None = None,
) -> ResidualFit:
    """Length and nugget with the least left-out error over a sample of points.

    `is_known` are the entries that others are predicted from, `is_scored` (default the same) those that must be
    predicted. `slope` weighs an error by what a display shows of it.
    """
    is_scored = is_known if is_scored is None else is_scored
    take = _sample(misfit.shape[1])
    values, known = misfit[:, take].astype(np.float64), is_known[:, take]
    scale = np.where(is_scored[:, take][..., None], slope[:, take], 0.0).astype(np.float64)
    none = float((scale * values**2).sum())
    best = ResidualFit(float(np.radians(options.lengths_deg[0])), options.nuggets[-1], 0.0)
    if none <= 0:
        return best
    for length_deg in options.lengths_deg:
        for nugget in options.nuggets:
            trial = ResidualFit(float(np.radians(length_deg)), nugget, 0.0)
            left_out = float((scale * _left_out_squares(values, known, anchors, trial)).sum())
            gain = 10 * np.log10(none / max(left_out, 1e-30))
            if gain > best.gain_db:
                best = ResidualFit(trial.length_rad, nugget, float(gain))
    return best


def carries_over(
    misfit: Float32[np.ndarray, "photo point 3"],
    is_known: Bool[np.ndarray, "photo point"],
    is_passing: Bool[np.ndarray, "photo point"],
    slope: Float32[np.ndarray, "photo point 3"],
    anchors: Float64[np.ndarray, "photo 3"],
    fit: ResidualFit,
    surface: Int32[np.ndarray, " point"],
    num_surfaces: int,
) -> Bool[np.ndarray, " surface"]:
    """Of each surface, whether left-out photographs are predicted better with its passing misfits than without them."""
    take = _sample(misfit.shape[1], 16_000)
    values, known = misfit[:, take].astype(np.float64), is_known[:, take]
    scale = np.where(known[..., None], slope[:, take], 0.0)
    totals = []
    for used in (known, known & ~is_passing[:, take]):
        per_point = (scale * _left_out_squares(values, used, anchors, fit)).sum(axis=(0, 2))
        totals.append(np.bincount(surface[take], per_point, num_surfaces))
    return totals[0] <= totals[1]


def _sample(num_points: int, most: int = 4000) -> np.ndarray:
    return np.linspace(0, num_points - 1, min(num_points, most)).astype(int)


def _left_out_squares(values: np.ndarray, known: np.ndarray, anchors: np.ndarray, fit: ResidualFit) -> np.ndarray:
    """Squared error of every entry as the others predict it, capped at four times its own square.

    A left-out prediction of kriging is off by (K^-1 r)_i / (K^-1)_ii, the unknown entries being what the known ones
    predict; an unknown entry is off by its difference from that.
    """
    covariance = kernel(anchors, anchors, fit.length_rad)
    inverse = np.linalg.inv(covariance + fit.nugget * np.eye(len(anchors)))
    filled = _filled(np.where(known[..., None], values, 0.0), known, covariance @ inverse)
    left_out = (inverse @ filled.reshape(len(values), -1) / np.diag(inverse)[:, None]).reshape(values.shape)
    errors = np.where(known[..., None], left_out, values - filled)
    return np.minimum(errors**2, 4.0 * values**2 + 1e-12)


def fit_residual(
    misfit: Float32[np.ndarray, "photo point 3"],
    states: Mapping[str, Bool[np.ndarray, "photo point"]],
    anchors: Float64[np.ndarray, "photo 3"],
    fits: Mapping[str, ResidualFit],
    options: ResidualOptions,
) -> Residual:
    """The misfits of the two states as kriging weights, each compressed to a few modes.

    `states` are the known entries "lit" and "dark", `fits` the kernel of each; a state whose kernel gains nothing gets
    no modes.
    """
    parts = {}
    for name in ("lit", "dark"):
        worth = fits[name].gain_db > options.min_gain_db
        parts[name] = _modes(misfit, states[name], anchors, fits[name], options if worth else None)
    return Residual(
        parts["lit"][0], parts["lit"][1], parts["dark"][0], parts["dark"][1], anchors,
        fits["lit"].length_rad, fits["dark"].length_rad,
    )  # fmt: skip


def _modes(misfit, is_known, anchors, fit: ResidualFit, options: ResidualOptions | None) -> tuple:
    """Modes by the singular vectors of what the kriging predicts: a mode is kept for what it shows."""
    num_photos, num_points, _ = misfit.shape
    if options is None:
        return np.zeros((num_points, 0, 3), np.float32), np.zeros((0, num_photos))
    covariance = kernel(anchors, anchors, fit.length_rad)
    smoother = covariance @ np.linalg.inv(covariance + fit.nugget * np.eye(num_photos))
    values = _filled(np.where(is_known[..., None], misfit, 0.0).astype(np.float32), is_known, smoother)
    predicted = smoother.astype(np.float32) @ values.reshape(num_photos, -1)
    power, vectors = np.linalg.eigh((predicted @ predicted.T).astype(np.float64))
    order = np.argsort(power)[::-1]
    power, vectors = np.maximum(power[order], 0.0), vectors[:, order]
    share = np.cumsum(power) / max(power.sum(), 1e-30)
    modes = int(min(options.max_modes, np.searchsorted(share, options.energy) + 1, num_photos))
    basis = vectors[:, :modes]
    amplitudes = (basis.T.astype(np.float32) @ predicted).reshape(modes, num_points, 3)
    # prediction(light) = kernel(light) @ covariance^-1 @ basis @ amplitudes; the jitter bounds coincident lights.
    jitter = 1e-6 * np.eye(num_photos)
    weights = np.linalg.solve(covariance + jitter, basis).T
    return np.ascontiguousarray(amplitudes.transpose(1, 0, 2), np.float32), weights


def _filled(values: np.ndarray, known: np.ndarray, smoother: np.ndarray, num_steps: int = 8) -> np.ndarray:
    """Unknown entries replaced by their own prediction from the known ones; the fixed point is kriging with gaps."""
    flat = values.reshape(len(values), -1)
    gaps = ~np.repeat(known, 3, axis=1)
    smooth = smoother.astype(values.dtype)
    for _ in range(num_steps):
        flat = np.where(gaps, smooth @ flat, flat)
    return flat.reshape(values.shape)

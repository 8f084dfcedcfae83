"""What the model still misses at each pixel, carried from the photographs to lights between them.

Differs from the paper: it has no such term. The misfit of each pixel (normals half a degree off, a reflection in
glaze, a wall seen in a mirror) is interpolated over the light's direction by kriging with an exponential kernel, whose
length and nugget are those that predict left-out photographs best, in closed form. Far from every photograph the
kernel, and with it the correction, dies away, so nothing is extrapolated. It is kept per scene only on that evidence.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float64, Int32

from relight3d.errors import InputError
from relight3d.records import Residual

MOST_LEVERAGE = 0.7  # of a photograph on the fits before the residual: beyond, no light is like its own


@dataclass(frozen=True)
class ResidualOptions:
    """How the misfit is carried over."""

    lengths_deg: tuple[float, ...] = (15.0, 30.0, 60.0, 120.0)  # of the kernel, tried in turn
    nuggets: tuple[float, ...] = (0.02, 0.1, 0.4, 1.5)  # the part of the misfit that does not carry over
    max_modes: int = 16  # the misfits of all pixels are kept as combinations of so many
    energy: float = 0.995  # or of as many as hold this share of what is predicted
    min_gain_db: float = 0.25  # of left-out photographs, as a display shows it, for any misfit to be carried
    min_state_gain_db: float = 0.1  # and for that of lit or dark pixels

    def __post_init__(self) -> None:
        if self.max_modes < 0:
            raise InputError("residual.max_modes", self.max_modes, "0 or more")
        for name, values in (("lengths_deg", self.lengths_deg), ("nuggets", self.nuggets)):
            if not values or not all(0 < value < np.inf for value in values):
                raise InputError(f"residual.{name}", values, "one finite number above 0, or more")
        if not 0 < self.energy <= 1:
            raise InputError("residual.energy", self.energy, "above 0 and at most 1")


@dataclass(frozen=True, eq=False)
class ResidualFit:
    """The kernel chosen, and what it is worth on left-out photographs."""

    length_rad: float
    nugget: float
    gain_db: float
    is_shared: bool = False  # only what neighbouring pixels share carries over: the rest is noise


@dataclass(frozen=True, eq=False)
class Misfits:
    """What photographs with a light are missed by, and what the fits that left it have taken of it."""

    value: Float[np.ndarray, "photo point 3"]
    shared: Float[np.ndarray, "photo point 3"]  # the part that neighbouring pixels share
    slope: Float[np.ndarray, "photo point 3"]  # squared: what a display shows of a difference
    light: Float[np.ndarray, "photo point"]  # what an albedo of the pixel's own is multiplied by; 0 where it has none
    anchors: Float64[np.ndarray, "photo 3"]  # towards the lights

    @cached_property
    def hat(self) -> Float64[np.ndarray, "photo photo"]:
        """How much each photograph counts in each one's fit of all that is linear in the light."""
        num = len(self.anchors)
        functions = np.column_stack([np.ones(num), *(self.anchors.T if num >= 6 else ())])
        return functions @ np.linalg.pinv(functions)

    def sample(self, most: int) -> tuple["Misfits", Int32[np.ndarray, " sample"]]:
        """Evenly spread points, at most so many; and which ones."""
        num = self.value.shape[1]
        take = np.linspace(0, num - 1, min(num, most)).astype(np.int32)
        value, shared, slope, light = (each[:, take] for each in (self.value, self.shared, self.slope, self.light))
        return Misfits(value, shared, slope, light, self.anchors), take


def kernel(a: Float64[np.ndarray, "light 3"], b: Float64[np.ndarray, "anchor 3"], length_rad: float) -> np.ndarray:
    """exp(-angle / length) between unit directions: rough enough to follow a shading that is not smooth."""
    return np.exp(-np.arccos(np.clip(a @ b.T, -1.0, 1.0)) / length_rad)


def choose_kernel(
    misfits: Misfits,
    is_known: Bool[np.ndarray, "photo point"],
    options: ResidualOptions,
    is_scored: Bool[np.ndarray, "photo point"] | None = None,
) -> ResidualFit:
    """Length and nugget with the least left-out error over a sample of points.

    `is_known` are the entries that others are predicted from, `is_scored` (default the same) those that must be
    predicted.
    """
    some, take = misfits.sample(4000)
    known, scored = is_known[:, take], (is_known if is_scored is None else is_scored)[:, take]
    scale = np.where(scored[..., None], some.slope, 0.0)
    deleted = _deleted(some, known)
    none = float((scale * deleted**2).sum())
    best = ResidualFit(float(np.radians(options.lengths_deg[0])), options.nuggets[-1], 0.0)
    if none <= 0:
        return best

    def better(length_rad: float, nugget: float, is_shared: bool) -> ResidualFit:
        trial = ResidualFit(length_rad, nugget, 0.0, is_shared)
        left_out = float((scale * _left_out_squares(some, known, trial, deleted)).sum())
        gain = 10 * np.log10(none / max(left_out, 1e-30))
        return replace(trial, gain_db=float(gain)) if gain > best.gain_db else best

    for length_deg in options.lengths_deg:
        for nugget in options.nuggets:
            best = better(float(np.radians(length_deg)), nugget, False)
    # What pixels share reaches as far as the whole, or farther.
    for length_rad in {best.length_rad, float(np.radians(options.lengths_deg[-1]))}:
        for nugget in options.nuggets:
            best = better(length_rad, nugget, True)
    return best


def carries_over(
    misfits: Misfits,
    is_known: Bool[np.ndarray, "photo point"],
    is_passing: Bool[np.ndarray, "photo point"],
    fit: ResidualFit,
    surface: Int32[np.ndarray, " point"],
    num_surfaces: int,
) -> Bool[np.ndarray, " surface"]:
    """Of each surface, whether left-out photographs are predicted better with its passing misfits than without them."""
    some, take = misfits.sample(16_000)
    known = is_known[:, take]
    scale = np.where(known[..., None], some.slope, 0.0)
    deleted, totals = _deleted(some, known), []
    for used in (known, known & ~is_passing[:, take]):
        per_point = (scale * _left_out_squares(some, used, fit, deleted)).sum(axis=(0, 2))
        totals.append(np.bincount(surface[take], per_point, num_surfaces))
    return totals[0] <= totals[1]


def _deleted(misfits: Misfits, known: np.ndarray) -> np.ndarray:
    """The misfit of each entry, had its photograph been left out of the fits before: y_i / (1 - h_ii)."""
    whole = _left_out_of_fits(misfits, np.zeros((len(misfits.anchors),) * 2))
    return misfits.value + np.where(known[..., None], whole[0] + whole[1], 0.0)


def _left_out_of_fits(misfits: Misfits, weights: Float64[np.ndarray, "photo photo"]) -> tuple[np.ndarray, np.ndarray]:
    """By how much more each entry is off when its photograph is left out of the fits before, where `weights` predict it
    from the others: of its shared part, and of its own.

    The fits have taken, of what pixels share, all that is linear in the light, which looks like indirect light; and of
    what is a pixel's own whatever is in proportion to its light, which looks like albedo.
    """
    room = 1.0 - np.minimum(np.diag(misfits.hat), MOST_LEVERAGE)
    by_photo = ((1.0 - (weights * misfits.hat).sum(axis=1)) / room - 1.0).astype(misfits.value.dtype)
    light, weights = misfits.light, weights.astype(misfits.light.dtype)
    total = np.maximum((light**2).sum(axis=0), 1e-30)
    room = 1.0 - np.minimum(light**2 / total, MOST_LEVERAGE)
    by_entry = (1.0 - light * (weights @ light) / total) / room - 1.0
    return by_photo[:, None, None] * misfits.shared, by_entry[..., None] * (misfits.value - misfits.shared)


def _left_out_squares(misfits: Misfits, known: np.ndarray, fit: ResidualFit, deleted: np.ndarray) -> np.ndarray:
    """Squared error of every entry as the others predict it, capped at four times its square in `deleted`.

    A left-out prediction of kriging is off by (K^-1 r)_i / (K^-1)_ii, the unknown entries being what the known ones
    predict; an unknown entry is off by its difference from that. But the misfits are what fits to all photographs left:
    of few photographs so little that they no longer resemble their neighbours. So photograph i is left out of these
    fits, too: it is missed by y_i / (1 - h_ii), and the others by h_ij / (1 - h_ii) y_i more.
    """
    covariance = kernel(misfits.anchors, misfits.anchors, fit.length_rad)
    inverse = np.linalg.inv(covariance + fit.nugget * np.eye(len(covariance)))
    given = misfits.shared if fit.is_shared else misfits.value
    filled = _filled(np.where(known[..., None], given, 0.0), known, covariance @ inverse)
    weights = -inverse / np.diag(inverse)[:, None]
    left_out = -(weights.astype(given.dtype) @ filled.reshape(len(given), -1)).reshape(given.shape)
    np.fill_diagonal(weights, 0.0)
    shared, own = _left_out_of_fits(misfits, weights)
    if fit.is_shared:
        none = np.zeros_like(weights)
        own = misfits.value - misfits.shared + _left_out_of_fits(misfits, none)[1]
    errors = np.where(known[..., None], left_out + shared + own, misfits.value - filled)
    return np.minimum(errors**2, 4.0 * deleted**2 + 1e-12)


def fit_residual(
    misfits: Mapping[str, Misfits],
    states: Mapping[str, Bool[np.ndarray, "photo point"]],
    fits: Mapping[str, ResidualFit],
    options: ResidualOptions,
) -> Residual:
    """The misfits of the two states as kriging weights, each compressed to a few modes.

    `states` are the known entries "lit" and "dark", `fits` the kernel of each; a state whose kernel gains nothing gets
    no modes.
    """
    parts, anchors = {}, misfits["lit"].anchors
    for name in ("lit", "dark"):
        fit, of_state = fits[name], misfits[name]
        worth = fit.gain_db > options.min_state_gain_db
        misfit = of_state.shared if fit.is_shared else of_state.value
        parts[name] = _modes(misfit, states[name], anchors, fit, options if worth else None)
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
    has_gap = np.repeat(~known.all(axis=0), 3)
    some, gaps = flat[:, has_gap], np.repeat(~known, 3, axis=1)[:, has_gap]
    smooth, predicted = smoother.astype(values.dtype), np.empty_like(some)
    for _ in range(num_steps):
        np.matmul(smooth, some, out=predicted)
        np.copyto(some, predicted, where=gaps)
    flat = flat.copy()
    flat[:, has_gap] = some
    return flat.reshape(values.shape)

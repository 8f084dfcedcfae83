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
from jaxtyping import Bool, Float, Float32, Float64, Int16, Int32

from relight3d.errors import InputError
from relight3d.records import Residual

MOST_PAIRS = 8_000_000  # of photographs, over the points by which a kernel is judged: 64 MB a matrix
MOST_STEPS = 32512  # of a mode: what two bytes hold, the upper one at most 127
MOST_LEVERAGE = 0.7  # of a photograph on the fits before the residual: beyond, no light is like its own


@dataclass(frozen=True)
class ResidualOptions:
    """How the misfit is carried over."""

    lengths_deg: tuple[float, ...] = (15.0, 30.0, 60.0, 120.0)  # of the kernel, tried in turn
    nuggets: tuple[float, ...] = (0.02, 0.1, 0.4, 1.5)  # the part of the misfit that does not carry over
    own_nuggets: tuple[float, ...] = (0.4, 1.5, 5.0, 20.0)  # of what neighbouring pixels do not share, tried last
    max_modes: int = 16  # the misfits of all pixels are kept as combinations of so many
    energy: float = 0.995  # or of as many as hold this share of what is predicted
    min_gain_db: float = 0.25  # of left-out photographs, as a display shows it, for any misfit to be carried
    min_state_gain_db: float = 0.1  # and for that of lit or dark pixels

    def __post_init__(self) -> None:
        if self.max_modes < 0:
            raise InputError("residual.max_modes", self.max_modes, "0 or more")
        for name in ("lengths_deg", "nuggets", "own_nuggets"):
            values = getattr(self, name)
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
    own_nugget: float | None = None  # of what neighbouring pixels do not share, where it is larger: more of it is noise


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
        """Evenly spread points, at most so many and `MOST_PAIRS` pairs of their entries; and which ones."""
        num = self.value.shape[1]
        most = min(most, MOST_PAIRS // len(self.anchors) ** 2 + 1)
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

    def better(length_rad: float, nugget: float, own_nugget: float | None = None) -> ResidualFit:
        trial = ResidualFit(length_rad, nugget, 0.0, own_nugget)
        left_out = float((scale * _left_out_squares(some, known, trial, deleted)).sum())
        gain = 10 * np.log10(none / max(left_out, 1e-30))
        return replace(trial, gain_db=float(gain)) if gain > best.gain_db else best

    for length_deg in options.lengths_deg:
        for nugget in options.nuggets:
            best = better(float(np.radians(length_deg)), nugget)
    # What pixels share reaches as far as the whole, or farther; noise is in what they do not.
    for length_rad in {best.length_rad, float(np.radians(options.lengths_deg[-1]))}:
        for nugget in options.nuggets:
            best = better(length_rad, nugget, np.inf)
    for own_nugget in options.own_nuggets:
        if own_nugget > best.nugget:
            best = better(best.length_rad, best.nugget, own_nugget)
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
    nothing = np.zeros((1, *misfits.hat.shape), np.float32)
    return misfits.value + np.where(known[..., None], sum(_left_out_of_fits(misfits, nothing)), 0.0)


def _left_out_of_fits(
    misfits: Misfits, weights: Float[np.ndarray, "point photo photo"]
) -> tuple[np.ndarray, np.ndarray]:
    """By how much more each entry is off when its photograph is left out of the fits before, where `weights` predict it
    from the others: of its shared part, and of its own.

    The fits have taken, of what pixels share, all that is linear in the light, which looks like indirect light; and of
    what is a pixel's own whatever is in proportion to its light, which looks like albedo.
    """
    light, hat = misfits.light, misfits.hat.astype(weights.dtype)
    room = 1.0 - np.minimum(np.diag(hat), MOST_LEVERAGE)
    by_photo = (1.0 - np.einsum("pij,ij->ip", weights, hat, optimize=True)) / room[:, None] - 1.0
    total = np.maximum((light**2).sum(axis=0), 1e-30)
    room = 1.0 - np.minimum(light**2 / total, MOST_LEVERAGE)
    by_others = np.einsum("pij,jp->ip", weights, light.astype(weights.dtype), optimize=True)
    by_entry = (1.0 - light * by_others / total) / room - 1.0
    return by_photo[..., None] * misfits.shared, by_entry[..., None] * (misfits.value - misfits.shared)


def _left_out_weights(
    known: np.ndarray, anchors: np.ndarray, length_rad: float, nugget: float
) -> Float[np.ndarray, "point photo photo"]:
    """How much each photograph counts where kriging predicts an entry of a point from the known others.

    With K of the known entries alone, entry i is missed by (K^-1 y)_i / (K^-1)_ii when it is left out (Dubrule 1983). K
    is each point's own: were its gaps filled first, they would tell of the entry that is left out.
    """
    if nugget == np.inf:
        return np.zeros((known.shape[1], len(known), len(known)), np.float32)
    covariance = kernel(anchors, anchors, length_rad)
    inverse = _inverse_of_known(known, covariance, nugget)
    own = np.einsum("pii->pi", inverse)[..., None]
    weights = np.where(known.T[..., None], -inverse / np.where(own > 0, own, 1.0), covariance @ inverse)
    np.einsum("pii->pi", weights)[...] = 0.0
    return weights.astype(np.float32)


def _inverse_of_known(
    known: np.ndarray, covariance: np.ndarray, nugget: float
) -> Float[np.ndarray, "point photo photo"]:
    """The inverse of covariance and nugget between the known entries of each point, 0 at the others.

    Points that are known in the same photographs share one.
    """
    _, first, which = np.unique(np.packbits(known, axis=0), axis=1, return_index=True, return_inverse=True)
    some = known.T[first]
    is_known = some[:, :, None] & some[:, None, :]
    system = np.where(is_known, covariance, 0.0) + np.eye(len(covariance)) * np.where(some, nugget, 1.0)[:, None]
    return np.where(is_known, np.linalg.inv(system), 0.0)[which.ravel()]


def _parts(misfits: Misfits, fit: ResidualFit) -> list[tuple[Float[np.ndarray, "photo point 3"], float]]:
    """What is carried over, each with its nugget: the misfits, or what neighbouring pixels share and what they do not."""
    if fit.own_nugget is None:
        return [(misfits.value, fit.nugget)]
    shared = (misfits.shared, fit.nugget)
    return [shared] if fit.own_nugget == np.inf else [shared, (misfits.value - misfits.shared, fit.own_nugget)]


def _predicted(weights: np.ndarray, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    given = np.where(known[..., None], values, 0.0).astype(np.float32)
    return (weights @ given.transpose(1, 0, 2)).transpose(1, 0, 2)


def _left_out_squares(misfits: Misfits, known: np.ndarray, fit: ResidualFit, deleted: np.ndarray) -> np.ndarray:
    """Squared error of every entry as the others predict it, capped at four times its square in `deleted`.

    An unknown entry is off by its difference from what the known ones predict. But the misfits are what fits to all
    photographs left: of few photographs so little that they no longer resemble their neighbours. So photograph i is left
    out of these fits, too: it is missed by y_i / (1 - h_ii), and the others by h_ij / (1 - h_ii) y_i more.
    """
    of_own = weights = _left_out_weights(known, misfits.anchors, fit.length_rad, fit.nugget)
    if fit.own_nugget is not None:
        of_own = _left_out_weights(known, misfits.anchors, fit.length_rad, fit.own_nugget)
    parts = zip((weights, of_own), _parts(misfits, fit))
    predicted = sum(_predicted(each, known, values) for each, (values, _) in parts)
    more = _left_out_of_fits(misfits, weights)[0] + _left_out_of_fits(misfits, of_own)[1]
    errors = misfits.value - predicted + np.where(known[..., None], more, 0.0)
    return np.minimum(errors**2, 4.0 * deleted**2 + 1e-12)


def fit_residual(
    misfits: Mapping[str, Misfits],
    states: Mapping[str, Bool[np.ndarray, "photo point"]],
    fits: Mapping[str, ResidualFit],
    options: ResidualOptions,
    unseen: float,
) -> Residual:
    """The misfits of the two states as kriging weights, each compressed to a few modes.

    `states` are the known entries "lit" and "dark", `fits` the kernel of each; a state whose kernel gains nothing gets
    no modes. The modes are whole numbers: of steps that make `unseen` in none of the photographs.
    """
    parts, anchors = {}, misfits["lit"].anchors
    for name in ("lit", "dark"):
        fit, of_state = fits[name], misfits[name]
        worth = fit.gain_db > options.min_state_gain_db
        parts[name] = _modes(of_state, states[name], fit, options if worth else None, unseen)
    return Residual(
        parts["lit"][0], parts["lit"][1], parts["dark"][0], parts["dark"][1], anchors,
        fits["lit"].length_rad, fits["dark"].length_rad,
    )  # fmt: skip


def _modes(
    misfits: Misfits, is_known: np.ndarray, fit: ResidualFit, options: ResidualOptions | None, unseen: float
) -> tuple[Int16[np.ndarray, "point mode 3"], Float64[np.ndarray, "mode photo"]]:
    """Modes by the singular vectors of what the kriging predicts: a mode is kept for what it shows."""
    num_photos, num_points, _ = misfits.value.shape
    if options is None:
        return np.zeros((num_points, 0, 3), np.int16), np.zeros((0, num_photos))
    covariance = kernel(misfits.anchors, misfits.anchors, fit.length_rad)
    weights = np.zeros(misfits.value.shape, np.float32)
    for part, nugget in _parts(misfits, fit):
        weights += _kriging_weights(part, is_known, covariance, nugget)
    predicted = covariance.astype(np.float32) @ weights.reshape(num_photos, -1)
    power, vectors = np.linalg.eigh((predicted @ predicted.T).astype(np.float64))
    order = np.argsort(power)[::-1]
    power, vectors = np.maximum(power[order], 0.0), vectors[:, order]
    share = np.cumsum(power) / max(power.sum(), 1e-30)
    modes = int(min(options.max_modes, np.searchsorted(share, options.energy) + 1, num_photos))
    basis = vectors[:, :modes]
    amplitudes = (basis.T.astype(np.float32) @ predicted).reshape(modes, num_points, 3)
    step = np.maximum(unseen / np.abs(basis).max(axis=0), np.abs(amplitudes).max(axis=(1, 2), initial=0.0) / MOST_STEPS)
    whole = np.rint(amplitudes / step[:, None, None].astype(np.float32)).astype(np.int16)
    # prediction(light) = kernel(light) @ covariance^-1 @ basis @ amplitudes; the jitter bounds coincident lights.
    jitter = 1e-6 * np.eye(num_photos)
    weights = np.linalg.solve(covariance + jitter, basis * step).T
    return np.ascontiguousarray(whole.transpose(1, 0, 2)), weights


def _kriging_weights(
    values: np.ndarray, is_known: np.ndarray, covariance: np.ndarray, nugget: float
) -> Float32[np.ndarray, "photo point 3"]:
    """What the kernel between a light and each photograph's is multiplied by: K^-1 y of each point's known entries."""
    out = np.empty(values.shape, np.float32)
    # Points of one pattern lie side by side, so that a block of them asks for few inverses.
    order = np.lexsort(np.packbits(is_known, axis=0))
    for block in np.array_split(order, len(order) * len(values) ** 2 // MOST_PAIRS + 1):
        inverse = _inverse_of_known(is_known[:, block], covariance, nugget).astype(np.float32)
        known = np.where(is_known[:, block, None], values[:, block], 0.0)
        out[:, block] = (inverse @ known.transpose(1, 0, 2).astype(np.float32)).transpose(1, 0, 2)
    return out

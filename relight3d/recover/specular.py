"""Glossy surfaces and their lobes: sections 1.1.2 and 1.2.3, eq. (4), Wu et al. 2004.

A surface is glossy when photographs are brighter than its diffuse and indirect fits predict, near the mirror direction
and by more than its own misfit elsewhere. Then lobes are fitted to what is left, one by one, and each is kept only when
photographs left out of its fit are predicted better: an exactly diffuse surface ends with no lobe, not a tiny one.

The fit sees radiance on a compressed scale, asinh(radiance / white), since peaks are 10 to 500 times white (trap 14);
exponents and colours are fitted as logarithms within bounds, from several starts (trap 8).
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64

from relight3d.errors import InputError
from relight3d.maths.bounded_fit import BoundedFit, fit_bounded
from relight3d.maths.decibels import gain_db
from relight3d.maths.lafortune import MAX_EXPONENT
from relight3d.maths.least_squares import Status, robust_scale
from relight3d.records import Lobe
from relight3d.shading import energy_of, lobe_brdf

MAX_ENERGY = 1.0
MIN_NEAR_PEAK, PEAK_SHARE = 10, 0.5  # so many samples must see a lobe at this share of its peak
REFINED_SAMPLES = 2_200  # for at most 21 parameters


@dataclass(frozen=True)
class SpecularOptions:
    """How many lobes a surface may have and what one must earn."""

    max_lobes: int = 3
    min_gain_db: float = 0.4  # of the left-out photographs' compressed error, for a lobe to be kept
    excess_sigmas: float = 4.0  # brighter than predicted by so many of the surface's own scatters is glossy
    num_samples: int = 4500  # (photograph, pixel) samples of a surface that enter the fit
    num_folds: int = 3
    kinds: tuple[str, ...] = ("isotropic", "halfway", "anisotropic", "retro", "brushed")

    def __post_init__(self) -> None:
        if not 0 <= self.max_lobes <= 3:
            raise InputError("specular.max_lobes", self.max_lobes, "0 to 3")


@dataclass(frozen=True, eq=False)
class LobeSamples:
    """Samples of one surface where light is seen: geometry, light, what is measured and what is explained.

    The lamps of a sample are its photograph's light and that light's images in mirrors; `form` is 0 for one not seen.
    """

    photo: np.ndarray  # which photograph each sample is of
    normal: Float64[np.ndarray, "sample 3"]
    to_light: Float64[np.ndarray, "sample lamp 3"]
    to_viewer: Float64[np.ndarray, "sample 3"]
    form: Float64[np.ndarray, "sample lamp color"]
    measured: Float64[np.ndarray, "sample 3"]
    explained: Float64[np.ndarray, "sample 3"]  # diffuse + indirect
    weight: Float64[np.ndarray, " sample"]
    position: Float64[np.ndarray, "sample 3"]  # centred

    @property
    def is_lit(self) -> Bool[np.ndarray, "sample lamp"]:
        return self.form.max(axis=2) > 0

    def take(self, index: np.ndarray) -> "LobeSamples":
        """The samples of an index or mask."""
        return LobeSamples(**{name: getattr(self, name)[index] for name in self.__dataclass_fields__})


class Brushing(NamedTuple):
    """Which way a surface is brushed at a position: tangent + turn x position."""

    tangent: Float64[np.ndarray, "3"]
    turn: Float64[np.ndarray, "3"]


class Frames(NamedTuple):
    """The directions that anisotropic lobes may follow."""

    tangent: Float64[np.ndarray, "3"]  # of eq. (4)'s
    brushings: tuple[Brushing, ...] = ()


def mirror_cosine(samples: LobeSamples) -> np.ndarray:
    """Cosine between the viewer and the mirror direction of the nearest lamp that is seen, at each sample."""
    n_l = np.einsum("si,sli->sl", samples.normal, samples.to_light)
    n_v = np.einsum("si,si->s", samples.normal, samples.to_viewer)
    cosine = 2 * n_l * n_v[:, None] - np.einsum("sli,si->sl", samples.to_light, samples.to_viewer)
    return np.where(samples.is_lit, cosine, -1.0).max(axis=1)


def glossy_excess(samples: LobeSamples, white: float) -> tuple[float, float]:
    """How much brighter than predicted the surface is near the mirror direction, in its own scatters; and that scatter.

    The scatter is the robust one of the misfit more than 40 degrees away from the mirror direction: it follows the
    photographs' noise and the fits' own errors, so there is no constant to tune (1.1.2).
    """
    misfit = (_compress(samples.measured, white) - _compress(samples.explained, white)).mean(axis=1)
    cosine = mirror_cosine(samples)
    near, far = cosine > np.cos(np.radians(12)), cosine < np.cos(np.radians(40))
    if near.sum() < 10 or far.sum() < 10:
        near = cosine >= np.quantile(cosine, 0.9) if len(cosine) else near
        far = ~near
    if near.sum() < 10 or far.sum() < 10:
        return 0.0, 0.0
    scatter = max(float(robust_scale(misfit[far] - np.median(misfit[far]))), 1e-4)
    return float((np.median(misfit[near]) - np.median(misfit[far])) / scatter), scatter


def fit_lobes(
    samples: LobeSamples, white: float, frames: Frames, options: SpecularOptions
) -> tuple[tuple[Lobe, ...], BoundedFit | None, float]:
    """The lobes that left-out photographs ask for, the last fit, and the gain in dB on those photographs.

    Lobes are picked one by one from a dictionary of shapes, for which the colours are a linear least squares; each
    further one must make left-out photographs better. Then all are fitted together, shapes and colours. Energy above 1
    is scaled down to 1: a lobe may concentrate light, not make it.
    """
    if len(samples.photo) < 30 or options.max_lobes == 0:
        return (), None, 0.0
    folds = _folds(np.unique(samples.photo), samples, options.num_folds)
    atoms = _atoms(options.kinds, frames)
    is_brushed = np.array([kind.startswith("brushed") for kind, _ in atoms], bool)
    shapes = np.stack([_shape(samples, k, x, frames) for k, x in atoms])
    # A lobe whose peak no photograph comes near would be an extrapolation: it explains a misfit by its foot, and blazes
    # under a light that nobody has tried.
    is_seen = _seen_at_peak(samples, shapes, _peaks(samples, atoms, frames))
    parts = [_normal_system(samples, shapes, white, is_out) for is_out in folds]
    whole = tuple(sum(part[k] for part in parts) for k in (0, 1))
    systems = [tuple(whole[k] - part[k] for k in (0, 1)) for part in parts]
    is_halfway = np.array([kind == "halfway" for kind, _ in atoms], bool)

    def left_out(trial: list[int]) -> float:
        colors = [_colors(system, trial) if trial else None for system in systems]
        given = zip(colors, folds, strict=True)
        return sum(_held_out(samples, shapes, white, trial, color, is_out) for color, is_out in given)

    none = left_out([])
    # What is best alone need not be part of the best few: eq. (4)'s lobes by themselves are tried as well.
    ways = [
        _picked(whole, none, is_seen & mask, is_brushed, left_out, options)
        for mask in (~is_halfway, np.ones_like(is_seen))
    ]
    chosen, best_error = ways[gain_db(ways[0][1], ways[1][1]) > 0.5 * options.min_gain_db]
    if not chosen:
        return (), None, 0.0
    colors = _colors(whole, chosen)
    kept = []
    for atom, color in zip(chosen, colors, strict=True):
        kind, x = atoms[atom]
        x = x.copy()
        x[2:5] = np.log(np.clip(color, 1e-5, 1e3))
        kept.append((kind, x))
    thin = np.arange(0, len(samples.photo), max(1, len(samples.photo) // REFINED_SAMPLES))
    refined, last = _refined(samples.take(thin), white, frames, kept)
    # The shapes may walk away from what is seen; then those of the dictionary stand.
    values = np.stack([_shape(samples, kind, x, frames) for kind, x in refined])
    if _seen_at_peak(samples, values, _peaks(samples, refined, frames)).all():
        kept = refined
    lobes = tuple(_lobe(kind, parameters, frames) for kind, parameters in kept)
    return within_energy(lobes), last, gain_db(none, best_error)


def _picked(
    system: tuple,
    none: float,
    is_free: np.ndarray,
    is_brushed: np.ndarray,
    left_out: Callable[[list[int]], float],
    options: SpecularOptions,
) -> tuple[list[int], float]:
    """Atoms picked one by one, each kept only where it makes left-out photographs better, and the error with all."""
    chosen: list[int] = []
    best_error = none
    for _ in range(options.max_lobes):
        # As many of either sort: hundreds of brushed ones would crowd the others out.
        order = [int(a) for mask in (~is_brushed, is_brushed) for a in _promising(system, chosen, is_free & mask, 14)]
        if not order:
            break
        errors = np.full(len(is_free), np.inf)
        for atom in order:
            errors[atom] = left_out([*chosen, atom])
        # A brushed lobe has a frame to choose besides: it is taken for what the others cannot do.
        handicap = 10 ** (0.1 * max(options.min_gain_db, 0.0))
        winner = int(np.argmin(np.where(is_brushed, handicap * errors, errors)))
        if gain_db(best_error, errors[winner]) < options.min_gain_db:
            break
        chosen.append(winner)
        best_error = errors[winner]
    return chosen, best_error


def _atoms(kinds: tuple[str, ...], frames: Frames) -> list[tuple[str, np.ndarray]]:
    """The dictionary: exponents a factor 1.6 apart, a few ratios of c_x to c_z, each kind that is asked for.

    Those about the half-way direction have the exponent of Trowbridge and Reitz, or near it, and widths a factor 1.4
    apart; brushed ones each of two widths a factor 2 apart.
    """
    atoms = []
    for exponent in 1.6 ** np.arange(2, 20):
        for ratio in (-0.12, -0.05, 0.0, 0.05) if "isotropic" in kinds else ():
            atoms.append(("isotropic", np.array([np.log(exponent), ratio, 0, 0, 0])))
    for width, exponent in itertools.product(np.log(2.0) * np.arange(1, 13), (2.0, 5.0)) if "halfway" in kinds else ():
        atoms.append(("halfway", np.array([np.log(exponent), width, 0, 0, 0])))
    for exponent in 2.0 ** np.arange(1, 9) if "retro" in kinds else ():
        atoms.append(("retro", np.array([np.log(exponent), 0.0, 0, 0, 0])))
    for exponent in 2.0 ** np.arange(3, 10) if "anisotropic" in kinds else ():
        for turn in (0.0, np.pi / 4, np.pi / 2, -np.pi / 4):
            atoms.append(("anisotropic", np.array([np.log(exponent), 0.0, 0, 0, 0, -0.15, turn])))
    for k in range(len(frames.brushings)) if "brushed" in kinds else ():
        for narrow, wide in itertools.permutations(np.log(4.0) * np.arange(1, 6), 2):
            atoms.append((f"brushed {k}", np.array([np.log(2.5), narrow, 0, 0, 0, wide])))
    return atoms


def _normal_system(samples: LobeSamples, shapes: np.ndarray, white: float, mask: np.ndarray) -> tuple:
    """Gram matrix and moments of the dictionary, weighed by the slope of the compressed scale; one per colour."""
    grams, moments = [], []
    for color in range(3):
        form = samples.form[mask][:, :, min(color, samples.form.shape[2] - 1)]
        calm = samples.weight[mask] / (samples.measured[mask, color] ** 2 + white**2)
        rows = (shapes[:, mask] * form).sum(axis=2)
        left = samples.measured[mask, color] - samples.explained[mask, color]
        grams.append((rows * calm) @ rows.T)
        moments.append((rows * calm) @ left)
    return np.stack(grams), np.stack(moments)


def _colors(system: tuple, chosen: list[int]) -> np.ndarray:
    """Colours of the chosen atoms (lobe, 3): non-negative least squares."""
    from scipy.optimize import nnls

    grams, moments = system
    colors = np.zeros((len(chosen), 3))
    for color in range(3):
        gram = grams[color][np.ix_(chosen, chosen)]
        gram = gram + 1e-9 * np.trace(gram) / len(chosen) * np.eye(len(chosen))
        root = np.linalg.cholesky(gram + 1e-12 * np.eye(len(chosen)))
        colors[:, color] = nnls(root.T, np.linalg.solve(root, moments[color][chosen]))[0]
    return colors


def _shape(samples: LobeSamples, kind: str, x: np.ndarray, frames: Frames) -> np.ndarray:
    """A lobe's value at each sample and lamp as a share of its peak."""
    one = np.concatenate([x[:2], np.zeros(3), x[5:]])
    return _brdf(samples, (_lobe(kind, one, frames),))[..., 0]


def _peaks(samples: LobeSamples, lobes: list[tuple[str, np.ndarray]], frames: Frames) -> np.ndarray:
    """The most that each lobe can send to each sample's viewer, under the light that suits it best: |C v| ** n."""
    v_z = np.clip(np.einsum("si,si->s", samples.normal, samples.to_viewer), 0.0, 1.0)
    rows = []
    for kind, x in lobes:
        one = _lobe(kind, x, frames)
        if one.is_halfway:
            rows.append(np.ones_like(v_z))
            continue
        across = np.abs(one.axes[:2]).max()
        length = np.sqrt(across**2 * (1 - v_z**2) + one.axes[2] ** 2 * v_z**2)
        rows.append(np.maximum(length, 1e-6) ** one.exponent)
    return np.stack(rows)


def _seen_at_peak(samples: LobeSamples, shapes: np.ndarray, peaks: np.ndarray) -> np.ndarray:
    """Whether enough samples come near each lobe's peak, as far as their viewers could see it."""
    share = (shapes * samples.is_lit).max(axis=2) / np.maximum(peaks, 1e-30)
    return np.sort(share, axis=1)[:, -MIN_NEAR_PEAK] >= PEAK_SHARE


def _promising(system: tuple, chosen: list[int], is_seen: np.ndarray, count: int) -> np.ndarray:
    """The atoms that would lower the fitted photographs' error most, given those chosen; of those seen at their peak."""
    grams, moments = system
    colors = _colors(system, chosen) if chosen else np.zeros((0, 3))
    gain = np.zeros(grams.shape[1])
    for color in range(3):
        left = moments[color] - grams[color][:, chosen] @ colors[:, color]
        gain += np.maximum(left, 0.0) ** 2 / np.maximum(np.diag(grams[color]), 1e-30)
    gain[chosen] = -1.0
    gain[~is_seen] = -1.0
    order = np.argsort(gain)[::-1][:count]
    return order[gain[order] >= 0]


def _held_out(samples, shapes, white, chosen, colors, is_out) -> float:
    """Huber's error of the left-out samples on the compressed scale."""
    model = samples.explained[is_out].copy()
    for row, atom in enumerate(chosen):
        model += (shapes[atom, is_out][..., None] * samples.form[is_out]).sum(axis=1) * colors[row]
    miss = np.abs(_compress(model, white) - _compress(samples.measured[is_out], white))
    # A few pixels of an unmodelled blocker must not decide about a lobe.
    loss = np.where(miss < 0.15, 0.5 * miss**2, 0.15 * (miss - 0.075))
    return float((samples.weight[is_out][:, None] * loss).sum())


def _folds(photos: np.ndarray, samples: LobeSamples, num_folds: int) -> list[np.ndarray]:
    """Left-out photographs: every num_folds-th by their share of highlight, so that each fold has some of it."""
    cosine = mirror_cosine(samples)
    share = [np.sum(cosine[samples.photo == p] > 0.94) for p in photos]
    order = photos[np.argsort(share, kind="stable")]
    num_folds = min(num_folds, len(photos))
    if num_folds < 2:  # one photograph: its pixels are split instead
        halves = np.arange(len(samples.photo)) % 2 == 0
        return [halves, ~halves]
    return [np.isin(samples.photo, order[k::num_folds]) for k in range(num_folds)]


_BOUNDS = {  # log exponent, log |c_x / c_z| (and |c_y / c_z|), log colour (three)
    "isotropic": ([0.0, -0.7, -12, -12, -12], [np.log(MAX_EXPONENT), 0.7, 9, 9, 9]),
    "retro": ([0.0, -0.7, -12, -12, -12], [np.log(MAX_EXPONENT), 0.7, 9, 9, 9]),
    "anisotropic": ([0.0, -0.7, -12, -12, -12, -0.7, -1.6], [np.log(MAX_EXPONENT), 0.7, 9, 9, 9, 0.7, 1.6]),
    # log c_x (and log c_y) instead, squares of one over the widths
    "halfway": ([0.3, 0.6, -12, -12, -12], [4.0, 9.0, 9, 9, 9]),
    "brushed": ([0.3, 0.7, -12, -12, -12, 0.7], [4.0, 9.0, 9, 9, 9, 9.0]),
}


def _bounds(kind: str) -> tuple[list, list]:
    return _BOUNDS[kind.split()[0]]


def _lobe(kind: str, x: np.ndarray, frames: Frames) -> Lobe:
    if kind.startswith("brushed"):
        brushing, axes = frames.brushings[int(kind.split()[1])], np.array([np.exp(x[1]), np.exp(x[5]), 1.0])
        return Lobe(np.exp(x[2:5]), axes, float(np.exp(x[0])), *brushing, is_halfway=True)
    if kind == "halfway":
        return Lobe(np.exp(x[2:5]), np.exp([x[1], x[1], 0.0]), float(np.exp(x[0])), is_halfway=True)
    tangent = frames.tangent
    ratio_x = np.exp(x[1])
    ratio_y = np.exp(x[5]) if kind == "anisotropic" else ratio_x
    sign = 1.0 if kind == "retro" else -1.0
    axes = np.array([sign * ratio_x, sign * ratio_y, 1.0])
    axes = axes / np.abs(axes).max()
    along = np.zeros(3)
    if kind == "anisotropic":
        other = np.cross(tangent, np.eye(3)[int(np.argmin(np.abs(tangent)))])
        along = np.cos(x[6]) * tangent + np.sin(x[6]) * other / max(np.linalg.norm(other), 1e-12)
    return Lobe(np.exp(x[2:5]), axes, float(np.exp(x[0])), along)


def _refined(samples, white, frames, kept) -> tuple[list, BoundedFit]:
    """Shapes and colours of all lobes fitted together, from where the dictionary left them."""
    kinds = [kind for kind, _ in kept]
    lower = np.concatenate([np.array(_bounds(k)[0]) for k in kinds])
    upper = np.concatenate([np.array(_bounds(k)[1]) for k in kinds])
    sizes = np.cumsum([len(_bounds(k)[0]) for k in kinds])[:-1]
    measured = _compress(samples.measured, white)
    root = np.sqrt(samples.weight)[:, None]

    def residual(x: np.ndarray) -> np.ndarray:
        lobes = tuple(_lobe(k, part, frames) for k, part in zip(kinds, np.split(x, sizes), strict=True))
        return ((_compress(_model(samples, lobes), white) - measured) * root).ravel()

    start = np.concatenate([x for _, x in kept])
    fit = fit_bounded(residual, [start], lower, upper, loss_scale=0.05, max_evaluations=15)
    return list(zip(kinds, np.split(fit.value, sizes), strict=True)), fit


def _model(samples: LobeSamples, lobes: tuple[Lobe, ...]) -> np.ndarray:
    return samples.explained + (_brdf(samples, lobes) * samples.form).sum(axis=1)


def _brdf(samples: LobeSamples, lobes: tuple[Lobe, ...]) -> np.ndarray:
    shared = (samples.normal, samples.to_viewer, samples.position)
    normal, viewer, position = (np.broadcast_to(a[:, None], samples.to_light.shape) for a in shared)
    return lobe_brdf(lobes, normal, samples.to_light, viewer, position)


def _compress(radiance: np.ndarray, white: float) -> np.ndarray:
    return np.arcsinh(np.asarray(radiance, np.float64) / white)


def within_energy(lobes: tuple[Lobe, ...]) -> tuple[Lobe, ...]:
    """Lobes scaled so that all together send back no more than they get, for any viewer and colour."""
    excess = max(energy_of(lobes) / MAX_ENERGY, 1.0)
    return tuple(replace(lobe, color=lobe.color / excess) for lobe in lobes)


def status_of(fit: BoundedFit | None) -> tuple[Status, int, float]:
    """Status, rank and condition of a lobe fit; no fit is NO_DATA, and its fallback is no lobe."""
    return (fit.status, fit.rank, fit.condition) if fit else (Status.NO_DATA, 0, np.inf)


def specular_radiance(
    lobes: tuple[Lobe, ...],
    normal: Float32[np.ndarray, "point 3"],
    to_light: Float32[np.ndarray, "point 3"],
    to_viewer: Float32[np.ndarray, "point 3"],
    form: Float32[np.ndarray, "point color"],
    position: Float32[np.ndarray, "point 3"] | None = None,
) -> Float32[np.ndarray, "point 3"]:
    """The lobes' radiance where the light is seen; points in shadow cost nothing."""
    out = np.zeros((len(normal), 3), np.float32)
    lit = np.flatnonzero(form.max(axis=1) > 0)
    if lobes and len(lit):
        places = None if position is None else position[lit]
        out[lit] = lobe_brdf(lobes, normal[lit], to_light[lit], to_viewer[lit], places) * form[lit]
    return out

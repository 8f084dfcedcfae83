"""Surface detail: a small perturbation of the normal, or of the lobe's strength, per pixel; eq. (5) and (6).

The shading is linearised in the perturbation and solved by damped least squares over the photographs, a few times
over. Where no photograph says anything the perturbation stays zero.

Differs from the paper: the diffuse term takes part as well as the lobe (trap 17). Highlights are in one or two
photographs of a pixel or in none, the diffuse shading is in all of them and is linear in the normal; both are used,
on a compressed scale, so that neither peak nor noise drowns the other. And lobes may be reshaped together with the
perturbation, which widens the highlights that they are fitted to.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, Int32

from relight3d.errors import InputError
from relight3d.maths.bounded_fit import fit_bounded
from relight3d.maths.decibels import gain_db
from relight3d.maths.lafortune import MAX_EXPONENT, tangent_frame
from relight3d.records import Lobe
from relight3d.shading import energy_of, lobe_brdf
from relight3d.tracing import over_threads

POINTS = 12000  # that a thread takes at once: their arrays stay in the cache
NUM_COMPARED = 4000  # points of a surface by which kinds of detail are compared
NUM_JOINT, JOINT_SAMPLES = 2000, 12_000  # points, and pixels of photographs, by which lobes are fitted beside tilts
JOINT_STEPS = 7
MAX_RESHAPING = 4.0  # of an exponent
MIN_PHOTOS = 4  # with fewer, none is left out
LEAST_ENERGY = 1e-3  # of what arrives: lobes that send back less have inks of at most its reciprocal
MAX_TILT = 0.5  # tangent of the largest perturbation, about 27 degrees


@dataclass(frozen=True)
class DetailOptions:
    """How the perturbation is held."""

    mode: str = "auto"  # off, normal, lobe, ink, or auto: what left-out photographs prefer
    damping: float = 0.02  # of the data's own mean information: a pixel that knows less moves less
    num_steps: int = 3
    min_gain_db: float = 0.15  # of left-out photographs, for a surface to have detail at all
    num_inks: int = 4  # colours of a surface that may shine unlike; 1: all shine alike
    min_ink_gain_db: float = 0.4  # of left-out photographs, for them to do so

    def __post_init__(self) -> None:
        if self.mode not in ("auto", "off", "normal", "lobe", "ink"):
            raise InputError("detail.mode", self.mode, "auto, off, normal, lobe or ink")
        if not 1 <= self.num_inks <= 16:
            raise InputError("detail.num_inks", self.num_inks, "1 to 16")


class Choice(NamedTuple):
    """The detail that left-out photographs prefer, and how well they are predicted with it."""

    mode: str
    damping: float
    gain_db: float  # over none
    error: float  # of the left-out photographs


@dataclass(frozen=True, eq=False)
class DetailData:
    """What the perturbation of one surface's points is solved from; photographs first, then points."""

    to_light: Float32[np.ndarray, "photo #point 3"]  # one row for lights at infinity
    falloff: Float32[np.ndarray, "photo point color"]  # facing irradiance for power 1 where seen, without the cosine
    measured: Float32[np.ndarray, "photo point 3"]
    other: Float32[np.ndarray, "photo point 3"]  # indirect and thrown light: all that the normal does not change
    weight: Float32[np.ndarray, "photo point"]
    albedo: Float32[np.ndarray, "point 3"]
    normal: Float32[np.ndarray, "point 3"]  # the mesh's
    to_viewer: Float32[np.ndarray, "point 3"]
    position: Float32[np.ndarray, "point 3"] | None = None  # for brushed lobes
    ink: Int32[np.ndarray, " point"] | None = None  # which colour of its surface a point has, where these shine unlike
    gain: Float32[np.ndarray, " point"] | None = None  # a factor on each point's lobes


def perturb_normals(
    data: DetailData, lobes: tuple[Lobe, ...], white: float, options: DetailOptions, damping: float | None = None
) -> Float32[np.ndarray, "point 3"]:
    """Unit normals tilted so that the photographs agree better: damped Gauss-Newton on two tilts per point.

    Where inks shine unlike, how strongly each does is told anew at every step.
    """
    damping = options.damping if damping is None else damping
    tangent, bitangent = tangent_frame(data.normal)
    tilt = np.zeros((len(data.normal), 2), np.float32)
    for _ in range(options.num_steps):
        if data.ink is not None:
            data = replace(data, gain=ink_gains(data, lobes, white, _tilted(data.normal, tangent, bitangent, tilt)))
        gram, moment = _normal_equations(data, lobes, white, tangent, bitangent, tilt)
        trace = gram[:, 0] + gram[:, 2]
        typical = float(np.mean(trace[trace > 0])) if (trace > 0).any() else 1.0
        # Damping pulls the whole tilt to zero, not only the step: detail is a small correction.
        ridge = damping * typical
        moment = moment - ridge * tilt
        a, b, c = gram[:, 0] + ridge, gram[:, 1], gram[:, 2] + ridge
        determinant = np.maximum(a * c - b * b, 1e-30)
        step = np.stack([c * moment[:, 0] - b * moment[:, 1], a * moment[:, 1] - b * moment[:, 0]], 1)
        tilt = tilt + np.where(trace[:, None] > 0, step / determinant[:, None], 0.0).astype(np.float32)
        length = np.linalg.norm(tilt, axis=1, keepdims=True)
        tilt *= np.minimum(1.0, MAX_TILT / np.maximum(length, 1e-9)).astype(np.float32)
    return _tilted(data.normal, tangent, bitangent, tilt)


def lobe_gains(
    data: DetailData, lobes: tuple[Lobe, ...], white: float, options: DetailOptions
) -> Float32[np.ndarray, " point"]:
    """A factor on each point's lobe, by damped least squares; its ink's where no photograph shows a highlight."""
    base = np.ones(len(data.normal), np.float32) if data.ink is None else ink_gains(data, lobes, white, data.normal)
    top, bottom = _gain_equations(replace(data, gain=base), lobes, white, data.normal)
    ridge = options.damping * float(bottom.mean()) if len(bottom) else 0.0
    gain = 1.0 + top / np.maximum(bottom + ridge, 1e-30)
    return base * np.clip(np.where(bottom > 0, gain, 1.0), 0.2, 5.0).astype(np.float32)


def ink_gains(
    data: DetailData, lobes: tuple[Lobe, ...], white: float, normal: np.ndarray
) -> Float32[np.ndarray, " point"]:
    """A factor on the lobes of each ink, by least squares over all its points under some normals; 1 without highlights.

    None sends back more light than there is. Differs from the paper: eq. (6) asks each pixel, and few of them have seen a
    highlight.
    """
    assert data.ink is not None, "a surface of one ink"
    num = int(data.ink.max(initial=0)) + 1
    top, bottom = _gain_equations(replace(data, gain=None), lobes, white, normal)
    top, bottom = (np.bincount(data.ink, each, num) for each in (top, bottom))
    gain = np.where(bottom > 0, 1.0 + top / np.maximum(bottom, 1e-30), 1.0)
    energy = max(energy_of(lobes), LEAST_ENERGY)
    return np.clip(gain, 0.0, max(1.0, 1.0 / energy))[data.ink].astype(np.float32)


def _gain_equations(
    data: DetailData, lobes: tuple[Lobe, ...], white: float, normal: np.ndarray
) -> tuple[Float64[np.ndarray, " point"], Float64[np.ndarray, " point"]]:
    """Of each point, what the photographs leave times its highlights, and those squared."""
    top, bottom = np.zeros(len(normal)), np.zeros(len(normal))
    for photo in range(len(data.measured)):
        diffuse, specular = _shade(data, lobes, normal, photo)
        calm = _slope(data.measured[photo], white) * data.weight[photo][:, None]
        left = data.measured[photo] - diffuse - specular
        top += (calm * left * specular).sum(axis=1)
        bottom += (calm * specular * specular).sum(axis=1)
    return top, bottom


def misfit(
    data: DetailData, lobes: tuple[Lobe, ...], white: float, normal: np.ndarray, gain: np.ndarray, photos: np.ndarray
) -> float:
    """Mean squared compressed error over some photographs, for the choice between kinds of detail."""
    total = weight = 0.0
    for photo in map(int, photos):
        total += float((_compressed_miss(data, lobes, white, normal, gain[:, None], photo) ** 2).sum())
        weight += 3 * float(data.weight[photo].sum())
    return total / max(weight, 1e-30)


def _compressed_miss(data, lobes, white: float, normal: np.ndarray, gain, photo: int) -> Float32[np.ndarray, "point 3"]:
    """The error of one photograph on the compressed scale, by the root of its weight; no pixel counts for more than 0.5."""
    diffuse, specular = _shade(data, lobes, normal, photo)
    miss = np.arcsinh((diffuse + gain * specular) / white) - np.arcsinh(data.measured[photo] / white)
    return np.sqrt(data.weight[photo])[:, None] * np.clip(miss, -0.5, 0.5)


def choose_detail(
    data: DetailData, lobes: tuple[Lobe, ...], white: float, options: DetailOptions, num_folds: int = 3,
    dampings: tuple[float, ...] = (),
) -> Choice:  # fmt: skip
    """Which detail left-out photographs prefer; of one mode, with the damping of the options or the best of `dampings`."""
    num_photos = len(data.measured)
    modes = (
        {"normal": (0.005, 0.02, 0.1, 0.5), "lobe": (0.1,), "ink": (0.0,)}
        if options.mode == "auto"
        else {options.mode: dampings or (options.damping,)}
    )
    is_there = {"normal": True, "lobe": bool(lobes), "ink": data.ink is not None}
    if num_photos < MIN_PHOTOS or not any(is_there.get(mode, False) for mode in modes):
        return Choice("off", options.damping, 0.0, np.inf)
    thin = slice(None, None, max(1, -(-len(data.normal) // NUM_COMPARED)))
    sample = _points(data, thin)
    plain, everything = np.ones(len(sample.normal), np.float32), np.arange(num_photos)
    outs = [everything[fold::num_folds] for fold in range(num_folds)]
    tries = [(mode, damping) for mode, dampings in modes.items() for damping in dampings if is_there[mode]]

    def error_of(job: tuple) -> float:
        out, mode, damping = job
        normal, gain, known = sample.normal, plain, _photos(sample, np.setdiff1d(everything, out))
        if mode == "normal":
            normal = perturb_normals(known, lobes, white, options, damping)
        if mode in ("normal", "ink") and data.ink is not None:
            gain = ink_gains(known, lobes, white, normal)
        elif mode == "lobe":
            gain = lobe_gains(known, lobes, white, options)
        return misfit(sample, lobes, white, normal, gain, out)

    jobs = [(out, *each) for each in [("off", 0.0), *tries] for out in outs]
    none, *errors = np.reshape(over_threads(error_of, jobs), (-1, num_folds)).sum(axis=1)
    base = dict(zip(tries, errors, strict=True))
    (mode, damping), error = min(base.items(), key=lambda item: item[1])
    return Choice(mode, damping, gain_db(none, error), float(error))


def lobes_beside_tilts(
    data: DetailData, lobes: tuple[Lobe, ...], white: float, options: DetailOptions, num_folds: int = 3
) -> tuple[Lobe, ...]:
    """Lobes whose exponents and peaks predict left-out photographs best with the tilts that each choice of them asks for.

    The tilts are solved anew at every step (the variable projection of Golub and Pereyra, 1973): solved in turn, lobes
    follow tilts that follow lobes, and neither gets far. Hues, and the ratios of axes, stay.
    """
    num = max(1, min(NUM_JOINT, JOINT_SAMPLES // len(data.measured)))
    thin = _points(data, slice(None, None, max(1, -(-len(data.normal) // num))))
    facing = float(np.clip(np.median(np.einsum("pi,pi->p", thin.normal, thin.to_viewer)), 0.0, 1.0))
    everything = np.arange(len(data.measured))
    outs = [everything[fold::num_folds] for fold in range(num_folds)]

    def miss_of(job: tuple) -> np.ndarray:
        out, trial = job
        known = _photos(thin, np.setdiff1d(everything, out))
        normal = perturb_normals(known, trial, white, options)
        gain = 1.0 if known.ink is None else ink_gains(known, trial, white, normal)[:, None]
        return np.stack([_compressed_miss(thin, trial, white, normal, gain, photo) for photo in out.tolist()])

    def residual(x: np.ndarray) -> np.ndarray:
        trial = tuple(_reshaped(lobe, facing, *each) for lobe, each in zip(lobes, x.reshape(-1, 2), strict=True))
        return np.concatenate([miss.ravel() for miss in over_threads(miss_of, [(out, trial) for out in outs])])

    limits = np.tile(np.log([MAX_RESHAPING, MAX_RESHAPING**2]), len(lobes))
    fit = fit_bounded(residual, [np.zeros(len(limits))], -limits, limits, "linear", max_evaluations=JOINT_STEPS, step=0.05)
    return tuple(_reshaped(lobe, facing, *each) for lobe, each in zip(lobes, fit.value.reshape(-1, 2), strict=True))


def _reshaped(lobe: Lobe, facing: float, log_exponent: float, log_peak: float) -> Lobe:
    """A lobe with exponent and peak changed by factors: what it sends back at most to a viewer at that cosine, which with
    its energy kept grows as the exponent does.
    """
    exponent = min(lobe.exponent * np.exp(log_exponent), max(lobe.exponent, MAX_EXPONENT))
    # |C v|: the largest base of a power of eq. (4).
    base = 1.0 if lobe.is_halfway else np.hypot(lobe.axes[0] * np.sqrt(1 - facing**2), lobe.axes[2] * facing)
    log_gain = log_peak + log_exponent + (lobe.exponent - exponent) * np.log(max(base, 1e-6))
    return replace(lobe, exponent=float(exponent), color=lobe.color * np.exp(np.clip(log_gain, -50.0, 50.0)))


def _normal_equations(data, lobes, white, tangent, bitangent, tilt) -> tuple[np.ndarray, np.ndarray]:
    gram = np.zeros((len(tilt), 3))
    moment = np.zeros((len(tilt), 2))
    sides = np.array([[0, 0], [2e-3, 0], [0, 2e-3]], np.float32)

    def add(part: slice) -> None:
        normals = [_tilted(data.normal[part], tangent[part], bitangent[part], tilt[part] + side) for side in sides]
        num = part.stop - part.start
        # Where no light falls, or nothing is known, a tilt changes nothing.
        matters = (data.weight[:, part] > 0) & (data.falloff[:, part] > 0).any(axis=2)
        at_once = max(1, POINTS // num)  # of few points, several photographs
        for first in range(0, len(matters), at_once):
            photo, at = np.nonzero(matters[first : first + at_once])
            if len(at) == 0:
                continue
            known = _entries(data, first + photo, part.start + at)
            value, *moved = (sum(_shade(known, lobes, normal[at], 0)) for normal in normals)
            slope_t, slope_b = ((each - value) / sides[1, 0] for each in moved)
            miss, slope = known.measured[0] - value, _slope(known.measured[0], white)
            # Robust on the compressed scale: a wrong shadow is a miss that no small tilt can explain.
            calm = slope * known.weight[0][:, None] / np.maximum(1.0, np.abs(miss) * np.sqrt(slope) / 0.15)
            for k, (p, q) in enumerate(((slope_t, slope_t), (slope_t, slope_b), (slope_b, slope_b))):
                gram[part, k] += np.bincount(at, (calm * p * q).sum(axis=1), num)
            for k, each in enumerate((slope_t, slope_b)):
                moment[part, k] += np.bincount(at, (calm * each * miss).sum(axis=1), num)

    over_threads(add, [slice(k, min(k + POINTS, len(tilt))) for k in range(0, len(tilt), POINTS)])
    return gram, moment


def _shade(data: DetailData, lobes: tuple[Lobe, ...], normal: np.ndarray, photo: int) -> tuple[np.ndarray, np.ndarray]:
    """(diffuse and other, specular) radiance of one photograph for power 1 under some normals."""
    to_light = np.broadcast_to(data.to_light[photo], normal.shape)
    cosine = np.maximum(np.einsum("pi,pi->p", normal, to_light), 0.0)[:, None]
    form = data.falloff[photo] * cosine
    diffuse = data.albedo / np.float32(np.pi) * form + data.other[photo]
    if not lobes:
        return diffuse, np.zeros_like(diffuse)
    form = form if data.gain is None else form * data.gain[:, None]
    return diffuse, lobe_brdf(lobes, normal, to_light, data.to_viewer, data.position) * form


def _slope(radiance: np.ndarray, white: float) -> np.ndarray:
    """Squared slope of the compression at the measured radiance: how much a display would show of a difference."""
    return 1.0 / (radiance * radiance + np.float32(white * white))


def _tilted(normal: np.ndarray, tangent: np.ndarray, bitangent: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    moved = normal + tangent * tilt[:, :1] + bitangent * tilt[:, 1:]
    return (moved / np.linalg.norm(moved, axis=1, keepdims=True)).astype(np.float32)


def _points(data: DetailData, part: slice | np.ndarray) -> DetailData:
    """Some of the points."""
    per_photo = {n: getattr(data, n)[:, part] for n in ("falloff", "measured", "other", "weight")}
    shared = data.to_light.shape[1] == 1
    per_point = {n: getattr(data, n)[part] for n in ("albedo", "normal", "to_viewer")}
    per_point |= _optional(data, part)
    return DetailData(to_light=data.to_light if shared else data.to_light[:, part], **per_photo, **per_point)


def _entries(data: DetailData, photo: np.ndarray, point: np.ndarray) -> DetailData:
    """Some points, each of one photograph, as the points of a single one."""
    per_photo = {n: getattr(data, n)[photo, point][None] for n in ("falloff", "measured", "other", "weight")}
    to_light = data.to_light[photo, point if data.to_light.shape[1] > 1 else 0][None]
    per_point = {n: getattr(data, n)[point] for n in ("albedo", "normal", "to_viewer")}
    per_point |= _optional(data, point)
    return DetailData(to_light=to_light, **per_photo, **per_point)


def _photos(data: DetailData, photos: slice | np.ndarray) -> DetailData:
    """Some of the photographs."""
    chosen = {n: getattr(data, n)[photos] for n in ("to_light", "falloff", "measured", "other", "weight")}
    return replace(data, **chosen)


def _optional(data: DetailData, part: slice | np.ndarray) -> dict[str, np.ndarray | None]:
    given = {name: getattr(data, name) for name in ("position", "ink", "gain")}
    return {name: None if each is None else each[part] for name, each in given.items()}

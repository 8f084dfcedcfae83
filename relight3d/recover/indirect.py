"""Indirect and ambient light per face or vertex, as low-order functions of the light: eq. (7), Wu et al. 2004.

Per site, total - direct - specular = albedo / pi * irradiance(light), linear in the coefficients. The photographs are
first summed to sites (`gather`), one number per site, photograph and colour, after which neither the pixels nor the
choice of functions matter to the cost. The order of the functions is the one that predicts left-out photographs best,
by the leave-one-out residuals of the linear fit, which need no second fit.

Differs from the paper: sites may be vertices, blended over each face, since face-wise constants show (trap 4); the
functions are of the direction's cosines, since the angles' polynomial breaks at the pole (trap 5).
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float32, Float64

from relight3d.errors import InputError
from relight3d.maths.decibels import gain_db
from relight3d.maths.least_squares import Solution, solve_normal
from relight3d.maths.light_basis import BASES, degree_of
from relight3d.records import Health, Indirect, Observations
from relight3d.recover.sites import SITES
from relight3d.shading import indirect_design

SHARES = (0.1, 0.3, 1.0, 3.0, 10.0)  # of ambient light beside the mean of the lamps' indirect light, tried in turn
MIN_SPREAD = 0.05  # of the photographs' intensities: of equal ones no share is told


@dataclass(frozen=True)
class IndirectOptions:
    """Which functions of the light, where, and how they are held."""

    basis: str = (
        "auto"  # a name of maths.light_basis.BASES; auto: the best of sh2, linear, constant on left-out photographs
    )
    site: str = "vertex"  # vertex (smooth), face (the paper), pixel
    damping: float = 2e-3  # of the mean diagonal, times the function's degree squared
    smoothing_px: float = 3.0  # light is gathered over about so many pixels around a site
    max_ambient_condition: float = 60.0  # above this the photographs do not tell ambient from indirect

    def __post_init__(self) -> None:
        if self.basis != "auto" and self.basis not in BASES:
            raise InputError("indirect.basis", self.basis, f"auto or one of {', '.join(BASES)}")
        if self.site not in SITES:
            raise InputError("indirect.site", self.site, f"one of {', '.join(SITES)}")
        for name, value in (("damping", self.damping), ("smoothing_px", self.smoothing_px)):
            if not 0 <= value < np.inf:
                raise InputError(f"indirect.{name}", value, "a finite number, 0 or more")


@dataclass(frozen=True, eq=False)
class SiteSums:
    """The photographs summed to sites: weight, and weighted products with the albedo, per photograph and colour."""

    weight: Float64[np.ndarray, "site photo color"]  # sum of w * albedo^2
    moment: Float64[np.ndarray, "site photo color"]  # sum of w * albedo * (pi * radiance - albedo * direct)


def gather(
    binding: sp.csr_matrix,
    weight: Float32[np.ndarray, "photo point"],
    albedo: Float32[np.ndarray, "point 3"],
    target: Float32[np.ndarray, "photo point 3"],
    direct: Float32[np.ndarray, "photo point color"],
) -> SiteSums:
    """Sum the photographs to sites; `target` is radiance without its specular part, `direct` irradiance for power 1."""
    num_photos, block = len(target), 6  # photographs at once: one walk over the binding serves several
    weights = np.empty((binding.shape[0], num_photos, 3))
    moments = np.empty_like(weights)
    pi = np.float32(np.pi)
    for first in range(0, num_photos, block):
        part = range(first, min(first + block, num_photos))
        columns = [weight[p][:, None] * albedo * albedo for p in part]
        columns += [weight[p][:, None] * albedo * (pi * target[p] - albedo * direct[p]) for p in part]
        summed = (binding @ np.concatenate(columns, axis=1)).reshape(binding.shape[0], 2, len(part), 3)
        weights[:, part], moments[:, part] = summed[:, 0], summed[:, 1]
    return SiteSums(weights, moments)


@dataclass(frozen=True, eq=False)
class LightDesign:
    """The functions of the light at every site and photograph, with the ambient's column last if it has one."""

    basis: str
    rows: Float64[np.ndarray, "site photo color unknown"]  # sites or colours of length 1 are shared
    damping: Float64[np.ndarray, " unknown"]
    has_ambient: bool  # a column and an unknown of its own
    shared_ambient: Float64[np.ndarray, "site color"] | None = None  # or so much of the first function's unknown
    ambient_part: Float64[np.ndarray, "site photo color unknown"] | None = None  # of the rows, where it is shared

    @property
    def tells_ambient(self) -> bool:
        """Whether ambient light is apart from the lamps' own."""
        return self.has_ambient or self.shared_ambient is not None


def light_rows(
    basis: str,
    observed: Observations,
    sites: Float32[np.ndarray, "site 3"],
    anchors: Float64[np.ndarray, "light 3"],
    softening: float,
) -> Float64[np.ndarray, "row photo color unknown"]:
    """Shares times strength times basis; one row of sites for lights at infinity, one of colours for single lights."""
    all_directional = all(light.kind == "directional" for each in observed.lights for light in each)
    num_sites = 1 if all_directional else len(sites)
    colors = 1 if observed.form.shape[2] == 1 else 3
    rows = np.zeros((num_sites, len(observed.lights), colors, BASES[basis]))
    for photo, each in enumerate(observed.lights):
        for light in each:
            share = light.power / observed.scale[photo] if colors == 3 else np.ones(1)
            part = indirect_design(basis, light, sites[:num_sites], anchors, np.pi, softening)
            rows[:, photo] += part[:, None, :] * share[None, :, None]
    return rows


def design(
    basis: str,
    observed: Observations,
    sites: Float32[np.ndarray, "site 3"],
    anchors: Float64[np.ndarray, "light 3"],
    softening: float,
    options: IndirectOptions,
) -> LightDesign:
    """Rows of eq. (7) for normalised photographs: `light_rows`, and 1 / scale for ambient."""
    rows = light_rows(basis, observed, sites, anchors, softening)
    damping = options.damping * degree_of(basis) ** 2
    inverse = _inverse_scale(observed)
    has_ambient = _tells_ambient(rows.mean(axis=0)[:, 0], inverse, observed.is_dark, options.max_ambient_condition)
    if has_ambient:
        column = np.broadcast_to(inverse[None, :, None, None], (*rows.shape[:3], 1))
        rows = np.concatenate([rows, column], axis=3)
        damping = np.append(damping, options.damping)
    return LightDesign(basis, rows, damping, has_ambient)


def _inverse_scale(observed: Observations) -> Float64[np.ndarray, " photo"]:
    """What ambient light is in normalised photographs, relative to its mean."""
    return observed.scale.mean(axis=0).mean() / observed.scale.mean(axis=1)


def with_shared_ambient(lit: LightDesign, observed: Observations, share: float) -> LightDesign:
    """The functions without an unknown for ambient light: it is `share` of each site's mean light of the first function.

    Ambient light of every site's own takes intensities that differ much; one number for the scene takes little.
    """
    lit = without_ambient(lit)
    amount = share * lit.rows[..., 0].mean(axis=1)
    part = np.zeros_like(lit.rows)
    part[..., 0] = amount[:, None] * _inverse_scale(observed)[None, :, None]
    return replace(lit, rows=lit.rows + part, shared_ambient=amount, ambient_part=part)


def _tells_ambient(rows: np.ndarray, inverse_scale: np.ndarray, is_dark: np.ndarray, limit: float) -> bool:
    """Whether ambient light can be told from indirect: a lights-off frame, or intensities that differ enough (trap 6)."""
    if is_dark.any():  # also where all are dark: then ambient light is all there is
        return True
    joined = np.column_stack([rows, inverse_scale])
    lengths = np.linalg.norm(joined, axis=0)
    if (lengths == 0).any() or len(rows) < joined.shape[1]:
        return False
    s = np.linalg.svd(joined / lengths, compute_uv=False)
    return bool(s[-1] * limit > s[0])


def solve_sites(sums: SiteSums, lit: LightDesign, diagnose: bool = True) -> Solution:
    """Coefficients per site and colour: a batch of damped normal equations; value is (site * color, unknown, 1).

    Without `diagnose`, rank and condition are left out, which are most of the cost.
    """
    num_sites, num_photos, _ = sums.weight.shape
    unknowns = lit.rows.shape[3]
    gram = np.empty((num_sites, 3, unknowns, unknowns))
    moment = np.empty((num_sites, 3, unknowns))
    for color in range(3):
        rows = lit.rows[:, :, color if lit.rows.shape[2] == 3 else 0]
        if len(rows) == 1:
            outer = (rows[0][:, :, None] * rows[0][:, None, :]).reshape(num_photos, -1)
            gram[:, color] = (sums.weight[:, :, color] @ outer).reshape(num_sites, unknowns, unknowns)
            moment[:, color] = sums.moment[:, :, color] @ rows[0]
        else:
            gram[:, color] = np.einsum("nl,nlu,nlv->nuv", sums.weight[:, :, color], rows, rows, optimize=True)
            moment[:, color] = np.einsum("nl,nlu->nu", sums.moment[:, :, color], rows)
    seen = (sums.weight > 0).sum(axis=1).ravel()
    return solve_normal(
        gram.reshape(-1, unknowns, unknowns),
        moment.reshape(-1, unknowns, 1),
        num_rows=seen,
        damping=lit.damping,
        diagnose=diagnose,
    )


def predict(solution: Solution, lit: LightDesign) -> Float32[np.ndarray, "site photo 3"]:
    """The fitted irradiance at each site under each photograph's lights, for the normalised photographs."""
    value = solution.value[:, :, 0].reshape(-1, 3, lit.rows.shape[3])
    if len(lit.rows) == 1:
        shared = lit.rows[0]
        if shared.shape[1] == 1:
            return np.einsum("ncu,lu->nlc", value, shared[:, 0], optimize=True).astype(np.float32)
        return np.einsum("ncu,lcu->nlc", value, shared, optimize=True).astype(np.float32)
    rows = np.broadcast_to(lit.rows, (*lit.rows.shape[:2], 3, lit.rows.shape[3]))
    return np.einsum("ncu,nlcu->nlc", value, rows, optimize=True).astype(np.float32)


def left_out_error(sums: SiteSums, lit: LightDesign) -> float:
    """Mean squared leave-one-photograph-out error, per unit of weight, over a sample of sites (PRESS: exact)."""
    take = np.linspace(0, len(sums.weight) - 1, min(4000, len(sums.weight))).astype(int)
    weight, moment = sums.weight[take], sums.moment[take]
    squared = total = 0.0
    for color in range(3):
        rows = lit.rows[:, :, color if lit.rows.shape[2] == 3 else 0]
        rows = np.broadcast_to(rows if len(rows) == 1 else rows[take], (len(take), *rows.shape[1:]))
        w = weight[:, :, color]
        gram = np.einsum("nl,nlu,nlv->nuv", w, rows, rows, optimize=True)
        mean = np.maximum(np.einsum("nuu->n", gram) / gram.shape[1], 1e-30)
        ridge = (lit.damping + 1e-9)[None] * mean[:, None]
        inverse = np.linalg.inv(gram + ridge[:, :, None] * np.eye(gram.shape[1]))
        value = np.einsum("nuv,nlv,nl->nu", inverse, rows, moment[:, :, color], optimize=True)
        miss = moment[:, :, color] / np.maximum(w, 1e-30) - np.einsum("nlu,nu->nl", rows, value)
        leverage = np.einsum("nlu,nuv,nlv->nl", rows, inverse, rows, optimize=True) * w
        squared += float((w * (miss / np.maximum(1.0 - leverage, 0.02)) ** 2).sum())
        total += float(w.sum())
    return squared / max(total, 1e-30)


def without(sums: SiteSums, irradiance: Float64[np.ndarray, "site photo color"]) -> SiteSums:
    """What is left of the sums when an irradiance is known."""
    return SiteSums(sums.weight, sums.moment - sums.weight * irradiance)


def unexplained(sums: SiteSums) -> float:
    """Mean squared irradiance per unit of weight: the error of having no indirect light."""
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.where(sums.weight > 0, sums.moment**2 / sums.weight, 0.0).sum()
    return float(squares / max(sums.weight.sum(), 1e-30))


def without_ambient(lit: LightDesign) -> LightDesign:
    """The functions of the light alone."""
    count = BASES[lit.basis]
    rows = lit.rows[..., :count]
    if lit.shared_ambient is not None:
        rows = rows - lit.ambient_part
    return LightDesign(lit.basis, rows, lit.damping[:count], False)


def ambient_gain_db(sums: SiteSums, lit: LightDesign) -> float:
    """By how many dB left-out photographs are predicted better with ambient light than with indirect light alone."""
    if not lit.tells_ambient:
        return 0.0
    return gain_db(left_out_error(sums, without_ambient(lit)), left_out_error(sums, lit))


def choose_design(
    sums: SiteSums,
    observed: Observations,
    sites: np.ndarray,
    anchors: np.ndarray,
    softening: float,
    options: IndirectOptions,
    most: int = 9,
) -> tuple[LightDesign, float]:
    """The basis asked for, or the one that predicts left-out photographs best; fewer functions than photographs.

    Of those that `auto` tries, none with more than `most` functions. With it goes its left-out error.
    """
    names = ("constant", "linear", "sh2") if options.basis == "auto" else (options.basis,)
    fewer = min(max(len(observed.lights), 2) - 1, most if options.basis == "auto" else max(BASES.values()))
    usable = [name for name in names if BASES[name] <= fewer] or ["constant"]
    designs = [design(name, observed, sites, anchors, softening, options) for name in usable]
    errors = [left_out_error(sums, each) for each in designs]
    if not observed.is_dark.any() and np.ptp(_inverse_scale(observed)) >= MIN_SPREAD:
        shared = [with_shared_ambient(each, observed, share) for each in designs for share in SHARES]
        designs, errors = designs + shared, errors + [left_out_error(sums, each) for each in shared]
    best = int(np.argmin(errors))  # the first of equal ones: a share must win
    return designs[best], errors[best]


def indirect_of(
    solution: Solution, lit: LightDesign, observed: Observations, site: str, anchors: np.ndarray, softening: float
) -> tuple[Indirect, Health]:
    """The record of the solve: coefficients per site, ambient apart, and where the answer is weak."""
    count = BASES[lit.basis]
    value = solution.value[:, :, 0].reshape(-1, 3, lit.rows.shape[3]).transpose(0, 2, 1)
    ambient = np.zeros((len(value), 3))
    if lit.has_ambient:
        # The column was 1 / scale relative to the mean scale: in absolute irradiance it is the mean scale's share.
        ambient = np.maximum(value[:, count] * observed.scale.mean(axis=0).mean(), 0.0)
    elif lit.shared_ambient is not None:
        ambient = np.maximum(value[:, 0] * lit.shared_ambient * observed.scale.mean(axis=0).mean(), 0.0)
    indirect = Indirect(
        basis=lit.basis,
        site=site,
        coefficients=np.ascontiguousarray(value[:, :count], np.float32),
        ambient=ambient.astype(np.float32),
        anchors=anchors,
        reach_rad=reach_of(anchors),
        softening=softening,
        ambient_is_separate=lit.tells_ambient,
    )
    by_site = solution.status.reshape(-1, 3)
    health = Health(
        site,
        by_site.max(axis=1).astype(np.int8),
        solution.rank.reshape(-1, 3).min(axis=1).astype(np.int32),
        solution.condition.reshape(-1, 3).max(axis=1).astype(np.float32),
        solution.residual.reshape(-1, 3).mean(axis=1).astype(np.float32),
        fallback="the light of the nearest sites with data",
    )
    return indirect, health


def light_anchors(observed: Observations) -> Float64[np.ndarray, "light 3"]:
    """The photographed directions to the lights, seen from the scene's middle."""
    directions = [
        light.incident(np.zeros((1, 3)))[0][0] for each in observed.lights for light in each if np.any(light.power > 0)
    ]
    return np.array(directions, np.float64).reshape(-1, 3)


def reach_of(anchors: np.ndarray) -> float:
    """How far a light may be from the photographed ones and count as between them: the usual gap, or 10 degrees."""
    if len(anchors) < 2:
        return float(np.radians(10))
    cosine = np.clip(anchors @ anchors.T, -1, 1)
    np.fill_diagonal(cosine, -1.0)
    return float(max(np.radians(10), np.median(np.arccos(cosine.max(axis=1)))))

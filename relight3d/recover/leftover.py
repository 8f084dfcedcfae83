"""What the rounds left over: the unmodelled surroundings as mirrors show them, then the misfit between photographs.

Each is kept as far as left-out photographs gain by it, in what a display shows.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from relight3d.effects import SCENE
from relight3d.maths.blur import blur_known
from relight3d.maths.light_basis import BASES, embedding
from relight3d.records import Background, Observations, RelightModel
from relight3d.recover import indirect, residual
from relight3d.recover.decisions import decision
from relight3d.recover.rounds.light import calm_radiance
from relight3d.recover.rounds.state import ANY_GAIN, Evidence, Stage
from relight3d.recover.visible import JUST_VISIBLE, displayed, thinned, visible_gain_db
from relight3d.shading import light_strength, reflected
from relight3d.tracing import over_threads

if TYPE_CHECKING:
    from relight3d.views import View

PASSING = 4.0  # robust deviations: what misses by more does not carry over
UNSEEN = 1e-4  # of white: a step of a mode, below what 8 bits or noise show
SHARED_PX = 2.0  # deviation of the Gaussian over which pixels share a misfit: noise in it has a seventh of its size


def with_residual(stage: Stage, observed: Observations, model: RelightModel) -> RelightModel:
    """The surroundings seen in mirrors, then the interpolated misfit, each as far as left-out photographs gain."""
    model, view = _with_background(stage, observed, _with_outlines(stage, observed, model))
    options, bright = stage.options.residual, ~observed.is_dark
    if options.max_modes == 0 or bright.sum() < 3 or not stage.forced.get(("residual", SCENE), True):
        return model
    given = _given(stage, observed, model, view)

    def fit(is_known: np.ndarray) -> tuple[residual.Misfits, residual.ResidualFit, np.ndarray, float]:
        misfits = _of_state(stage, given.misfits, is_known)
        found, used = _fit_state(stage, given, misfits, is_known, options)
        return misfits, found, used, _visible_gain(stage, observed, given, is_known, found)

    *parts, gains = zip(*over_threads(fit, list(given.states.values())), strict=True)
    misfits, fits, used = (dict(zip(given.states, part, strict=True)) for part in parts)
    gain = max(0.0, *gains)
    reason = ", ".join(f"{n} {f.gain_db:.1f} dB over {np.degrees(f.length_rad):.0f} degrees" for n, f in fits.items())
    evidence = Evidence(gain, options.min_gain_db, reason)
    line = decision(stage, "residual", SCENE, evidence, gain > options.min_gain_db)
    model = replace(model, decisions=(*model.decisions, line))
    if not line.is_on:
        return model
    if ("residual", SCENE) in stage.forced:
        options = replace(options, min_state_gain_db=ANY_GAIN)
    unseen = UNSEEN * stage.white / float(given.strength.max())
    return replace(model, residual=residual.fit_residual(misfits, used, fits, options, unseen))


@dataclass(frozen=True, eq=False)
class _Given:
    """What the residual is fitted to, of the photographs that have a light."""

    misfits: residual.Misfits  # for a light of strength 1, as the frames multiply them; `shared` is not told yet
    strength: np.ndarray  # photo
    states: dict[str, np.ndarray]  # photo x point: known, and lit or dark
    is_judged: np.ndarray  # photo x point: inside and off the borders


def _given(stage: Stage, observed: Observations, model: RelightModel, view: "View") -> _Given:
    bright = ~observed.is_dark
    misfit, seen, thrown = (each[bright] for each in _misfit(stage, observed, model, view))
    # A hot pixel, a million times white, would be all that the modes are made of: it is told from its neighbours.
    is_sane = np.abs(misfit).max(axis=2) < 8 * stage.white
    known = (observed.weight > 0)[bright] & is_sane
    slope = 1.0 / (calm_radiance(stage, observed)[bright] + np.float32(0.1 * stage.white)) ** 2
    strength = np.array([_mean_strength(each, stage.softening) for each in observed.lights if each], np.float32)
    misfit = np.where(is_sane[..., None], misfit, 0.0).astype(np.float32) / strength[:, None, None]
    has_albedo = (model.pixels.albedo != model.surface_albedo[stage.surface].astype(np.float32)).any(axis=1)
    # On an outline a pixel is seldom wholly lit or dark: there the larger part decides.
    sure = np.where(observed.is_interior, 0.999, 0.6).astype(np.float32)
    misfits = residual.Misfits(
        value=misfit,
        shared=misfit,
        slope=slope * strength[:, None, None] ** 2,
        light=np.maximum(observed.radiance[bright].mean(axis=2), 0.0) * has_albedo,
        anchors=np.array([_mean_direction(each) for each in observed.lights if each]),
    )
    return _Given(
        misfits,
        strength,
        # What a mirror lights is not dark: carried to a shadow without that patch, its misfit would be a blotch.
        {"lit": known & (seen >= sure), "dark": known & (seen <= 1 - sure) & (thrown <= 1 - sure)},
        observed.is_interior & observed.is_safe[bright],
    )


def _fit_state(
    stage: Stage, given: _Given, misfits: residual.Misfits, is_known: np.ndarray, options: residual.ResidualOptions
) -> tuple[residual.ResidualFit, np.ndarray]:
    """The kernel of one state, and the entries that are carried over.

    A misfit far beyond what its pixel is missed by in other photographs (a narrow highlight a pixel aside, somebody's
    shadow) may be gone under the next light; surface by surface left-out photographs say whether it is.
    """
    num = stage.surfaces.num_surfaces
    fit = residual.choose_kernel(misfits, is_known, options)
    size = np.abs(misfits.value).mean(axis=2)
    usual = np.nanmedian(np.where(is_known | ~is_known.any(axis=0), size, np.nan), axis=0)
    dark = 0.01 * stage.white / given.strength[:, None]  # for a light of strength 1, as the misfits are
    is_passing = is_known & (size > PASSING * 1.4826 * np.maximum(usual, dark))
    stays = residual.carries_over(misfits, is_known, is_passing, fit, stage.surface, num)
    used = is_known & ~(is_passing & ~stays[stage.surface])
    return (fit, is_known) if stays.all() else (residual.choose_kernel(misfits, used, options, is_known), used)


def _of_state(stage: Stage, misfits: residual.Misfits, is_known: np.ndarray) -> residual.Misfits:
    """The misfits with the part of them that neighbouring pixels share, of those that are known."""
    shape, pixel = (stage.camera.height, stage.camera.width), stage.points.pixel
    shared = np.empty_like(misfits.value)
    for photo, known in enumerate(is_known):
        shared[photo] = blur_known(misfits.value[photo], known, pixel, shape, SHARED_PX).reshape(3, -1)[:, pixel].T
    return replace(misfits, shared=shared)


def _visible_gain(
    stage: Stage, observed: Observations, given: _Given, is_known: np.ndarray, fit: residual.ResidualFit
) -> float:
    """What a state's residual gains in what a display shows.

    Where all that is off the outlines and borders is explained as well as one can see, the mesh is right: what is missed
    at these is how their pixels are cut into samples, and does not count.
    """
    measured, missed = observed.radiance[~observed.is_dark], given.misfits.value
    inside = is_known & given.is_judged
    has_inside = inside.sum() > 0.2 * is_known.sum()
    before = _display_error(measured, missed, given.strength, inside, stage.white)
    if not has_inside or before > JUST_VISIBLE:
        before = _display_error(measured, missed, given.strength, is_known, stage.white)
        return visible_gain_db(fit.gain_db, before)
    options = replace(stage.options.residual, lengths_deg=(float(np.degrees(fit.length_rad)),), nuggets=(fit.nugget,))
    alone = residual.choose_kernel(_of_state(stage, given.misfits, inside), inside, options)
    return visible_gain_db(alone.gain_db, before)


def _with_outlines(stage: Stage, observed: Observations, model: RelightModel) -> RelightModel:
    """The model with what a pixel shows where the mesh covers only a part of it: whatever misses the photographs less.

    Black is right where the scene is photographed before nothing, or where such pixels have an albedo of the surface;
    where they have one of their own, that has been fitted to what is behind as well.
    """
    from relight3d.forward import gather_pixels, shade_points
    from relight3d.views import build_view

    whole = build_view(stage.rays, replace(model, outlines_end="object"), stage.camera)
    part = build_view(stage.rays, replace(model, outlines_end="black"), stage.camera)
    is_part = (part.throughput < whole.throughput).any(axis=1)
    pixels = np.unique(part.points.pixel[is_part])
    chosen = np.flatnonzero(np.isin(part.points.pixel, pixels))
    index = np.full(stage.camera.num_pixels, -1)
    index[stage.points.pixel] = np.arange(len(stage.points))
    rows = index[pixels]
    views = {"object": whole.take(chosen), "black": part.take(chosen)}
    lost = dict.fromkeys(views, 0.0)
    for photo, lights in enumerate(observed.lights):
        known = observed.weight[photo, rows] > 0
        measured = displayed(observed.radiance[photo, rows[known]], stage.white)
        for end, view in views.items():
            shaded = shade_points(stage.rays, model, view, list(lights))
            picture = sum(gather_pixels(model, view, list(lights), shaded))[pixels[known]] / observed.scale[photo]
            lost[end] += float(np.sum((displayed(picture, stage.white) - measured) ** 2))
    return replace(model, outlines_end="black" if lost["black"] < lost["object"] else "object")


def _with_background(stage: Stage, observed: Observations, model: RelightModel) -> tuple[RelightModel, "View"]:
    """The model with what its mirrors show beyond the mesh, and the view of it."""
    from relight3d.views import build_view

    view = build_view(stage.rays, model, stage.camera)
    is_called_for = model.indirect is not None and stage.forced.get(("background", SCENE), True)
    if len(view.miss_pixel) == 0 or not is_called_for:
        return model, view
    index = np.full(stage.camera.num_pixels, -1)
    index[stage.points.pixel] = np.arange(len(stage.points))
    # A pixel that shows a part of something as well does not tell what is behind it: it reads the nearest that does.
    whole = np.setdiff1d(view.miss_pixel, view.points.pixel)
    rows = index[whole if len(whole) else np.unique(view.miss_pixel)]
    model = replace(model, background=_background(stage, observed, model, rows[rows >= 0]))
    return model, build_view(stage.rays, model, stage.camera)


def _display_error(
    measured: np.ndarray, misfit: np.ndarray, strength: np.ndarray, is_known: np.ndarray, white: float
) -> float:
    """Mean square of display values by which the photographs are missed where they are known, over some of the points."""
    some = thinned(measured.shape[1])
    total = count = 0
    for picture, miss, known, factor in zip(measured[:, some], misfit[:, some], is_known[:, some], strength):
        picture, miss = picture[known], miss[known] * factor
        total += float(np.sum((displayed(picture, white) - displayed(picture - miss, white)) ** 2))
        count += picture.size
    return total / max(count, 1)


def _mean_direction(lights: tuple) -> np.ndarray:
    """Where a photograph's light comes from, seen from the scene's middle; of several, by power."""
    total = np.zeros(3)
    for light in lights:
        total = total + light.incident(np.zeros((1, 3)))[0][0] * float(light.power.sum())
    return total / max(float(np.linalg.norm(total)), 1e-12)


def _mean_strength(lights: tuple, softening: float) -> float:
    """The strength at the scene's middle of a photograph's light; of several, by power."""
    power = [float(light.power.sum()) for light in lights]
    strength = [float(light_strength(light, np.zeros((1, 3)), softening)[1][0]) for light in lights]
    return max(float(np.dot(power, strength)) / max(sum(power), 1e-30), 1e-30)


def _misfit(
    stage: Stage, observed: Observations, model: RelightModel, view: "View"
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measured less modelled radiance of every pixel and photograph; how much of the pixel sees the light itself, and
    how much of it only by way of a mirror.
    """
    from relight3d.forward import gather_pixels, shade_points

    num = stage.camera.num_pixels
    counts = np.maximum(np.bincount(view.points.pixel, minlength=num), 1)
    misfit = np.empty_like(observed.radiance)
    seen, thrown = (np.zeros(observed.is_lit.shape, np.float32) for _ in range(2))
    for photo, each in enumerate(observed.lights):
        shaded = shade_points(stage.rays, model, view, list(each))
        picture = sum(gather_pixels(model, view, list(each), shaded))[stage.points.pixel]
        misfit[photo] = observed.radiance[photo] - picture / observed.scale[photo]
        if each:
            itself = shaded.seen.max(axis=0)
            by_mirror = (shaded.direct.max(axis=1) > 0) * (1.0 - itself)
            for share, points in ((seen, itself), (thrown, by_mirror)):
                share[photo] = (np.bincount(view.points.pixel, points, num) / counts)[stage.points.pixel]
    return misfit, seen, thrown


def _background(stage: Stage, observed: Observations, model: RelightModel, rows: np.ndarray) -> Background:
    """Low-order functions of the light, per pixel whose mirror shows the surroundings."""
    assert model.indirect is not None
    weight = np.repeat(observed.weight[:, rows].T[:, :, None], 3, axis=2).astype(np.float64)
    sums = indirect.SiteSums(weight, weight * observed.radiance[:, rows].transpose(1, 0, 2))
    nowhere = np.zeros((1, 3), np.float32)
    most = BASES[model.indirect.basis]
    lit, _ = indirect.choose_design(
        sums, observed, nowhere, stage.anchors, stage.softening, stage.options.indirect, most
    )
    solution = indirect.solve_sites(sums, lit)
    record, _ = indirect.indirect_of(solution, lit, observed, "pixel", stage.anchors, stage.softening)
    points = stage.points.take(rows)
    # The frames ask the background in the functions of the indirect light.
    into = embedding(record.basis, model.indirect.basis).astype(np.float32)
    coefficients = np.einsum("nbc,bk->nkc", record.coefficients, into)
    return Background(points.pixel, reflected(points).astype(np.float32), coefficients, record.ambient)

"""Normals or lobe gains per pixel (1.3), surface by surface."""

import warnings
from dataclasses import replace

import numpy as np
from jaxtyping import Int32
from scipy.cluster.vq import kmeans2, vq

from relight3d.maths.decibels import gain_db
from relight3d.records import Lobe, Mirror, Observations
from relight3d.recover import detail, specular
from relight3d.recover.rounds.gloss import gloss_of, with_gloss, with_lobes
from relight3d.recover.rounds.light import lamps, shine, specular_layers, strongest
from relight3d.recover.rounds.state import ANY_GAIN, EDGE_TRUST, Evidence, Fitted, Stage
from relight3d.recover.surfaces import log_colors

MIN_TOGETHER = 4000  # points of a surface whose lobes are found with its relief: of fewer, too few see a narrow lobe
NUM_TOGETHER = 4000  # of them that are used
MAX_TURNS = 3
LEAST_DAMPING = 0.005
INK_STEPS, NUM_COLORED = 20, 8000  # of k-means over the colours of so many points
MIN_APART = 3.0  # scatters of one material: a surface whose colours are nearer to each other has one ink
LEAST_MIDDLE = 0.05  # of the gains of a surface's inks, for the lobes to be scaled by it


def fit_detail(stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> Fitted:
    """Normals or lobe gains per pixel (1.3), surface by surface, where left-out photographs gain by them."""
    general = stage.options.detail
    normal, gain = stage.points.normal.copy(), np.ones(len(stage.points), np.float32)
    evidence = {}
    for s in range(stage.surfaces.num_surfaces):
        mine, options = np.flatnonzero((stage.surface == s) & stage.is_matte), general
        if ("detail", s) in stage.forced and general.mode == "auto":
            options = replace(general, mode="normal", min_gain_db=ANY_GAIN)
        if len(mine) < 30 or options.mode == "off" or not stage.forced.get(("detail", s), True):
            continue
        data = _detail_data(stage, observed, mirrors, fitted, s, mine)
        fitted, ink = _lobes_by_ink(stage, observed, mirrors, fitted, s, data)
        data = data if ink is None else replace(_detail_data(stage, observed, mirrors, fitted, s, mine), ink=ink)
        choice = detail.choose_detail(data, fitted.lobes[s], stage.white, options)
        is_told = len(mine) >= MIN_TOGETHER and choice.mode == "normal" and choice.gain_db >= options.min_gain_db
        if is_told and fitted.lobes[s]:
            found_by = replace(options, mode="normal", damping=choice.damping)
            fitted = _lobes_with_relief(stage, observed, mirrors, fitted, s, found_by, ink)
            data = replace(_detail_data(stage, observed, mirrors, fitted, s, mine), ink=ink)
            choice = detail.choose_detail(data, fitted.lobes[s], stage.white, options)
        evidence["detail", s] = Evidence(
            choice.gain_db, general.min_gain_db,
            f"{choice.mode}, damping {choice.damping:g}" + ("" if ink is None else ", gloss by colour"),
        )  # fmt: skip
        if choice.gain_db < options.min_gain_db:
            continue
        if choice.mode == "normal":
            normal[mine] = detail.perturb_normals(data, fitted.lobes[s], stage.white, options, choice.damping)
        if choice.mode == "lobe":
            gain[mine] = detail.lobe_gains(data, fitted.lobes[s], stage.white, options)
        elif ink is not None:
            inked = detail.ink_gains(data, fitted.lobes[s], stage.white, normal[mine])
            # What another viewpoint shows of the surface has no gain: the lobes are those of its middle.
            middle = max(float(np.median(inked)), LEAST_MIDDLE)
            gain[mine], fitted = inked / np.float32(middle), with_lobes(fitted, s, _scaled(fitted.lobes[s], middle))
    changed = bool((normal != stage.points.normal).any())
    normal, evidence = normal if changed else stage.points.normal, {**fitted.evidence, **evidence}
    fitted = replace(fitted, normal=normal, lobe_gain=gain, evidence=evidence)
    return replace(fitted, specular=specular_layers(stage, observed, mirrors, fitted))


def _lobes_by_ink(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted, s: int, data: detail.DetailData
) -> tuple[Fitted, Int32[np.ndarray, " mine"] | None]:
    """Whether the colours of a surface shine unlike, as left-out photographs see it, with lobes that heard of it."""
    mine = np.flatnonzero((stage.surface == s) & stage.is_matte)
    ink = inks_of(stage, fitted, s, mine)
    if ink is None:
        return fitted, None
    data, options = replace(data, ink=ink), replace(stage.options.detail, mode="ink")
    found = detail.choose_detail(data, fitted.lobes[s], stage.white, options)
    if found.gain_db < options.min_ink_gain_db:
        return fitted, None
    gain = fitted.lobe_gain.copy()
    gain[mine] = detail.ink_gains(data, fitted.lobes[s], stage.white, data.normal)
    trial = with_gloss(fitted, s, gloss_of(stage, observed, mirrors, replace(fitted, lobe_gain=gain), s, mine))
    tried = detail.choose_detail(data, trial.lobes[s], stage.white, options)
    return (trial if tried.error < found.error and trial.lobes[s] else fitted), ink


def _scaled(lobes: tuple[Lobe, ...], factor: float) -> tuple[Lobe, ...]:
    return tuple(replace(lobe, color=lobe.color * factor) for lobe in lobes)


def inks_of(stage: Stage, fitted: Fitted, s: int, mine: np.ndarray) -> Int32[np.ndarray, " mine"] | None:
    """Which of a few colours each point of a surface has; None of one that has no lobes or only one colour."""
    num = stage.options.detail.num_inks
    if num < 2 or not fitted.lobes[s] or not fitted.is_textured[s]:
        return None
    colors = log_colors(fitted.albedo[mine]) / stage.options.surfaces.parts.floor
    sample = colors[:: max(1, len(colors) // NUM_COLORED)]
    around = sample - sample.mean(axis=0)
    along = np.argsort(around @ np.linalg.svd(around, full_matrices=False)[2][0], kind="stable")
    centers = np.unique([sample[part].mean(axis=0) for part in np.array_split(along, num)], axis=0)
    with warnings.catch_warnings():  # of a colour that no point is nearest to: nothing is lost
        warnings.simplefilter("ignore", UserWarning)
        centers = kmeans2(sample, centers, iter=INK_STEPS, minit="matrix")[0]
    is_apart = np.linalg.norm(centers[:, None] - centers, axis=2).max() >= MIN_APART
    return vq(colors, centers)[0].astype(np.int32) if is_apart else None


def _lobes_with_relief(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted, s: int,
    options: detail.DetailOptions, ink: np.ndarray | None,
) -> Fitted:  # fmt: skip
    """A surface's lobes, while left-out photographs gain by it: picked anew by tilted normals, then reshaped with them.

    Relief that is not known yet makes highlights look wide, and a wide lobe leaves relief nothing to explain.
    """
    mine = np.flatnonzero((stage.surface == s) & stage.is_matte)
    some = slice(None, None, max(1, -(-len(mine) // NUM_TOGETHER)))
    mine, ink, min_gain_db = mine[some], None if ink is None else ink[some], stage.options.detail.min_gain_db

    def data_of(trial: Fitted) -> detail.DetailData:
        return replace(_detail_data(stage, observed, mirrors, trial, s, mine), ink=ink)

    def left_out(data: detail.DetailData, trial: Fitted, damping: float) -> detail.Choice:
        # The better the lobes, the more of a tilt is believed.
        dampings = tuple(sorted({damping, max(damping / 4, LEAST_DAMPING)}))
        return detail.choose_detail(data, trial.lobes[s], stage.white, options, dampings=dampings)

    data = data_of(fitted)
    best = left_out(data, fitted, options.damping)
    for _ in range(MAX_TURNS):
        normal, gain = stage.points.normal.copy(), fitted.lobe_gain.copy()
        normal[mine] = detail.perturb_normals(data, fitted.lobes[s], stage.white, options, best.damping)
        gain[mine] = 1.0 if ink is None else detail.ink_gains(data, fitted.lobes[s], stage.white, normal[mine])
        found = gloss_of(stage, observed, mirrors, replace(fitted, normal=normal, lobe_gain=gain), s, mine)
        trial = with_gloss(fitted, s, found)
        trial_data = data_of(trial)
        tried = left_out(trial_data, trial, best.damping)
        if gain_db(best.error, tried.error) < min_gain_db:
            break
        fitted, data, best = trial, trial_data, tried
    if not fitted.lobes[s]:
        return fitted
    options = replace(options, damping=best.damping)
    lobes = detail.lobes_beside_tilts(data, fitted.lobes[s], stage.white, options)
    trial = with_lobes(fitted, s, specular.within_energy(lobes))
    tried = left_out(data_of(trial), trial, best.damping)
    return trial if gain_db(best.error, tried.error) >= min_gain_db else fitted


def _detail_data(
    stage: Stage, observed: Observations, mirrors, fitted: Fitted, s: int, mine: np.ndarray
) -> detail.DetailData:
    points = stage.points
    at_infinity = all(light.kind == "directional" for each in observed.lights for light in each)
    to_light = np.zeros((len(observed.lights), 1 if at_infinity else len(mine), 3), np.float32)
    falloff = observed.form[:, mine].copy()
    for photo, each in enumerate(observed.lights):
        if each:
            way = strongest(each).incident(points.position[mine])[0]
            to_light[photo] = way[:1] if at_infinity else way
            falloff[photo] /= np.maximum(np.einsum("pi,pi->p", points.normal[mine], way), 0.02)[:, None]
    matte = fitted.albedo[mine] / np.float32(np.pi)
    other = matte * fitted.irradiance[:, mine]
    for photo in range(len(other) if observed.thrown is not None else 0):
        for lamp in lamps(observed, mirrors, photo, mine):
            if lamp.is_image:
                # By the mesh's own normals: a tilt is solved from each photograph's own light alone.
                other[photo] += matte * lamp.form + shine(points, fitted.lobes[s], lamp, points.normal, mine)
    usable = observed.is_safe[:, mine] & observed.is_lit[:, mine]
    usable = usable * np.where(observed.is_interior[mine], 1.0, EDGE_TRUST)
    return detail.DetailData(
        to_light=to_light,
        falloff=falloff,
        measured=observed.radiance[:, mine],
        other=other.astype(np.float32),
        weight=(observed.weight[:, mine] * usable).astype(np.float32),
        albedo=fitted.albedo[mine],
        normal=points.normal[mine],
        to_viewer=points.to_viewer[mine],
        position=points.position[mine],
    )

"""Normals or lobe gains per pixel (1.3), surface by surface."""

from dataclasses import replace

import numpy as np

from relight3d.maths.decibels import gain_db
from relight3d.records import Mirror, Observations
from relight3d.recover import detail, specular
from relight3d.recover.rounds.gloss import gloss_of, with_gloss, with_lobes
from relight3d.recover.rounds.light import lamps, shine, specular_layers, strongest
from relight3d.recover.rounds.state import ANY_GAIN, EDGE_TRUST, Evidence, Fitted, Stage

MIN_TOGETHER = 4000  # points of a surface whose lobes are found with its relief: of fewer, too few see a narrow lobe
NUM_TOGETHER = 4000  # of them that are used
MAX_TURNS = 3
LEAST_DAMPING = 0.005


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
        choice = detail.choose_detail(data, fitted.lobes[s], stage.white, options)
        is_told = len(mine) >= MIN_TOGETHER and choice.mode == "normal" and choice.gain_db >= options.min_gain_db
        if is_told and fitted.lobes[s]:
            found_by = replace(options, mode="normal", damping=choice.damping)
            fitted = _lobes_with_relief(stage, observed, mirrors, fitted, s, found_by)
            data = _detail_data(stage, observed, mirrors, fitted, s, mine)
            choice = detail.choose_detail(data, fitted.lobes[s], stage.white, options)
        evidence["detail", s] = Evidence(
            choice.gain_db, general.min_gain_db, f"{choice.mode}, damping {choice.damping:g}"
        )
        if choice.gain_db < options.min_gain_db:
            continue
        if choice.mode == "normal":
            normal[mine] = detail.perturb_normals(data, fitted.lobes[s], stage.white, options, choice.damping)
        elif choice.mode == "lobe":
            gain[mine] = detail.lobe_gains(data, fitted.lobes[s], stage.white, options)
    changed = bool((normal != stage.points.normal).any())
    normal, evidence = normal if changed else stage.points.normal, {**fitted.evidence, **evidence}
    fitted = replace(fitted, normal=normal, lobe_gain=gain, evidence=evidence)
    return replace(fitted, specular=specular_layers(stage, observed, mirrors, fitted))


def _lobes_with_relief(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted, s: int,
    options: detail.DetailOptions,
) -> Fitted:  # fmt: skip
    """A surface's lobes, while left-out photographs gain by it: picked anew by tilted normals, then reshaped with them.

    Relief that is not known yet makes highlights look wide, and a wide lobe leaves relief nothing to explain.
    """
    mine = np.flatnonzero((stage.surface == s) & stage.is_matte)
    mine, min_gain_db = mine[:: max(1, -(-len(mine) // NUM_TOGETHER))], stage.options.detail.min_gain_db

    def data_of(trial: Fitted) -> detail.DetailData:
        return _detail_data(stage, observed, mirrors, trial, s, mine)

    def left_out(data: detail.DetailData, trial: Fitted, damping: float) -> detail.Choice:
        # The better the lobes, the more of a tilt is believed.
        dampings = tuple(sorted({damping, max(damping / 4, LEAST_DAMPING)}))
        return detail.choose_detail(data, trial.lobes[s], stage.white, options, dampings=dampings)

    data = data_of(fitted)
    best = left_out(data, fitted, options.damping)
    for _ in range(MAX_TURNS):
        normal = stage.points.normal.copy()
        normal[mine] = detail.perturb_normals(data, fitted.lobes[s], stage.white, options, best.damping)
        found = gloss_of(stage, observed, mirrors, replace(fitted, normal=normal), s, mine)
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

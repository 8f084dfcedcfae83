"""Normals or lobe gains per pixel (1.3), surface by surface."""

from dataclasses import replace

import numpy as np

from relight3d.records import Mirror, Observations
from relight3d.recover import detail
from relight3d.recover.rounds.light import lamps, shine, specular_layers, strongest
from relight3d.recover.rounds.state import ANY_GAIN, EDGE_TRUST, Evidence, Fitted, Stage


def fit_detail(stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> Fitted:
    """Normals or lobe gains per pixel (1.3), surface by surface, where left-out photographs gain by them."""
    general = stage.options.detail
    normal, gain = stage.points.normal.copy(), np.ones(len(stage.points), np.float32)
    evidence = dict(fitted.evidence)
    for s in range(stage.surfaces.num_surfaces):
        mine, options = np.flatnonzero((stage.surface == s) & stage.is_matte), general
        if ("detail", s) in stage.forced and general.mode == "auto":
            options = replace(general, mode="normal", min_gain_db=ANY_GAIN)
        if len(mine) < 30 or options.mode == "off" or not stage.forced.get(("detail", s), True):
            continue
        data = _detail_data(stage, observed, mirrors, fitted, s, mine)
        mode, damping, gain_db = detail.choose_detail(data, fitted.lobes[s], stage.white, options)
        evidence["detail", s] = Evidence(gain_db, general.min_gain_db, f"{mode}, damping {damping:g}")
        if gain_db < options.min_gain_db:
            continue
        if mode == "normal":
            normal[mine] = detail.perturb_normals(data, fitted.lobes[s], stage.white, options, damping)
        elif mode == "lobe":
            gain[mine] = detail.lobe_gains(data, fitted.lobes[s], stage.white, options)
    changed = bool((normal != stage.points.normal).any())
    fitted = replace(fitted, normal=normal if changed else stage.points.normal, lobe_gain=gain, evidence=evidence)
    return replace(fitted, specular=specular_layers(stage, observed, mirrors, fitted))


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

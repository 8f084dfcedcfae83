"""Which surfaces are glossy (1.1.2), and their lobes."""

import logging
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from relight3d.maths.bounded_fit import BoundedFit
from relight3d.maths.halfway import rigid_field
from relight3d.records import Lobe, Mirror, Observations, ShadingPoints
from relight3d.recover import specular
from relight3d.recover.rounds.light import cosine_change, lamps, specular_layers
from relight3d.recover.rounds.state import ANY_GAIN, Evidence, Fitted, Stage

log = logging.getLogger("relight3d")
MIN_INTERIOR = 150  # points off the outlines that a surface's lobes are fitted to alone


class Gloss(NamedTuple):
    """A surface's lobes, their fit, and why they are there or not."""

    lobes: tuple[Lobe, ...]
    fit: BoundedFit | None
    evidence: Evidence


def fit_gloss(stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> Fitted:
    """Which surfaces are glossy (1.1.2), and their lobes."""
    for s in range(stage.surfaces.num_surfaces):
        mine = np.flatnonzero((stage.surface == s) & stage.is_matte)
        fitted = with_gloss(fitted, s, gloss_of(stage, observed, mirrors, fitted, s, mine))
    return replace(fitted, specular=specular_layers(stage, observed, mirrors, fitted))


def gloss_of(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted, s: int, mine: np.ndarray
) -> Gloss:
    """A surface's lobes by some of its points and their normals as they are now."""
    inside = mine[observed.is_interior[mine]]
    if len(inside) >= MIN_INTERIOR:  # a small surface is all outline: better its mixed pixels than none
        mine = inside
    samples = _lobe_samples(stage, observed, mirrors, fitted, mine)
    excess, scatter = specular.glossy_excess(samples, stage.white)
    found, fit, gain, options = (), None, 0.0, stage.options.specular
    if stage.forced.get(("lobes", s), excess > options.excess_sigmas or bool(fitted.lobes[s])):
        if ("lobes", s) in stage.forced:
            options = replace(options, min_gain_db=ANY_GAIN)
        found, fit, gain = specular.fit_lobes(samples, stage.white, _frames(stage, s), options)
    reason = f"{excess:.1f} scatters brighter than predicted near the mirror direction"
    log.debug("%s: %s (scatter %.4f), %d lobes", stage.surfaces.names[s], reason, scatter, len(found))
    return Gloss(found, fit, Evidence(gain, stage.options.specular.min_gain_db, reason))


def with_lobes(fitted: Fitted, s: int, lobes: tuple[Lobe, ...]) -> Fitted:
    """What is fitted with other lobes of one surface; what they send is not computed anew."""
    return replace(fitted, lobes=tuple(lobes if k == s else each for k, each in enumerate(fitted.lobes)))


def with_gloss(fitted: Fitted, s: int, gloss: Gloss) -> Fitted:
    """What is fitted with a surface's new lobes, their fit and their evidence."""
    fits: list[BoundedFit | None] = [*fitted.lobe_fits] or [None] * len(fitted.lobes)
    fits[s] = gloss.fit
    evidence = {**fitted.evidence, ("lobes", s): gloss.evidence}
    return replace(with_lobes(fitted, s, gloss.lobes), lobe_fits=tuple(fits), evidence=evidence)


def _lobe_samples(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted, mine: np.ndarray
) -> specular.LobeSamples:
    """Samples of a surface under one light each and its images in mirrors, evenly over the angle to the mirror direction:
    the narrow peak is heard as much as the wide rest.
    """
    single = np.array([len(each) == 1 for each in observed.lights])
    usable = observed.is_reached & observed.is_safe & (observed.weight > 0) & single[:, None]
    photo, point = np.nonzero(usable[:, mine])
    point = mine[point]
    angle = _nearest_deg(stage.points, observed, mirrors, fitted.normal, photo, point)
    bins = np.minimum((angle / 3).astype(int), 39)
    num = min(stage.options.specular.num_samples, len(photo))
    chosen = np.zeros(0, int)
    if num:
        probability = 1.0 / np.bincount(bins, minlength=40)[bins]
        rng = np.random.default_rng(7)
        chosen = np.sort(rng.choice(len(photo), num, replace=False, p=probability / probability.sum()))
    photo, point = photo[chosen], point[chosen]
    to_light, form = _lighting(stage.points, observed, mirrors, fitted.normal, photo, point)
    return specular.LobeSamples(
        photo=photo,
        normal=fitted.normal[point].astype(np.float64),
        to_light=to_light,
        to_viewer=stage.points.to_viewer[point].astype(np.float64),
        form=form * fitted.lobe_gain[point, None, None],  # what is explained is by the form without it
        measured=observed.radiance[photo, point].astype(np.float64),
        explained=fitted.albedo[point] / np.pi * (form.sum(axis=1) + fitted.irradiance[photo, point]),
        weight=np.ones(len(photo)),
        position=stage.points.position[point].astype(np.float64),
    )


def _nearest_deg(
    points: ShadingPoints, observed: Observations, mirrors: tuple[Mirror, ...], normal, photo, point
) -> Float64[np.ndarray, " sample"]:
    """The angle between each sample's viewer and the nearest mirror direction of a lamp that it sees."""
    cosine = np.full(len(photo), -1.0)
    for p in np.unique(photo).tolist():
        here = np.flatnonzero(photo == p)
        for lamp in lamps(observed, mirrors, p, point[here]):
            lit = here[lamp.form.max(axis=1) > 0]
            to_light = lamp.light.incident(points.position[point[lit]])[0]
            up, viewer = (a[point[lit]].astype(np.float64) for a in (normal, points.to_viewer))
            n_l, n_v = (np.einsum("si,si->s", up, d) for d in (to_light, viewer))
            cosine[lit] = np.maximum(cosine[lit], 2 * n_l * n_v - np.einsum("si,si->s", to_light, viewer))
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def _lighting(
    points: ShadingPoints, observed: Observations, mirrors: tuple[Mirror, ...], normal, photo, point
) -> tuple[Float64[np.ndarray, "sample lamp 3"], Float64[np.ndarray, "sample lamp color"]]:
    """Direction to each sample's lamps and their form with detail, strongest first: as many as any sample sees."""
    num_images = 0 if observed.thrown is None else len(observed.thrown)
    num_colors = 3 if num_images else observed.form.shape[2]
    to_light, form = (np.zeros((len(photo), 1 + num_images, n)) for n in (3, num_colors))
    for p in np.unique(photo).tolist():
        here = photo == p
        at = point[here]
        for k, lamp in enumerate(lamps(observed, mirrors, p, at)):
            to_light[here, k] = lamp.light.incident(points.position[at])[0]
            change = cosine_change(points.normal[at], normal[at], to_light[here, k])
            form[here, k] = lamp.form * change[:, None]
    order = np.argsort(-form.max(axis=2), axis=1, kind="stable")
    num_seen = max(1, int((form.max(axis=2) > 0).sum(axis=1).max(initial=0)))
    to_light, form = (np.take_along_axis(a, order[:, :num_seen, None], axis=1) for a in (to_light, form))
    return to_light, form


def _frames(stage: Stage, s: int) -> specular.Frames:
    """The directions that a surface may be brushed in: lengthways, along its UVs, or in circles about one of its axes."""
    along, still = _tangent(stage, s), np.zeros(3)
    brushings = [specular.Brushing(along, still)]
    by_uvs = _along_uvs(stage, s)
    brushings += [] if by_uvs is None else [by_uvs]
    faces = np.flatnonzero(stage.surfaces.surface_of_face == s)
    corners = stage.mesh.centered_vertices[stage.mesh.faces[faces]].astype(np.float64)
    area = stage.mesh.face_areas[faces]
    if len(faces) > 3 and area.sum() > 0:
        places = corners.mean(axis=1)
        middle = np.average(places, axis=0, weights=area)
        _, axes = np.linalg.eigh(np.cov((places - middle).T, aweights=area))
        size = np.sqrt(np.average(((places - middle) ** 2).sum(axis=1), weights=area))
        for axis in axes.T / max(size, 1e-30):
            brushings.append(specular.Brushing(-np.cross(axis, middle), axis))
    return specular.Frames(along, tuple(brushings))


def _along_uvs(stage: Stage, s: int) -> specular.Brushing | None:
    """The brushing that runs most nearly as the first texture coordinate grows; None without UVs."""
    mine = np.flatnonzero((stage.surface == s) & stage.is_matte)
    if stage.mesh.corner_uvs is None or len(mine) < 3:
        return None
    mine = mine[:: max(1, len(mine) // 4000)]
    face, normal = stage.points.face[mine], stage.points.normal[mine].astype(np.float64)
    corners = stage.mesh.centered_vertices[stage.mesh.faces[face]].astype(np.float64)
    uvs = stage.mesh.corner_uvs[face].astype(np.float64)
    sides, steps = corners[:, 1:] - corners[:, :1], uvs[:, 1:] - uvs[:, :1]
    determinant = steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0]
    along = sides[:, 0] * steps[:, 1, 1:] - sides[:, 1] * steps[:, 0, 1:]
    along = along * np.sign(determinant)[:, None]
    along -= normal * np.einsum("pi,pi->p", normal, along)[:, None]
    length = np.linalg.norm(along, axis=1)
    good = (determinant != 0) & (length > 0)
    if good.sum() < 3:
        return None
    field = rigid_field(
        stage.points.position[mine][good].astype(np.float64), along[good] / length[good, None], normal[good]
    )
    return specular.Brushing(*field)


def _tangent(stage: Stage, s: int) -> np.ndarray:
    """The surface's longest direction: brushed metal is mostly brushed along it."""
    places = stage.points.position[stage.surface == s].astype(np.float64)
    if len(places) < 3:
        return np.array([1.0, 0.0, 0.0])
    _, vectors = np.linalg.eigh(np.cov((places - places.mean(axis=0)).T))
    along = vectors[:, -1]
    return along * np.sign(along[np.argmax(np.abs(along))])

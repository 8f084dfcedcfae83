"""What recovery goes through more than once: albedo and indirect light in turn, then lobes, detail and mirrors.

Each function takes what is fitted so far and returns a new Fitted; nothing is edited in place. What one stage explains is
taken out of the photographs before the next: the diffuse fits see radiance less lobes, the lobes see it less diffuse.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from relight3d.camera import Camera
from relight3d.effects import SCENE, forced_states
from relight3d.maths.least_squares import Solution, robust_weights, weighted_median
from relight3d.records import Lobe, Mirror, Observations, PatchMesh, PixelMap, RelightModel, ShadingPoints, Surfaces
from relight3d.recover import detail, diffuse, indirect, mirror, specular, texture
from relight3d.tracing import RayScene

if TYPE_CHECKING:
    from relight3d.recover.run import RecoverOptions

log = logging.getLogger("relight3d")
MIN_INFORMATION = 0.05  # of the median: a pixel with so much is believed by half
EDGE_TRUST = 0.03  # of a pixel on an outline, which mixes two surfaces: enough to fill it, too little to decide
SCENE_NOISE_DB = 0.1  # what a gain of the whole scene must exceed
NOT_TOLD = "nothing tells it from indirect light"
ALL_OF_IT_DB = 100.0  # the gain of an effect without which there is nothing
ANY_GAIN = -1e9  # dB: the threshold of what a person forced on
MIN_INTERIOR = 150  # points off the outlines that a surface's lobes are fitted to alone


@dataclass(frozen=True, eq=False)
class Stage:
    """What stays the same through all rounds."""

    options: "RecoverOptions"
    mesh: PatchMesh
    rays: RayScene
    camera: Camera
    points: ShadingPoints
    surfaces: Surfaces
    surface: np.ndarray  # of each point
    panel_of_face: np.ndarray  # smooth pieces of surfaces
    is_matte: np.ndarray  # point: not on a mirror
    hear: object  # sites hear their own points
    gather: object  # and their neighbours' too
    spread: object  # points read sites
    anchors: np.ndarray
    softening: float
    white: float  # the radiance that shows as white, in normalised photographs
    forced: Mapping[tuple[str, int], bool] = field(default_factory=dict)  # effects that a person switched


@dataclass(frozen=True, eq=False)
class Evidence:
    """Why an effect is on or off: what left-out photographs gain by it, and how much of a gain is chance."""

    gain_db: float
    noise_db: float
    reason: str


@dataclass(frozen=True, eq=False)
class Fitted:
    """What is fitted so far; arrays per photograph are normalised."""

    albedo: np.ndarray  # point x 3
    surface_albedo: np.ndarray  # surface x 3
    irradiance: np.ndarray  # photo x point x 3: indirect and ambient
    specular: np.ndarray | None  # photo x point x 3: lobes; None while there are none
    normal: np.ndarray  # point x 3
    lobe_gain: np.ndarray  # point
    lobes: tuple[tuple[Lobe, ...], ...]
    is_textured: np.ndarray  # surface: its texture is kept per pixel
    texture_shows: np.ndarray  # surface: the difference measure calls it textured
    design: indirect.LightDesign | None = None
    solution: Solution | None = None
    border: Solution | None = None
    joint: Solution | None = None
    owner: np.ndarray | None = None  # point: whose scale it has, a surface's or a panel's
    lobe_fits: tuple = ()
    trust: np.ndarray | None = None  # photo x point: robust weights
    blocked: tuple[int, ...] = ()  # photographs that an unmodelled blocker or lamp spoils
    scale_words: tuple[str, ...] = ()
    evidence: dict[tuple[str, int], Evidence] = field(default_factory=dict)


def set_stage(
    options: "RecoverOptions",
    mesh: PatchMesh,
    rays: RayScene,
    camera: Camera,
    points: ShadingPoints,
    surfaces: Surfaces,
    mirrors: tuple[Mirror, ...],
    observed: Observations,
    exposure: float,
) -> Stage:
    """All that the rounds share: who hears whom, and in which units."""
    surface = surfaces.surface_of_face[points.face]
    is_matte = ~np.isin(surface, [m.surface for m in mirrors])
    site = options.indirect.site
    binding = indirect.site_binding(mesh, points, site)
    heard = binding.tocsc(copy=True)
    heard.data *= np.repeat(is_matte & observed.is_interior, np.diff(heard.indptr))
    heard = heard.tocsr()
    heard.eliminate_zeros()
    return Stage(
        options=options,
        mesh=mesh,
        rays=rays,
        camera=camera,
        points=points,
        surfaces=surfaces,
        surface=surface,
        panel_of_face=diffuse.panels_of(mesh, surfaces.surface_of_face),
        is_matte=is_matte,
        hear=heard,
        gather=indirect.spread_over_neighbours(mesh, heard, site, options.indirect.smoothing_px),
        spread=binding.T.tocsr(),
        anchors=indirect.light_anchors(observed),
        softening=0.5 * mesh.radius,
        white=1.0 / (exposure * float(observed.scale.mean())),
        forced=forced_states(surfaces.names, options.force),
    )


def start(stage: Stage, observed: Observations) -> Fitted:
    """Nothing fitted yet."""
    num, num_surfaces = len(stage.points), stage.surfaces.num_surfaces
    return Fitted(
        albedo=np.full((num, 3), 0.5, np.float32),
        surface_albedo=np.full((num_surfaces, 3), 0.5),
        irradiance=np.zeros_like(observed.radiance),
        specular=None,
        normal=stage.points.normal,
        lobe_gain=np.ones(num, np.float32),
        lobes=((),) * num_surfaces,
        is_textured=np.ones(num_surfaces, bool),
        texture_shows=np.zeros(num_surfaces, bool),
    )


# ------------------------------------------------------------------------------- albedo and indirect light


def alternate(stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> Fitted:
    """Albedo and indirect light in turn (trap 3), the albedo's scale held by the shadow borders (eq. 1)."""
    options, num = stage.options, stage.surfaces.num_surfaces
    first = fitted.solution is None
    direct = direct_irradiance(stage, observed, mirrors, fitted)
    target = observed.radiance if fitted.specular is None else observed.radiance - fitted.specular
    weight = diffuse_weights(stage, observed, fitted)
    pairs = diffuse.border_pairs(observed, stage.points, stage.surface, stage.camera, options.diffuse)
    # An error in the dark shows more than the same error in the light: the indirect light is fitted as it is seen.
    calm = dark_weights(observed.radiance, stage.white)
    steps = options.num_alternations if first else max(2, options.num_alternations // 2)
    for step in range(steps):
        albedo, information = diffuse.pixel_albedo(
            observed, target, weight, direct, None if first and step == 0 else fitted.irradiance
        )
        information = information * _edge_trust(observed)
        mean = surface_medians(albedo, information, stage.surface, num)
        if first and step == 0:
            fitted = replace(fitted, is_textured=_neighbours_differ(stage, observed, albedo, num))
        if step == (steps - 1 if first else 0):
            # Not before the indirect light is known: what it does to a pixel looks like texture.
            fitted = _judge_texture(stage, observed, target, weight, direct, albedo, mean, fitted)
        owner, site_owner, num_owners = _owners(stage, fitted.is_textured)
        mean = surface_medians(albedo, information, owner, num_owners)
        # A pixel that was lit faintly, or only grazed, leans on its surface's mean.
        faint = MIN_INFORMATION * np.median(information[information > 0]) if (information > 0).any() else 1.0
        known = fitted.is_textured[stage.surface][:, None] * information**2 / (information**2 + faint**2)
        relative = (1.0 + known * (albedo / np.maximum(mean[owner], 1e-6) - 1.0)).astype(np.float32)
        border = diffuse.border_albedo(pairs, observed, target, direct, relative, owner, num_owners, options.diffuse)
        joint = _joint(stage, observed, target, weight, direct, relative, site_owner, num_owners)
        bound = diffuse.upper_bound(observed, target, weight, direct, relative, owner, num_owners)
        scale, _, words = diffuse.surface_scale(border, joint, mean, bound)
        # No pixel sends back more than it gets, unless the lamps' given powers make whole surfaces do so.
        albedo = np.minimum(relative * scale[owner], np.maximum(1.0, 2.0 * scale[owner])).astype(np.float32)
        sums = indirect.gather(stage.gather, weight * calm, albedo, target, direct)
        lit = fitted.design or indirect.choose_basis(
            sums, observed, indirect.site_positions(stage.mesh, stage.points, options.indirect.site), stage.anchors,
            stage.softening, options.indirect,
        )  # fmt: skip
        if fitted.design is None:
            lit, fitted.evidence["ambient", SCENE] = _judge_ambient(stage, observed, sums, lit)
        solution = indirect.solve_sites(sums, lit)
        at_sites = np.maximum(indirect.predict(solution, lit), 0.0)
        irradiance = np.stack([stage.spread @ at_sites[:, photo] for photo in range(at_sites.shape[1])])
        trust, blocked = trust_of(stage, observed, albedo, direct, irradiance, target)
        fitted = replace(
            fitted, albedo=albedo, surface_albedo=surface_medians(albedo, information, stage.surface, num),
            owner=owner, irradiance=irradiance, design=lit, solution=solution,
            border=border, joint=joint, trust=trust, blocked=blocked, scale_words=words,
        )  # fmt: skip
        weight = diffuse_weights(stage, observed, fitted)
    gain = indirect.explained_db(sums, lit)
    reason = "left-out photographs, leave-one-out of the linear fit"
    fitted.evidence["indirect", SCENE] = Evidence(gain, SCENE_NOISE_DB, reason)
    return fitted


def _judge_ambient(
    stage: Stage, observed: Observations, sums: indirect.SiteSums, lit: indirect.LightDesign
) -> tuple[indirect.LightDesign, Evidence]:
    """The functions of the light with or without the ambient's, and the evidence.

    A photograph with the lights off shows nothing else; unequal intensities alone must predict left-out ones better.
    """
    if not lit.has_ambient:
        return lit, Evidence(0.0, SCENE_NOISE_DB, NOT_TOLD)
    is_seen = bool(observed.is_dark.any())
    gain = ALL_OF_IT_DB if is_seen else indirect.ambient_gain_db(sums, lit)
    evidence = Evidence(gain, SCENE_NOISE_DB, "a lights-off photograph" if is_seen else "told apart by intensities")
    is_on = stage.forced.get(("ambient", SCENE), gain > SCENE_NOISE_DB)
    return lit if is_on else indirect.without_ambient(lit), evidence


def direct_irradiance(stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> np.ndarray:
    """Direct irradiance for normalised photographs: the lights' own, with detail, and what mirrors throw."""
    total = observed.form
    if fitted.normal is not stage.points.normal:
        total = total * cosine_change(observed, stage.points, fitted.normal)[..., None]
    if observed.thrown is None:
        return total
    total = np.broadcast_to(total, observed.radiance.shape).copy()
    for one, form in zip([m for m in mirrors if m.throws_light], observed.thrown, strict=True):
        total += form * one.reflectance.astype(np.float32)
    return total


def cosine_change(observed: Observations, points: ShadingPoints, normal: np.ndarray) -> np.ndarray:
    """The cosine with detail over that without, per photograph and point (of its strongest light)."""
    out = np.ones(observed.is_lit.shape, np.float32)
    for photo, each in enumerate(observed.lights):
        if each:
            to_light = strongest(each).incident(points.position)[0]
            # Clamped off zero: at grazing light the ratio means nothing, and nothing there is believed anyway.
            before = np.maximum(np.einsum("pi,pi->p", points.normal, to_light), 0.02)
            after = np.maximum(np.einsum("pi,pi->p", normal, to_light), 0.0)
            out[photo] = np.clip(after / before, 0.0, 20.0)
    return out


def strongest(lights: tuple):
    """The light of a photograph that matters most."""
    return max(lights, key=lambda one: float(one.power.sum()))


def diffuse_weights(stage: Stage, observed: Observations, fitted: Fitted) -> np.ndarray:
    """What the diffuse fits believe: clear of borders and outlines, off the highlights, robustly trusted."""
    weight = observed.weight * observed.is_safe * stage.is_matte
    weight = weight * _edge_trust(observed)[:, 0]
    if observed.thrown is not None and fitted.solution is None:
        # The mirrors' reflectance is not known yet, so what they throw is left out.
        weight = weight * ~(observed.thrown.max(axis=(0, 3)) > 0)
    if fitted.specular is None:
        weight = weight * ~observed.is_highlight
    else:
        # Where a lobe shines, its error is as large as it is: the fits hear less of it, smoothly.
        glare = fitted.specular.mean(axis=2) / np.maximum(0.25 * stage.white, 1e-12)
        weight = weight / (1.0 + glare) ** 2
    return (weight if fitted.trust is None else weight * fitted.trust).astype(np.float32)


def dark_weights(radiance: np.ndarray, white: float) -> np.ndarray:
    """Squared slope of a logarithm with a floor, at most 1: what a display shows of a difference."""
    gray, floor = np.maximum(radiance.mean(axis=2), 0.0), np.float32(0.05 * white)
    return ((floor / (gray + floor)) ** 2).astype(np.float32)


def _edge_trust(observed: Observations) -> np.ndarray:
    return np.where(observed.is_interior, 1.0, EDGE_TRUST)[:, None]


def surface_medians(albedo: np.ndarray, information: np.ndarray, surface: np.ndarray, num: int) -> np.ndarray:
    """The median albedo of each surface by what its points have to say.

    By information, since a point that the light grazes turns any indirect light into albedo. A surface that no light
    reaches has the mean of the others, and a half where none is reached.
    """
    out = np.full((num, 3), np.nan)
    for s in range(num):
        mine = np.flatnonzero(surface == s)
        if (information[mine] > 0).any():
            out[s] = [weighted_median(albedo[mine, c], information[mine, c].astype(np.float64)) for c in range(3)]
    is_known = np.isfinite(out[:, :1])
    others = out[is_known[:, 0]].mean(axis=0) if is_known.any() else np.full(3, 0.5)
    return np.where(is_known, out, others)


def _neighbours_differ(stage: Stage, observed: Observations, albedo: np.ndarray, num: int) -> np.ndarray:
    """A first look at texture, before any indirect light is known: by neighbours alone, which share theirs."""
    options = stage.options.texture
    measured = texture.difference_measure(
        observed, stage.points, stage.surface, albedo, stage.camera, num, options
    )
    return np.array([replace(m, spread=0.0).is_textured(options) for m in measured])


def _judge_texture(stage, observed, target, weight, direct, albedo, mean, fitted: Fitted) -> Fitted:
    """Which surfaces are textured (1.1.1), and which keep an albedo per pixel: those whose left-out photographs gain."""
    options = stage.options.texture
    glare = observed.is_highlight
    if fitted.specular is not None:
        glare = glare | (fitted.specular.mean(axis=2) > 0.05 * np.abs(target).mean(axis=2))
    measured = texture.difference_measure(
        replace(observed, radiance=target, is_highlight=glare),
        stage.points,
        stage.surface,
        albedo,
        stage.camera,
        len(mean),
        options,
    )
    # What a lobe leaves unexplained differs between neighbours as well: a gloss must differ by twice as much.
    strict = replace(options, min_difference=2 * options.min_difference)
    shows = np.array([m.is_textured(strict if fitted.lobes[s] else options) for s, m in enumerate(measured)])
    light = direct + fitted.irradiance
    gains = texture.left_out_gain(target, weight, light, stage.surface, len(mean), stage.white)
    evidence = dict(fitted.evidence)
    kept = np.zeros(len(mean), bool)
    for s, (gain, noise) in enumerate(gains):
        kept[s] = stage.forced.get(("texture", s), shows[s] or gain > max(options.min_gain_db, 2 * noise))
        reason = f"neighbours differ by {100 * measured[s].typical:.0f} %, spread {100 * measured[s].spread:.0f} %"
        evidence["texture", s] = Evidence(gain, noise, reason)
    return replace(fitted, is_textured=kept, texture_shows=shows, evidence=evidence)


def _joint(stage: Stage, observed, target, weight, direct, relative, site_owner, num_owners: int) -> Solution:
    """Reflectance and indirect light at once, for surfaces that no shadow border crosses."""
    basis = "linear" if len(observed.lights) >= 6 else "constant"
    nowhere = np.zeros((1, 3), np.float32)
    lit = indirect.design(basis, observed, nowhere, stage.anchors, stage.softening, stage.options.indirect)
    return diffuse.joint_albedo(
        stage.hear, site_owner, num_owners, relative, target, (weight * observed.is_facing).astype(np.float32), direct,
        lit.rows[0, :, 0],
    )  # fmt: skip


def _owners(stage: Stage, is_textured: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Whose albedo scale each point and each site has: its surface's, or its panel's where the surface is textured."""
    surface = stage.surfaces.surface_of_face
    of_face = np.where(is_textured[surface], stage.surfaces.num_surfaces + stage.panel_of_face, surface)
    ids, of_face = np.unique(of_face, return_inverse=True)
    of_face = of_face.ravel().astype(np.int32)
    site, owner = stage.options.indirect.site, of_face[stage.points.face]
    if site == "pixel":
        return owner, owner, len(ids)
    if site == "face":
        return owner, of_face, len(ids)
    at_vertex = np.zeros(len(stage.mesh.vertices), np.int32)
    at_vertex[stage.mesh.faces.ravel()] = np.repeat(of_face, 3)
    return owner, at_vertex, len(ids)


def trust_of(stage: Stage, observed, albedo, direct, irradiance, target) -> tuple[np.ndarray, tuple[int, ...]]:
    """Huber's weights by each point's own scatter and its predicted radiance (trap 13), and photographs that a blocker
    or a stray lamp spoils as a whole (trap 10): those count a tenth.
    """
    predicted = (albedo / np.pi * (direct + irradiance)).mean(axis=2)
    miss = target.mean(axis=2) - predicted
    used = observed.is_safe & (observed.weight > 0) & stage.is_matte
    own = 1.4826 * np.median(np.where(used, np.abs(miss), 0.0), axis=0)
    dark = 1e-6 * stage.white  # what is darker than this is zero; a constant would have a unit
    scale = np.maximum(own, 0.02 * predicted.mean(axis=0)) + dark
    trust = robust_weights(miss, scale[None], 2.0)
    lit = used & observed.is_lit & ~observed.is_highlight
    relative = [
        float(np.median(np.abs(miss[p, lit[p]]) / (predicted[p, lit[p]] + dark))) if lit[p].sum() > 50 else 0.0
        for p in range(len(miss))
    ]
    limit = max(0.25, 4.0 * float(np.median(relative)))
    blocked = tuple(int(p) for p in np.flatnonzero(np.array(relative) > limit))
    trust[list(blocked)] *= 0.1
    return trust.astype(np.float32), blocked if len(relative) >= 4 else ()


# ----------------------------------------------------------------------------------------------- gloss


def fit_gloss(stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> Fitted:
    """Which surfaces are glossy (1.1.2), and their lobes."""
    matte = (
        fitted.albedo / np.float32(np.pi) * (direct_irradiance(stage, observed, mirrors, fitted) + fitted.irradiance)
    )
    lobes, fits, evidence = [], [], dict(fitted.evidence)
    for s in range(stage.surfaces.num_surfaces):
        mine = np.flatnonzero((stage.surface == s) & stage.is_matte & observed.is_interior)
        if len(mine) < MIN_INTERIOR:  # a small surface is all outline: better its mixed pixels than none
            mine = np.flatnonzero((stage.surface == s) & stage.is_matte)
        samples = _lobe_samples(stage, observed, fitted, matte, mine)
        excess, scatter = specular.glossy_excess(samples, stage.white)
        found, fit, gain, options = (), None, 0.0, stage.options.specular
        if stage.forced.get(("lobes", s), excess > options.excess_sigmas or bool(fitted.lobes[s])):
            if ("lobes", s) in stage.forced:
                options = replace(options, min_gain_db=ANY_GAIN)
            found, fit, gain = specular.fit_lobes(samples, stage.white, _tangent(stage, s), options)
        reason = f"{excess:.1f} scatters brighter than predicted near the mirror direction"
        evidence["lobes", s] = Evidence(gain, stage.options.specular.min_gain_db, reason)
        lobes.append(found)
        fits.append(fit)
        log.debug("%s: %s (scatter %.4f), %d lobes", stage.surfaces.names[s], reason, scatter, len(found))
    fitted = replace(fitted, lobes=tuple(lobes), lobe_fits=tuple(fits), evidence=evidence)
    return replace(fitted, specular=specular_layers(stage, observed, fitted))


def specular_layers(stage: Stage, observed: Observations, fitted: Fitted) -> np.ndarray | None:
    """The lobes' radiance at every photograph and point; None when no surface has a lobe."""
    if not any(fitted.lobes):
        return None
    out = np.zeros_like(observed.radiance)
    points, change = stage.points, cosine_change(observed, stage.points, fitted.normal)
    for s, lobes in enumerate(fitted.lobes):
        mine = np.flatnonzero((stage.surface == s) & stage.is_matte) if lobes else ()
        for photo, each in enumerate(observed.lights if len(mine) else ()):
            for light in each:
                # The form sums a photograph's lights; one of several gets its part by its power.
                share = (light.power / observed.scale[photo]).astype(np.float32) if len(each) > 1 else np.float32(1)
                form = observed.form[photo, mine] * change[photo, mine, None] * share
                to_light = np.asarray(light.incident(points.position[mine])[0], np.float32)
                value = specular.specular_radiance(lobes, fitted.normal[mine], to_light, points.to_viewer[mine], form)
                out[photo, mine] += value * fitted.lobe_gain[mine, None]
    return out


def _lobe_samples(stage: Stage, observed: Observations, fitted: Fitted, matte, mine) -> specular.LobeSamples:
    """Samples of a surface under one light each, evenly over the angle to the mirror direction: the narrow peak is
    heard as much as the wide rest.
    """
    single = np.array([len(each) == 1 for each in observed.lights])
    usable = observed.is_lit & observed.is_safe & (observed.weight > 0) & single[:, None]
    photo, point = np.nonzero(usable[:, mine])
    point = mine[point]
    to_light = np.zeros((len(photo), 3))
    for p in np.unique(photo):
        here = photo == p
        to_light[here] = observed.lights[p][0].incident(stage.points.position[point[here]])[0]
    normal, viewer = (a[point].astype(np.float64) for a in (fitted.normal, stage.points.to_viewer))
    n_l, n_v = (np.einsum("si,si->s", normal, d) for d in (to_light, viewer))
    angle = np.arccos(np.clip(2 * n_l * n_v - np.einsum("si,si->s", to_light, viewer), -1, 1))
    bins = np.minimum((np.degrees(angle) / 3).astype(int), 39)
    num = min(stage.options.specular.num_samples, len(photo))
    chosen = np.zeros(0, int)
    if num:
        probability = 1.0 / np.bincount(bins, minlength=40)[bins]
        rng = np.random.default_rng(7)
        chosen = np.sort(rng.choice(len(photo), num, replace=False, p=probability / probability.sum()))
    photo, point = photo[chosen], point[chosen]
    before = np.maximum(np.einsum("si,si->s", stage.points.normal[point], to_light[chosen]), 0.02)
    change = np.clip(np.maximum(n_l[chosen], 0) / before, 0, 20)
    return specular.LobeSamples(
        photo=photo,
        normal=normal[chosen],
        to_light=to_light[chosen],
        to_viewer=viewer[chosen],
        form=observed.form[photo, point].astype(np.float64) * change[:, None],
        measured=observed.radiance[photo, point].astype(np.float64),
        explained=matte[photo, point].astype(np.float64),
        weight=np.ones(len(photo)),
    )


def _tangent(stage: Stage, s: int) -> np.ndarray:
    """The surface's longest direction: brushed metal is mostly brushed along it."""
    places = stage.points.position[stage.surface == s].astype(np.float64)
    if len(places) < 3:
        return np.array([1.0, 0.0, 0.0])
    _, vectors = np.linalg.eigh(np.cov((places - places.mean(axis=0)).T))
    along = vectors[:, -1]
    return along * np.sign(along[np.argmax(np.abs(along))])


# ---------------------------------------------------------------------------------------------- detail


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
        data = _detail_data(stage, observed, mirrors, fitted, mine)
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
    return replace(fitted, specular=specular_layers(stage, observed, fitted))


def _detail_data(stage: Stage, observed: Observations, mirrors, fitted: Fitted, mine: np.ndarray) -> detail.DetailData:
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
    if observed.thrown is not None:
        for one, form in zip([m for m in mirrors if m.throws_light], observed.thrown, strict=True):
            other = other + matte * form[:, mine] * one.reflectance.astype(np.float32)
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
    )


# --------------------------------------------------------------------------------------------- mirrors


def fit_mirrors(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted
) -> tuple[Mirror, ...]:
    """Each mirror's reflectance, from what it shows of the scene recovered so far."""
    if not mirrors:
        return mirrors
    from relight3d.forward import shade_points
    from relight3d.views import ViewOptions, build_view

    model = provisional_model(stage, observed, mirrors, fitted)
    view = build_view(stage.rays, model, stage.camera, ViewOptions(edge_samples=1, max_bounces=1))
    at = np.full(stage.camera.num_pixels, -1)
    at[view.points.pixel] = np.arange(len(view.points))
    found = []
    for one in mirrors:
        mine = np.flatnonzero((stage.surface == one.surface) & observed.is_interior)
        shown_at = at[stage.points.pixel[mine]]
        mine, shown_at = mine[shown_at >= 0], shown_at[shown_at >= 0]
        shown = np.empty((len(observed.lights), len(mine), 3), np.float32)
        for photo, each in enumerate(observed.lights):
            s = shade_points(stage.rays, model, view.take(shown_at), list(each))
            shown[photo] = (s.direct + s.specular + s.indirect) / observed.scale[photo]
        value, explained = mirror.fit_reflectance(shown, observed.radiance[:, mine], observed.weight[:, mine])
        gain = -10 * np.log10(max(1.0 - explained, 1e-6))
        reason = f"edges correlate by {one.score:.2f}; the reflection explains {100 * explained:.0f} % of what varies"
        fitted.evidence["mirror", one.surface] = Evidence(float(gain), 0.5, reason)
        found.append(replace(one, reflectance=value))
    return tuple(found)


def provisional_model(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted
) -> RelightModel:
    """The model so far, without background and residual."""
    assert fitted.solution is not None and fitted.design is not None, "the alternation comes first"
    found, health = indirect.indirect_of(
        fitted.solution, fitted.design, observed, stage.options.indirect.site, stage.anchors, stage.softening
    )
    found, health = indirect.fill_unseen(stage.mesh, found, health)
    num_lit = (observed.is_lit & (observed.weight > 0)).sum(axis=0).astype(np.int32)
    center = stage.mesh.center
    return RelightModel(
        camera=stage.camera,
        mesh=stage.mesh,
        surfaces=stage.surfaces,
        pixels=PixelMap(stage.points, stage.surface, fitted.albedo, fitted.normal, fitted.lobe_gain, num_lit),
        surface_albedo=fitted.surface_albedo,
        indirect=found,
        residual=None,
        background=None,
        lobes=fitted.lobes,
        mirrors=mirrors,
        lights=tuple(tuple(light.translated(center) for light in each) for each in observed.lights),
        exposure=1.0,
        decisions=(),
        health={"indirect": health},
    )

"""Albedo and indirect light, which each need the other: solved in turn."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64

from relight3d.effects import SCENE
from relight3d.maths.decibels import gain_db
from relight3d.maths.least_squares import Solution, Status, robust_weights
from relight3d.records import Mirror, Observations
from relight3d.recover import bounce, diffuse, indirect, shade, sites, texture, unseen
from relight3d.recover.rounds.light import calm_radiance, direct_irradiance
from relight3d.recover.rounds.state import SCENE_NOISE_DB, Evidence, Fitted, Stage, edge_trust
from relight3d.recover.rounds.texturing import judge_texture, looks_textured, surface_medians

MIN_INFORMATION = 0.05  # of the median: a pixel with so much is believed by half
LEAST_OF_SURFACE, LEAST_OF_SCENE = 0.05, 0.002  # of their medians: a panel is no darker
LEAST_OF_PANEL = 0.02  # of its mean: a pixel is no darker
SURELY_TOLD, HARDLY_TOLD = 0.9, 0.5  # by its own photographs: of 1
FEW_PHOTOGRAPHS = 4  # with fewer, left-out ones may say that the indirect light's fit is worse than none
NOT_TOLD = "nothing tells it from indirect light"
ALL_OF_IT_DB = 100.0  # the gain of an effect without which there is nothing


@dataclass(frozen=True, eq=False)
class _Known:
    """What one alternation is solved from, and does not change."""

    observed: Observations
    target: np.ndarray  # photo x point x 3: radiance less lobes
    direct: np.ndarray  # photo x point x color: direct irradiance
    smooth: np.ndarray  # the same by the mesh's normals
    pairs: np.ndarray  # across shadow borders
    calm: np.ndarray  # photo x point: how much a display shows of an error there


def alternate(stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> Fitted:
    """Albedo and indirect light in turn (trap 3), the albedo's scale held by the shadow borders (eq. 1)."""
    options = stage.options
    direct = smooth = direct_irradiance(stage, observed, mirrors, fitted)
    if fitted.normal is not stage.points.normal:
        smooth = direct_irradiance(stage, observed, mirrors, replace(fitted, normal=stage.points.normal))
    known = _Known(
        observed,
        observed.radiance if fitted.specular is None else observed.radiance - fitted.specular,
        direct,
        smooth,
        diffuse.border_pairs(observed, stage.points, stage.surface, stage.camera, options.diffuse),
        # An error in the dark shows more than the same error in the light: the indirect light is fitted as it is seen.
        dark_weights(stage, observed),
    )
    first = fitted.solution is None
    steps = options.num_alternations if first else max(2, options.num_alternations // 2)
    for step in range(steps):
        # Texture is not judged before the indirect light is known: what that does to a pixel looks like texture.
        is_last = step == steps - 1
        judges = is_last if first else step == 0
        weight = diffuse_weights(stage, observed, fitted)
        fitted = _fit_albedo(stage, known, weight, fitted, judges, is_last)
        fitted = _fit_indirect(stage, known, weight, mirrors, fitted, is_last)
    return fitted


def _fit_albedo(
    stage: Stage, known: _Known, weight: np.ndarray, fitted: Fitted, judges_texture: bool, is_last: bool
) -> Fitted:
    """The albedo of every point: its texture from the photographs, times its surface's scale from the borders."""
    observed, target, direct, options = known.observed, known.target, known.direct, stage.options.diffuse
    num, is_first = stage.surfaces.num_surfaces, fitted.solution is None
    albedo, information = diffuse.pixel_albedo(
        observed, target, weight, direct, None if is_first else fitted.irradiance
    )
    if stage.options.texture.method == "reciprocal":
        albedo = texture.by_reciprocals(target, weight, direct, stage.points.face, albedo)
    # The weights trust an outline little, so that it decides nothing; its own albedo it may have all the same.
    of_its_own, information = information / edge_trust(observed), information * edge_trust(observed)
    if is_first:
        fitted = replace(fitted, is_textured=looks_textured(stage, observed, direct, albedo, num))
    of_surface = surface_medians(albedo, information, stage.surface, num)
    if judges_texture:
        fitted = judge_texture(stage, observed, target, weight, direct, albedo, of_surface, fitted)
    owner, site_owner, num_owners = _owners(stage, fitted.is_textured)
    mean = surface_medians(albedo, information, owner, num_owners)
    surface_of_owner = np.zeros(num_owners, np.int32)
    surface_of_owner[owner] = stage.surface
    mean = np.maximum(mean, _least(of_surface)[surface_of_owner])
    # A pixel that was lit faintly, or only grazed, leans on its surface's mean, in the end on what is around it.
    faint = MIN_INFORMATION * np.median(information[information > 0]) if (information > 0).any() else 1.0
    told = of_its_own**2 / (of_its_own**2 + faint**2)
    is_textured = fitted.is_textured[stage.surface]
    away = np.where(is_textured[:, None], albedo / np.maximum(mean[owner], 1e-6) - 1.0, 0.0)
    relative = (1.0 + told * away).astype(np.float32)
    piece, least_told = np.where(is_textured, owner, -1), told.min(axis=1)
    if is_last:
        place = unseen.places(stage.mesh, stage.points.position, stage.points.normal)
        is_told = observed.is_interior & (least_told > SURELY_TOLD)
        around = unseen.continued(place, away, piece, is_told)
        asked = least_told < HARDLY_TOLD
        shown = shade.texture_in_shade(observed, target, direct, stage.points, piece, asked, stage.near, stage.white)
        around = np.where(shown.is_found[:, None], shown.away, around)
        relative[~is_told] += ((1.0 - told) * around)[~is_told].astype(np.float32)
    relative = np.maximum(relative, np.float32(LEAST_OF_PANEL))
    # Detail takes up what is missed of a pixel's light as a tilt: over many pairs that is no relief but a bias.
    border = diffuse.border_albedo(known.pairs, observed, target, known.smooth, relative, owner, num_owners, options)
    # Light that other surfaces send is as known as the direct, once it is computed; only the rest must be told apart.
    light = direct if fitted.sent is None else direct + fitted.sent
    joint = _joint(stage, observed, target, weight, light, relative, site_owner, num_owners)
    bound = diffuse.upper_bound(observed, target, weight, light, relative, owner, num_owners)
    scale, _, words = diffuse.surface_scale(border, joint, mean, bound)
    # Of a panel that hardly any light falls on, its surface's other panels say more than it does.
    by_itself = np.minimum(_medians_by_owner(least_told, owner, num_owners) / HARDLY_TOLD, 1.0)
    by_itself = np.maximum(by_itself, _shares_of_surface(information.mean(axis=1), owner, surface_of_owner))
    by_itself = np.where(border.status == Status.OK, 1.0, by_itself)[:, None]
    scale = scale**by_itself * of_surface[surface_of_owner] ** (1.0 - by_itself)
    of_surface = surface_medians(relative * scale[owner], information, stage.surface, num)
    scale = np.maximum(scale, _least(of_surface)[surface_of_owner])
    # No pixel sends back more than it gets, unless the lamps' given powers make whole surfaces do so.
    albedo = np.minimum(relative * scale[owner], np.maximum(1.0, 2.0 * scale[owner])).astype(np.float32)
    return replace(
        fitted, albedo=albedo, surface_albedo=surface_medians(albedo, information, stage.surface, num), owner=owner,
        border=border, joint=joint, scale_words=words,
    )  # fmt: skip


def _medians_by_owner(values: np.ndarray, owner: np.ndarray, num_owners: int) -> Float64[np.ndarray, " owner"]:
    """The median of what each owner's points have; 0 for an owner without."""
    ordered, count = values[np.lexsort((values, owner))], np.bincount(owner, minlength=num_owners)
    middle = np.minimum(np.cumsum(count) - count + count // 2, len(values) - 1)
    return np.where(count > 0, ordered[middle], 0.0)


def _shares_of_surface(
    information: np.ndarray, owner: np.ndarray, surface_of_owner: np.ndarray
) -> Float64[np.ndarray, " owner"]:
    """How much of the information about its surface each owner has; 1 for the only one."""
    mine = np.bincount(owner, information, len(surface_of_owner))
    whole = np.bincount(surface_of_owner, mine)[surface_of_owner]
    return np.where(whole > 0, mine / np.maximum(whole, 1e-30), 1.0)


def _least(of_surface: Float64[np.ndarray, "surface 3"]) -> Float64[np.ndarray, "surface 3"]:
    """The albedo that each panel of a surface has at least: one of which photographs tell next to nothing, or that lobes
    explain whole, would else have none, and its indirect light and its texture no end.
    """
    return np.maximum(LEAST_OF_SURFACE * of_surface, LEAST_OF_SCENE * of_surface.max(axis=0))


def _fit_indirect(
    stage: Stage, known: _Known, weight: np.ndarray, mirrors: tuple[Mirror, ...], fitted: Fitted, is_last: bool
) -> Fitted:
    """The indirect light of every site: what surfaces send one another, as far as left-out photographs are predicted
    better with it, and beside it what the photographs add.
    """
    observed, options, evidence = known.observed, stage.options.indirect, dict(fitted.evidence)
    places = sites.site_positions(stage.mesh, stage.points, options.site)
    whole = indirect.gather(stage.gather, weight * known.calm, fitted.albedo, known.target, known.direct)
    bounced, computed, left, lit = _split(stage, observed, mirrors, fitted, places, whole)
    if fitted.design is None:
        lit, evidence["ambient", SCENE] = _judge_ambient(stage, observed, left, lit)
    solution = indirect.solve_sites(left, lit, diagnose=is_last)
    is_few = len(observed.lights) < FEW_PHOTOGRAPHS
    if is_few and bounced is not None and indirect.left_out_error(left, lit) > indirect.unexplained(left):
        # Too little is photographed to say what the surroundings add: what is computed asks for no photograph.
        solution = replace(solution, value=np.zeros_like(solution.value))
    at_sites = np.maximum(indirect.predict(solution, lit) + computed, 0.0).astype(np.float32)
    irradiance = _at_points(stage, at_sites)
    if is_last:
        evidence["indirect", SCENE] = _indirect_evidence(whole, left, lit)
    trust, found = trust_of(stage, observed, fitted.albedo, known.direct, irradiance, known.target)
    blocked = tuple(sorted({*fitted.blocked, *found}))  # once left out, a photograph disagrees with nothing
    return replace(
        fitted, irradiance=irradiance, design=lit, solution=solution, bounced=bounced, trust=trust, blocked=blocked,
        evidence=evidence, sent=None if bounced is None else _at_points(stage, np.asarray(computed, np.float32)),
    )  # fmt: skip


def _split(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted, places: np.ndarray, whole
) -> tuple[bounce.Bounced | None, np.ndarray, indirect.SiteSums, indirect.LightDesign]:
    """What surfaces send one another, at the photographs too; what it leaves to be fitted; and the functions of that.

    The first time, left-out photographs choose the functions of both, and whether anything is computed at all.
    """
    options = stage.options
    lit, least = fitted.design, np.inf
    names = () if fitted.bounced is None else (fitted.bounced.basis,)
    if lit is None:
        lit, least = indirect.choose_design(whole, observed, places, stage.anchors, stage.softening, options.indirect)
        least *= 10 ** (-options.bounce.min_gain_db / 10)
        names = options.bounce.bases if options.indirect.basis == "auto" else (options.indirect.basis,)
    best = None, np.zeros(1), whole, lit
    if stage.transport is None or not names:
        return best
    arrived = bounce.bounced(stage.transport, fitted.albedo, fitted.surface_albedo, mirrors)
    for name in names:
        bounced = bounce.as_functions(stage.transport, arrived, name, stage.anchors, stage.softening)
        rows = indirect.light_rows(name, observed, places, stage.anchors, stage.softening)
        computed = bounce.at_photographs(bounced, rows)
        left = indirect.without(whole, computed)
        if fitted.design is None:
            lit, error = indirect.choose_design(
                left, observed, places, stage.anchors, stage.softening, options.indirect
            )
            if error > least:
                continue
            least = error
        best = bounced, computed, left, lit
    return best


def _at_points(stage: Stage, at_sites: np.ndarray) -> np.ndarray:
    """Sites' irradiance (site x photo x 3) blended at the points (photo x point x 3)."""
    return np.stack([stage.spread @ at_sites[:, photo] for photo in range(at_sites.shape[1])])


def _indirect_evidence(whole: indirect.SiteSums, left: indirect.SiteSums, lit: indirect.LightDesign) -> Evidence:
    """What left-out photographs gain by indirect light, and how much of it by what is computed between surfaces."""
    none, error = indirect.unexplained(whole), indirect.left_out_error(left, lit)
    if left is not whole:
        error = min(error, indirect.unexplained(left))
    reason = "left-out photographs, leave-one-out of the linear fit"
    if left is not whole:
        reason += f"; {gain_db(indirect.left_out_error(whole, lit), error):.1f} dB by light from surface to surface"
    return Evidence(gain_db(none, error), SCENE_NOISE_DB, reason)


def _judge_ambient(
    stage: Stage, observed: Observations, sums: indirect.SiteSums, lit: indirect.LightDesign
) -> tuple[indirect.LightDesign, Evidence]:
    """The functions of the light with or without the ambient's, and the evidence.

    A photograph with the lights off shows nothing else; unequal intensities alone must predict left-out ones better.
    """
    if not lit.tells_ambient:
        return lit, Evidence(0.0, SCENE_NOISE_DB, NOT_TOLD)
    is_seen = bool(observed.is_dark.any())
    gain = ALL_OF_IT_DB if is_seen else indirect.ambient_gain_db(sums, lit)
    reason = "a lights-off photograph" if is_seen else "told apart by intensities"
    if lit.shared_ambient is not None:
        reason += ", in one share of all indirect light"
    is_on = stage.forced.get(("ambient", SCENE), gain > SCENE_NOISE_DB)
    return lit if is_on else indirect.without_ambient(lit), Evidence(gain, SCENE_NOISE_DB, reason)


def diffuse_weights(stage: Stage, observed: Observations, fitted: Fitted) -> np.ndarray:
    """What the diffuse fits believe: clear of borders and outlines, off the highlights, robustly trusted."""
    weight = observed.weight * observed.is_safe * stage.is_matte
    weight = weight * edge_trust(observed)[:, 0]
    if observed.thrown is not None and fitted.solution is None:
        # The mirrors' reflectance is not known yet, so what they throw is left out.
        weight = weight * ~observed.is_thrown
    if fitted.specular is None:
        weight = weight * ~observed.is_highlight
        weight = weight if observed.is_thrown_highlight is None else weight * ~observed.is_thrown_highlight
    else:
        # Where a lobe shines, its error is as large as it is: the fits hear less of it, smoothly.
        glare = fitted.specular.mean(axis=2) / np.maximum(0.25 * stage.white, 1e-12)
        weight = weight / (1.0 + glare) ** 2
    return (weight if fitted.trust is None else weight * fitted.trust).astype(np.float32)


def dark_weights(stage: Stage, observed: Observations) -> Float32[np.ndarray, "photo point"]:
    """Squared slope of a logarithm with a floor, at most 1: what a display shows of a difference."""
    gray, floor = calm_radiance(stage, observed).mean(axis=2), np.float32(0.05 * stage.white)
    return (floor / (gray + floor)) ** 2


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
    owner, of_site = of_face[stage.points.face], sites.of_faces(stage.mesh, of_face, stage.options.indirect.site)
    return owner, owner if of_site is None else of_site, len(ids)


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

"""The model put together from what the rounds fitted: background, residual, health, and the evidence as decisions."""

import logging
from dataclasses import asdict, replace

import numpy as np

from relight3d.maths.least_squares import Solution, Status
from relight3d.records import (
    Background,
    Decision,
    Health,
    Mirror,
    Observations,
    RelightModel,
)
from relight3d.recover import indirect, mirror, residual, specular
from relight3d.recover.rounds import Evidence, Fitted, Stage, provisional_model
from relight3d.shading import light_strength, reflected

log = logging.getLogger("relight3d")


def assemble(
    stage: Stage,
    observed: Observations,
    mirrors: tuple[Mirror, ...],
    fitted: Fitted,
    tests: list[mirror.EdgeTest],
    exposure: float,
) -> RelightModel:
    """The model with its kinds, health, warnings and decisions."""
    model = provisional_model(stage, observed, mirrors, fitted)
    health = {
        **model.health,
        "albedo": _albedo_health(stage, fitted),
        "lobes": _lobe_health(stage, fitted),
        "texture": _pixel_health(stage, observed),
    }
    return replace(
        model,
        surfaces=replace(stage.surfaces, kinds=_kinds(stage, mirrors, fitted), evidence=_numbers(stage, fitted, tests)),
        exposure=exposure,
        health=health,
        warnings=_warnings(stage, observed, fitted),
        decisions=_decisions(stage, observed, mirrors, fitted),
        settings={"recover": asdict(stage.options)},
    )


def _kinds(stage: Stage, mirrors: tuple[Mirror, ...], fitted: Fitted) -> tuple[tuple[str, ...], ...]:
    reflecting = {one.surface for one in mirrors}
    kinds = []
    for s in range(stage.surfaces.num_surfaces):
        words = ["textured"] if fitted.texture_shows[s] else []
        words += ["glossy"] if fitted.lobes[s] else []
        kinds.append(("mirror",) if s in reflecting else tuple(words) or ("diffuse",))
    return tuple(kinds)


def _numbers(stage: Stage, fitted: Fitted, tests: list[mirror.EdgeTest]) -> tuple[dict[str, float], ...]:
    numbers: list[dict[str, float]] = [{} for _ in range(stage.surfaces.num_surfaces)]
    for test in tests:
        numbers[test.surface] |= {"edge_score": test.score, "edge_chance": test.chance}
    for (effect, s), evidence in fitted.evidence.items():
        if s >= 0:
            numbers[s][f"{effect}_gain_db"] = evidence.gain_db
    return tuple(numbers)


def _albedo_health(stage: Stage, fitted: Fitted) -> Health:
    """OK by shadow borders or jointly; FALLBACK where only the prior is left: indirect light small against direct."""
    border, joint, owner = fitted.border, fitted.joint, fitted.owner
    assert border is not None and joint is not None and owner is not None
    by_border, by_joint = border.status == Status.OK, joint.status == Status.OK
    status = np.where(by_border | by_joint, Status.OK, Status.FALLBACK).astype(np.int8)
    # A surface in several panels is as weak as its weakest one that is seen.
    num = stage.surfaces.num_surfaces
    worst = np.full(num, Status.NO_DATA, np.int8)
    rank, condition, residual_ = np.zeros(num, np.int32), np.full(num, np.inf), np.zeros(num)
    for s in range(num):
        seen = np.unique(owner[stage.surface == s])
        if len(seen):
            worst[s] = status[seen].max()
            rank[s] = np.where(by_border, border.rank, joint.rank)[seen].min()
            condition[s] = np.where(by_border, border.condition, joint.condition)[seen].max()
            residual_[s] = border.residual[seen].max()
    return Health(
        "surface",
        worst,
        rank,
        condition.astype(np.float32),
        residual_.astype(np.float32),
        fallback="the albedo that the photographs have without indirect light",
    )


def _lobe_health(stage: Stage, fitted: Fitted) -> Health:
    rows = [specular.status_of(fit) for fit in fitted.lobe_fits] or [
        specular.status_of(None) for _ in range(stage.surfaces.num_surfaces)
    ]
    return Health(
        "surface",
        np.array([r[0] for r in rows], np.int8),
        np.array([r[1] for r in rows], np.int32),
        np.array([r[2] for r in rows], np.float32),
        np.zeros(len(rows), np.float32),
        fallback="no lobe",
    )


def _pixel_health(stage: Stage, observed: Observations) -> Health:
    lit = (observed.is_lit & (observed.weight > 0)).sum(axis=0)
    return Health(
        "pixel",
        np.where(lit > 0, Status.OK, Status.NO_DATA).astype(np.int8),
        np.minimum(lit, 1).astype(np.int32),
        np.where(lit > 0, 1.0, np.inf).astype(np.float32),
        np.zeros(len(lit), np.float32),
        fallback="the surface's mean albedo",
    )


def _warnings(stage: Stage, observed: Observations, fitted: Fitted) -> tuple[str, ...]:
    lines = []
    if fitted.blocked:
        which = ", ".join(str(p) for p in fitted.blocked)
        lines.append(
            f"training photographs {which} disagree with all others: something unmodelled blocks or adds light"
        )
    guessed = np.array([word == "prior" for word in fitted.scale_words], bool)[fitted.owner] & stage.is_matte
    counts = np.bincount(stage.surface[guessed], minlength=stage.surfaces.num_surfaces)
    whole = np.bincount(stage.surface, minlength=stage.surfaces.num_surfaces)
    weak = [name for s, name in enumerate(stage.surfaces.names) if counts[s] > 0.5 * whole[s] > 0]
    if weak:
        lines.append(f"no shadow border crosses {', '.join(weak)}: albedo and indirect light are told apart by a prior")
    if fitted.design is not None and not fitted.design.has_ambient:
        lines.append(
            "ambient light is not told from indirect light (no lights-off frame): it is counted with the lights"
        )
    return tuple(lines)


def _decisions(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted
) -> tuple[Decision, ...]:
    """The evidence as lines of the plan: one per effect and surface, and those of the whole scene."""
    lines = []
    cast = observed.is_facing & ~observed.is_lit & (observed.weight > 0) & stage.is_matte
    share = float(cast.mean())
    lines.append(
        Decision("shadows", -1, share > 0, 10 * np.log10(1 + 100 * share), 0.0, f"{100 * share:.1f} % shadowed")
    )
    scene = fitted.evidence.get(("indirect", -1), Evidence(0.0, 0.1, "not fitted"))
    lines.append(Decision("indirect", -1, scene.gain_db > scene.noise_db, scene.gain_db, scene.noise_db, scene.reason))
    has_ambient = fitted.design is not None and fitted.design.has_ambient
    lines.append(Decision("ambient", -1, has_ambient, 0.0, 0.0, "told apart by intensities or a lights-off frame"))
    on = {
        "texture": lambda s: bool(fitted.is_textured[s]),
        "lobes": lambda s: bool(fitted.lobes[s]),
        "detail": lambda s: _has_detail(stage, fitted, s),
        "mirror": lambda s: any(one.surface == s for one in mirrors),
    }
    for (effect, s), evidence in sorted(fitted.evidence.items(), key=lambda item: (item[0][1], item[0][0])):
        if s >= 0:
            is_on = on[effect](s)
            lines.append(Decision(effect, s, is_on, evidence.gain_db, evidence.noise_db, evidence.reason))
    return tuple(lines)


def _has_detail(stage: Stage, fitted: Fitted, s: int) -> bool:
    mine = stage.surface == s
    tilted = (fitted.normal[mine] != stage.points.normal[mine]).any()
    return bool(tilted or (fitted.lobe_gain[mine] != 1).any())


# ------------------------------------------------------------------------------ background and residual


def with_residual(stage: Stage, observed: Observations, model: RelightModel) -> RelightModel:
    """The surroundings seen in mirrors, then the interpolated misfit, each as far as left-out photographs gain."""
    from relight3d.views import build_view

    index = np.full(stage.camera.num_pixels, -1)
    index[stage.points.pixel] = np.arange(len(stage.points))
    view = build_view(stage.rays, model, stage.camera)
    if len(view.miss_pixel):
        rows = index[np.unique(view.miss_pixel)]
        model = replace(model, background=_background(stage, observed, model, rows[rows >= 0]))
        view = build_view(stage.rays, model, stage.camera)
    options, bright = stage.options.residual, ~observed.is_dark
    if options.max_modes == 0 or bright.sum() < 3:
        return model
    misfit, seen = _misfit(stage, observed, model, view)
    misfit, seen = misfit[bright], seen[bright]
    # A hot pixel, a million times white, would be all that the modes are made of: it is told from its neighbours.
    is_sane = np.abs(misfit).max(axis=2) < 8 * stage.white
    misfit = np.where(is_sane[..., None], misfit, 0.0).astype(np.float32)
    anchors = np.array([_mean_direction(each) for each in observed.lights if each])
    known = (observed.weight > 0)[bright] & is_sane
    slope = 1.0 / (np.maximum(observed.radiance[bright], 0) + np.float32(0.1 * stage.white)) ** 2
    # What is carried over is for a light of strength 1, as the frames multiply it again by a lamp's own.
    strength = np.array([_mean_strength(each, stage.softening) for each in observed.lights if each], np.float32)
    misfit, slope = misfit / strength[:, None, None], slope * strength[:, None, None] ** 2
    # On an outline a pixel is seldom wholly lit or dark: there the larger part decides.
    sure = np.where(observed.is_interior, 0.999, 0.6).astype(np.float32)
    states = {"lit": known & (seen >= sure), "dark": known & (seen <= 1 - sure)}
    fits = {name: residual.choose_kernel(misfit, k, slope, anchors, options) for name, k in states.items()}
    gain = max(fit.gain_db for fit in fits.values())
    is_on = gain > options.min_gain_db
    reason = ", ".join(f"{n} {f.gain_db:.1f} dB over {np.degrees(f.length_rad):.0f} degrees" for n, f in fits.items())
    line = Decision("residual", -1, is_on, gain, options.min_gain_db, reason)
    model = replace(model, decisions=(*model.decisions, line))
    if not is_on:
        return model
    return replace(model, residual=residual.fit_residual(misfit, states, anchors, fits, options))


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


def _misfit(stage: Stage, observed: Observations, model: RelightModel, view) -> tuple[np.ndarray, np.ndarray]:
    """Measured less modelled radiance of every pixel and photograph, and how far its light is seen there."""
    from relight3d.forward import gather_pixels, shade_points

    num = stage.camera.num_pixels
    counts = np.maximum(np.bincount(view.points.pixel, minlength=num), 1)
    misfit = np.empty_like(observed.radiance)
    seen = np.zeros(observed.is_lit.shape, np.float32)
    for photo, each in enumerate(observed.lights):
        shaded = shade_points(stage.rays, model, view, list(each))
        picture = sum(gather_pixels(model, view, list(each), shaded))[stage.points.pixel]
        misfit[photo] = observed.radiance[photo] - picture / observed.scale[photo]
        if each:
            share = np.bincount(view.points.pixel, shaded.seen.max(axis=0), num) / counts
            seen[photo] = share[stage.points.pixel]
    return misfit, seen


def _background(stage: Stage, observed: Observations, model: RelightModel, rows: np.ndarray) -> Background:
    """Low-order functions of the light, per pixel whose mirror shows the surroundings."""
    assert model.indirect is not None
    nowhere = np.zeros((1, 3), np.float32)
    lit = indirect.design(
        model.indirect.basis, observed, nowhere, stage.anchors, stage.softening, stage.options.indirect
    )
    weight = np.repeat(observed.weight[:, rows].T[:, :, None], 3, axis=2).astype(np.float64)
    sums = indirect.SiteSums(weight, weight * observed.radiance[:, rows].transpose(1, 0, 2))
    solution = indirect.solve_sites(sums, lit)
    record, _ = indirect.indirect_of(solution, lit, observed, "pixel", stage.anchors, stage.softening)
    points = stage.points.take(rows)
    return Background(points.pixel, reflected(points).astype(np.float32), record.coefficients, record.ambient)


def summary(model: RelightModel) -> str:
    """One line that counts the solves by status."""
    parts = []
    for name, health in model.health.items():
        counts = [f"{int((health.status == s).sum())} {s.name.lower()}" for s in Status if (health.status == s).any()]
        parts.append(f"{name}: {', '.join(counts)} ({health.site}s)")
    return "; ".join(parts)


__all__ = ["Solution", "assemble", "provisional_model", "summary", "with_residual"]

"""The model put together from what the rounds fitted, with kinds, health, warnings and the evidence as decisions."""

from dataclasses import asdict, replace

import numpy as np

from relight3d.effects import SCENE
from relight3d.maths.least_squares import Status
from relight3d.records import Health, Mirror, Observations, RelightModel
from relight3d.recover import mirror, specular
from relight3d.recover.decisions import called_for, decide
from relight3d.recover.rounds.alternation import NOT_TOLD
from relight3d.recover.rounds.reflections import provisional_model
from relight3d.recover.rounds.state import Fitted, Stage
from relight3d.recover.visible import without_unseen


def assemble(
    stage: Stage,
    observed: Observations,
    mirrors: tuple[Mirror, ...],
    fitted: Fitted,
    tests: list[mirror.EdgeTest],
    exposure: float,
) -> RelightModel:
    """The model with its kinds, health, warnings and decisions; effects that nobody would see are left out."""
    fitted = without_unseen(stage, observed, mirrors, fitted)
    model = provisional_model(stage, observed, mirrors, fitted)
    decisions = decide(stage, observed, mirrors, fitted, model.indirect)
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
        decisions=decisions,
        indirect=called_for(model.indirect, decisions),
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
    lost = [f"{i} ({100 * share:.0f} %)" for i, share in enumerate(observed.blocked_share) if share > 0]
    if lost:
        lines.append(
            f"training photographs {', '.join(lost)} lie partly in a shadow that the mesh does not throw: left out"
        )
    guessed = np.array([word == "prior" for word in fitted.scale_words], bool)[fitted.owner] & stage.is_matte
    counts = np.bincount(stage.surface[guessed], minlength=stage.surfaces.num_surfaces)
    whole = np.bincount(stage.surface, minlength=stage.surfaces.num_surfaces)
    weak = [name for s, name in enumerate(stage.surfaces.names) if counts[s] > 0.5 * whole[s] > 0]
    if weak:
        lines.append(f"no shadow border crosses {', '.join(weak)}: albedo and indirect light are told apart by a prior")
    if fitted.evidence["ambient", SCENE].reason == NOT_TOLD:
        lines.append(
            "ambient light is not told from indirect light (no lights-off frame): it is counted with the lights"
        )
    return tuple(lines)


def summary(model: RelightModel) -> str:
    """One line that counts the solves by status."""
    parts = []
    for name, health in model.health.items():
        counts = [f"{int((health.status == s).sum())} {s.name.lower()}" for s in Status if (health.status == s).any()]
        parts.append(f"{name}: {', '.join(counts)} ({health.site}s)")
    return "; ".join(parts)

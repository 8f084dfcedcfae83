"""The evidence as decisions, the lines of the plan: which effects of the scene and of each surface exist, and why."""

from dataclasses import replace

import numpy as np

from relight3d.effects import SCENE
from relight3d.records import Decision, Indirect, Mirror, Observations
from relight3d.recover.rounds.state import SCENE_NOISE_DB, Evidence, Fitted, Stage
from relight3d.recover.visible import displayed, needed_db, visible_gain_db


def decide(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted, found: Indirect | None
) -> tuple[Decision, ...]:
    """One line per effect and surface, and those of the whole scene; `found` is the indirect light as fitted."""
    lines = []
    cast = observed.is_facing & ~observed.is_lit & (observed.weight > 0) & stage.is_matte
    share = float(cast.mean())
    lines.append(
        Decision("shadows", -1, share > 0, 10 * np.log10(1 + 100 * share), 0.0, f"{100 * share:.1f} % shadowed")
    )
    scene = fitted.evidence.get(("indirect", SCENE), Evidence(0.0, SCENE_NOISE_DB, "not fitted"))
    lines.append(decision(stage, "indirect", SCENE, scene, scene.gain_db > scene.noise_db))
    ambient = _ambient_evidence(stage, observed, fitted, found)
    lines.append(decision(stage, "ambient", SCENE, ambient, ambient.gain_db > ambient.noise_db))
    on = {
        "texture": lambda s: bool(fitted.is_textured[s]),
        "lobes": lambda s: bool(fitted.lobes[s]),
        "detail": lambda s: _has_detail(stage, fitted, s),
        "mirror": lambda s: any(one.surface == s for one in mirrors),
    }
    for (effect, s), evidence in sorted(fitted.evidence.items(), key=lambda item: (item[0][1], item[0][0])):
        if s >= 0:
            evidence = replace(evidence, noise_db=needed_db(stage, effect, evidence))
            lines.append(decision(stage, effect, s, evidence, on[effect](s)))
    return tuple(lines)


def decision(stage: Stage, effect: str, surface: int, evidence: Evidence, is_on: bool) -> Decision:
    """A line of the plan; what a person forced is as they said, and says so."""
    reason = evidence.reason
    if (effect, surface) in stage.forced:
        is_on = stage.forced[effect, surface]
        reason = f"forced {'on' if is_on else 'off'}; {reason}"
    return Decision(effect, surface, is_on, evidence.gain_db, evidence.noise_db, reason)


def _ambient_evidence(stage: Stage, observed: Observations, fitted: Fitted, found: Indirect | None) -> Evidence:
    """What a photograph with the lights off would be missed by without ambient light, in what a display shows."""
    evidence = fitted.evidence["ambient", SCENE]
    if found is None or not found.ambient.any():
        return evidence
    irradiance = (stage.spread @ found.ambient) / observed.scale.mean(axis=0)
    shown = displayed(fitted.albedo / np.pi * irradiance, stage.white)[stage.is_matte]
    square = float(np.mean(shown.astype(np.float64) ** 2)) if len(shown) else 0.0
    reason = f"{evidence.reason}; {255 * square**0.5:.1f} of 255 with the lights off"
    return replace(evidence, gain_db=visible_gain_db(evidence.gain_db, square), reason=reason)


def called_for(found: Indirect | None, decisions: tuple[Decision, ...]) -> Indirect | None:
    """The indirect and ambient light as far as they are called for: without either nothing is left to evaluate."""
    is_on = {d.effect: d.is_on for d in decisions if d.surface == SCENE}
    if found is None or not (is_on["indirect"] or is_on["ambient"]):
        return None
    if not is_on["ambient"] and found.ambient.any():
        found = replace(found, ambient=np.zeros_like(found.ambient))
    if not is_on["indirect"]:
        found = replace(found, basis="constant", coefficients=np.zeros((len(found.ambient), 1, 3), np.float32))
    return found


def _has_detail(stage: Stage, fitted: Fitted, s: int) -> bool:
    mine = stage.surface == s
    tilted = (fitted.normal[mine] != stage.points.normal[mine]).any()
    return bool(tilted or (fitted.lobe_gain[mine] != 1).any())

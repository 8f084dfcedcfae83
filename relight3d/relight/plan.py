"""What a scene calls for: each effect on or off, the evidence behind it, and what it costs in a frame.

Recovery decides by the photographs that it leaves out (`RelightModel.decisions`); the lights and the camera of a frame
decide the rest: a light that no point faces casts no ray, a mirror out of view is not followed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from relight3d.effects import SCENE
from relight3d.lights import Light
from relight3d.records import RelightModel, Stats
from relight3d.relight.calibrate import nudged
from relight3d.relight.options import RelightOptions
from relight3d.relight.plan_lines import Plan, PlanLine, evidence_lines, name_of
from relight3d.views import View

if TYPE_CHECKING:
    from relight3d.relight.relighter import Relighter

# Where a frame's milliseconds and rays are counted, by effect; borders are timed with the shadows.
CLOCKS = {"shadows": "shadow", "thrown": "thrown", "indirect": "indirect", "residual": "residual", "direct": "shade"}
COUNTERS = {"shadows": "shadow", "soft shadows": "soft", "borders": "border", "thrown": "thrown"}
GRAZING = 1e-6  # a cosine below it is rounding: an upright wall does not face a light straight below


def plan_of(model: RelightModel, relighter: "Relighter | None" = None, lights: Sequence[Light] | None = None) -> Plan:
    """The plan of a model; with a relighter of it, what its options and its view leave out; with lights (world
    coordinates) too, what one frame of them costs.

    The frame is that of a fresh relighter: one that has rendered these lights before has kept their shadows. A
    surface's share of the shading is by its points; its shadow rays are counted.
    """
    lines = evidence_lines(model)
    if relighter is None:
        return Plan(tuple(lines))
    lines = [_with_options(line, relighter.options, relighter.view) for line in lines]
    if lights is None:
        return Plan(tuple(lines), _facts(model, relighter.view, None))
    stats = _frame_stats(relighter, list(lights))
    facing = _facing_points(model, relighter.view, lights)
    lines = [replace(o, is_on=stats.rays.get("soft", 0) > 0) if o.effect == "soft shadows" else o for o in lines]
    lines = [_priced(line, stats.milliseconds, stats.rays) for line in lines]
    lines += _surface_lines(model, relighter.view, facing, stats.milliseconds, stats.rays)
    facts = _facts(model, relighter.view, facing)
    return Plan(tuple(lines), facts, dict(stats.milliseconds), dict(stats.rays))


# ------------------------------------------------------------------------------------------------ one frame


def _frame_stats(relighter: "Relighter", lights: list[Light]) -> Stats:
    fresh = type(relighter)(relighter.given_model, relighter.camera, options=relighter.options)
    fresh.render(nudged(lights, relighter.model.mesh.radius))  # the first frame may compile
    return fresh.render(lights).stats


def _facing_points(model: RelightModel, view: View, lights: Sequence[Light]) -> np.ndarray:
    """surface x light: points that face each light, whatever stands between."""
    out = np.zeros((model.surfaces.num_surfaces, len(lights)), np.int64)
    for k, light in enumerate(lights):
        to_light = light.translated(-model.mesh.center).incident(view.points.position).to_light
        faces = np.einsum("pi,pi->p", view.normal, to_light) > GRAZING
        faces &= np.einsum("pi,pi->p", view.points.geometric_normal, to_light) > GRAZING
        out[:, k] = np.bincount(view.surface[faces], minlength=len(out))
    return out


def _with_options(line: PlanLine, options: RelightOptions, view: View) -> PlanLine:
    """The line as a relighter's options and view leave it."""
    o, number = options, line.effect.removeprefix("lobe ")
    off_by = {
        "shadows": (o.shadows == "off", "option shadows=off"),
        "borders": (not o.borders or o.shadows == "off", f"options shadows={o.shadows}, borders={o.borders}"),
        "outlines": (o.edge_samples == 1, "option edge_samples=1"),
        "mirror": (o.max_bounces == 0, "option max_bounces=0"),
        "second mirror": (o.max_bounces < 2, f"option max_bounces={o.max_bounces}"),
        "thrown": (not o.thrown, "option thrown=False"),
        "indirect": (not o.indirect, "option indirect=False"),
        "ambient": (not o.indirect, "option indirect=False"),
        "background": (not o.indirect, "option indirect=False"),
        "detail": (not o.detail, "option detail=False"),
        "residual": (not o.residual or o.max_modes == 0, "option residual=False or max_modes=0"),
        "lobes": (o.max_lobes == 0, "option max_lobes=0"),
    }
    off, why = off_by.get(line.effect, (False, ""))
    if number.isdigit() and int(number) > o.max_lobes:
        off, why = True, f"option max_lobes={o.max_lobes}"
    if not off and line.effect in ("mirror", "second mirror", "background") and not _shows_mirrors(view):
        off, why = True, "no mirror is in view"
    if not off and line.effect in ("lobes", "texture", "detail") and not (view.surface == line.surface).any():
        off, why = True, "not in view"
    return replace(line, is_on=False, reason=f"{why}; {line.reason}") if off and line.is_on else line


def _priced(line: PlanLine, milliseconds: Mapping[str, float], rays: Mapping[str, int]) -> PlanLine:
    """With the rays and the share of time that frame.stats counts for the effect."""
    total = max(sum(milliseconds.values()), 1e-9)
    # A scene's effect, or the one surface's that the clock knows: what mirrors throw.
    is_clocked = line.surface == SCENE or line.effect == "thrown"
    clock = CLOCKS.get(line.effect) if is_clocked else None
    counter = COUNTERS.get(line.effect) if is_clocked else None
    return replace(
        line,
        rays=rays.get(counter, 0) if counter else None,
        share=milliseconds.get(clock, 0.0) / total if clock else None,
    )


def _surface_lines(model: RelightModel, view: View, facing: np.ndarray, milliseconds, rays) -> list[PlanLine]:
    """Each surface's part of the frame: its shadow rays, and its share of shadows and shading."""
    total = max(sum(milliseconds.values()), 1e-9)
    asked, points = facing.sum(axis=1), np.bincount(view.surface, minlength=len(facing))
    cast = min(1.0, rays.get("shadow", 0) / max(int(asked.sum()), 1))  # a lattice or a cache asks for fewer
    lines = []
    for s in np.flatnonzero(points).tolist():
        why = f"{points[s]} points" if asked[s] else "no light above it"
        share = milliseconds.get("shadow", 0.0) * asked[s] / max(int(asked.sum()), 1)
        share += milliseconds.get("shade", 0.0) * points[s] / len(view.surface)
        line = PlanLine("direct", int(s), name_of(model, s), bool(asked[s]), why)
        lines.append(replace(line, rays=round(cast * int(asked[s])), share=float(share / total)))
    return lines


def _facts(model: RelightModel, view: View, facing: np.ndarray | None) -> tuple[str, ...]:
    facts = []
    if facing is not None:
        above = facing.sum(axis=0)
        facts += [f"light {k + 1} is above no point of this view: no ray" for k in np.flatnonzero(above == 0)]
        facts += [] if len(above) else ["no light: no ray"]
    if model.mirrors and not _shows_mirrors(view):
        facts.append("no mirror is in view: no bounce")
    return tuple(facts)


def _shows_mirrors(view: View) -> bool:
    return bool(view.is_mirrored.any()) or len(view.miss_pixel) > 0

"""Layers of trust: how well each fit was posed, what was never lit, and which effects the plan runs where."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from relight3d.display.light_layers import at_points
from relight3d.display.pictures import (
    BAD,
    FAIR,
    GOOD,
    UNKNOWN,
    WEAK,
    Painting,
    Swatch,
    category_color,
    image_of_points,
    painted_categories,
    painted_numbers,
    upper_limit,
)
from relight3d.display.subject import Lights, Subject
from relight3d.errors import InputError
from relight3d.maths.least_squares import Status
from relight3d.records import Health, RelightModel

_STATUS_COLORS = {
    Status.OK: GOOD,
    Status.RANK_DEFICIENT: WEAK,
    Status.UNDERDETERMINED: (214, 98, 140),
    Status.NO_DATA: UNKNOWN,
    Status.DID_NOT_CONVERGE: BAD,
    Status.FALLBACK: (126, 138, 196),
}
_MEASURES = ("status", "rank", "condition")


def health_names(model: RelightModel) -> tuple[str, ...]:
    """The layers that a model's fits add: "status:indirect" and its like, for fits that have a place in the picture."""
    placed = [name for name, health in model.health.items() if health.site in ("surface", "face", "vertex", "pixel")]
    return tuple(f"{measure}:{name}" for name in placed for measure in _MEASURES)


def health_layer(measure: str, family: str) -> Callable[[Subject, Lights], Painting]:
    """The painter of one measure ("status", "rank", "condition") of one family of fits."""

    def paint(subject: Subject, lights: Lights) -> Painting:
        model = subject.model
        if family not in model.health:
            raise InputError(
                f"layer {measure}:", family, f"one of {', '.join(model.health) or 'no family: it has none'}"
            )
        health = model.health[family]
        return {"status": _status, "rank": _rank, "condition": _condition}[measure](model, health)

    return paint


def _status(model: RelightModel, health: Health) -> Painting:
    status = _worst_at_points(model, health.site, health.status.astype(np.int32))
    words = {s: s.name.replace("_", " ").lower() for s in Status}
    words[Status.FALLBACK] += f": {health.fallback}" if health.fallback else ""
    legend = tuple(Swatch(_STATUS_COLORS[s], words[s]) for s in Status)
    counts = [f"{int((health.status == s).sum()):,} {words[s].partition(':')[0]}" for s in Status]
    note = "; ".join(count for count in counts if not count.startswith("0 "))
    return painted_categories(image_of_points(model, status, -1), legend, f"{note} (one fit for each {health.site})")


def _rank(model: RelightModel, health: Health) -> Painting:
    rank = -_worst_at_points(model, health.site, -health.rank)
    highest = float(health.rank.max(initial=1))
    values = image_of_points(model, rank.astype(np.float32))
    return painted_numbers(values, "cividis", 0.0, highest, "directions of the fit that the data decides")


def _condition(model: RelightModel, health: Health) -> Painting:
    """Infinite ones have a colour of their own, so that the others keep theirs."""
    is_open = ~np.isfinite(health.condition)
    digits = np.log10(np.clip(np.where(is_open, 1.0, health.condition), 1.0, None))
    values = image_of_points(model, _worst_at_points(model, health.site, digits).astype(np.float32))
    open_at = image_of_points(model, _worst_at_points(model, health.site, is_open), False)
    limit = max(upper_limit(np.where(open_at, np.nan, values)), 2.0)
    label = "log10 of the condition number: digits lost to noise"
    painting = painted_numbers(np.where(open_at, np.nan, values), "viridis_r", 0.0, limit, label)
    if not open_at.any():
        return painting
    painting.image[open_at] = UNKNOWN
    return replace(painting, legend=(Swatch(UNKNOWN, "infinite: the data leaves a direction open"),))


def _worst_at_points(model: RelightModel, site: str, badness: np.ndarray) -> np.ndarray:
    """The largest value of the sites that a point reads: what is weak at one corner of a face is weak all over it."""
    if site == "vertex":
        return badness[model.mesh.faces[model.pixels.points.face]].max(axis=1)
    return at_points(model, site, badness)


def trust(subject: Subject, lights: Lights) -> Painting:
    """How often the light was seen at what each pixel shows, and how far these lights are from photographed ones."""
    model, view = subject.model, subject.view
    count = np.full(model.camera.num_pixels, -1)
    shown = np.where(view.share > 0, model.pixels.num_lit[np.maximum(view.source, 0)], 0).max(axis=1)
    is_seen = view.share.sum(axis=1) > 0
    words = (
        Swatch(UNKNOWN, "never seen: known only as its surface's mean"),
        Swatch(BAD, "never lit in a photograph"),
        Swatch(WEAK, "lit once"),
        Swatch(FAIR, "lit two or three times"),
        Swatch(GOOD, "lit four times or more"),
        Swatch((70, 74, 110), "surroundings, seen in a mirror only"),
    )
    count[view.points.pixel] = np.where(is_seen, np.digitize(shown, (1, 2, 4)) + 1, 0)
    count[view.miss_pixel] = 5
    image = count.reshape(model.camera.height, model.camera.width).astype(np.int32)
    return painted_categories(image, words, extrapolation_note(model, lights))


def extrapolation_note(model: RelightModel, lights: Lights) -> str:
    """How far each light is from the nearest photographed one, in words; empty where that cannot be said."""
    angles = [f"{angle:.0f}°" for angle in angles_to_photographed(model, lights)]
    if not angles:
        return ""
    return f"{' and '.join(angles)} from the nearest photographed light, as seen from the scene's middle"


def angles_to_photographed(model: RelightModel, lights: Lights) -> list[float]:
    """Degrees between each light and the nearest one of the photographs, seen from the middle of the mesh."""
    middle = model.mesh.center[None]
    known = [light.incident(middle).to_light[0] for each in model.lights for light in each]
    if not known:
        return []
    angles = []
    for light in lights:
        cosine = np.clip(np.array(known) @ light.incident(middle).to_light[0], -1.0, 1.0)
        angles.append(float(np.degrees(np.arccos(cosine.max()))))
    return angles


def plan(subject: Subject, lights: Lights) -> Painting:
    """Which effects run on which surface, as the decisions say."""
    model = subject.model
    sets = [effects_on(model, surface) for surface in range(model.surfaces.num_surfaces)]
    found = list(dict.fromkeys(sets))
    legend = tuple(Swatch(category_color(i), ", ".join(words) or "none decided") for i, words in enumerate(found))
    index = np.array([found.index(words) for words in sets], np.int32)
    everywhere = ", ".join(effects_on(model, -1))
    note = f"whole scene: {everywhere}" if everywhere else ""
    return painted_categories(image_of_points(model, index[model.pixels.surface], -1), legend, note)


def effects_on(model: RelightModel, surface: int) -> tuple[str, ...]:
    """The effects that are on for one surface (-1: for the whole scene)."""
    return tuple(d.effect for d in model.decisions if d.surface == surface and d.is_on)

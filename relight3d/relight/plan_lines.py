"""The lines of a plan: each effect on or off, and the evidence that recovery has for it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from relight3d.effects import SCENE
from relight3d.records import Decision, RelightModel

COLUMNS = ("effect", "where", "state", "gain dB", "noise dB", "confidence", "rays", "time", "why")


@dataclass(frozen=True)
class PlanLine:
    """One effect on one surface (-1: the whole scene); figures are None where nothing was measured."""

    effect: str
    surface: int
    where: str
    is_on: bool
    reason: str
    confidence: str = "by the geometry"
    gain_db: float | None = None  # what left-out photographs gain by it
    noise_db: float | None = None
    rays: int | None = None
    share: float | None = None  # of the frame's time


@dataclass(frozen=True)
class Plan:
    """Every effect with its evidence, and what one frame's lights and camera made of it."""

    lines: tuple[PlanLine, ...]
    facts: tuple[str, ...] = ()
    milliseconds: Mapping[str, float] = field(default_factory=dict)
    rays: Mapping[str, int] = field(default_factory=dict)

    def is_on(self, effect: str, surface: int = SCENE) -> bool:
        """Whether an effect is on, on one surface or (-1) anywhere."""
        return any(o.is_on for o in self.lines if o.effect == effect and surface in (SCENE, o.surface))

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects that are on somewhere."""
        return tuple(dict.fromkeys(line.effect for line in self.lines if line.is_on))

    def rows(self) -> list[tuple[str, ...]]:
        """Cells under COLUMNS."""
        return [
            (
                o.effect,
                o.where,
                "on" if o.is_on else "off",
                _number(o.gain_db, ".2f"),
                _number(o.noise_db, ".2f"),
                o.confidence,
                _number(o.rays, ",d"),
                _number(o.share, ".0%"),
                o.reason,
            )
            for o in self.lines
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and text: what `relight3d plan --json` prints."""
        rays, milliseconds = dict(self.rays), dict(self.milliseconds)
        return {
            "lines": [asdict(o) for o in self.lines],
            "facts": list(self.facts),
            "rays": rays,
            "milliseconds": milliseconds,
        }

    @staticmethod
    def from_dict(value: Mapping[str, Any]) -> "Plan":
        lines = tuple(PlanLine(**line) for line in value["lines"])
        return Plan(lines, tuple(value["facts"]), value["milliseconds"], value["rays"])

    def __str__(self) -> str:
        cells = [COLUMNS, *self.rows()]
        widths = [max(len(row[k]) for row in cells) for k in range(len(COLUMNS) - 1)]
        text = ["  ".join([*(c.ljust(w) for c, w in zip(row, widths)), row[-1]]).rstrip() for row in cells]
        return "\n".join([*text, *self.facts])


def evidence_lines(model: RelightModel) -> list[PlanLine]:
    """What recovery decided and why, then what follows from it, by surface."""
    lines = [_line(model, decision) for decision in model.decisions]
    known = {(line.effect, line.surface) for line in lines}
    lines += [line for line in _by_geometry(model) if (line.effect, line.surface) not in known]
    return sorted(lines, key=lambda line: line.surface)


def confidence_in(is_on: bool, gain_db: float, noise_db: float) -> str:
    """In words, how far the gain lies from the chance that could have made it."""
    if noise_db <= 0:
        return "by the geometry"
    ratio = gain_db / noise_db
    if is_on:
        return "strong" if ratio > 5 else "clear" if ratio > 2 else "weak"
    return "no gain" if gain_db <= 0 else "within the noise" if ratio <= 1 else "small"


def _line(model: RelightModel, decision: Decision) -> PlanLine:
    d, gain, noise = decision, float(decision.gain_db), float(decision.noise_db)
    measured = d.noise_db > 0
    return PlanLine(
        d.effect,
        int(d.surface),
        name_of(model, d.surface),
        bool(d.is_on),
        d.reason,
        confidence_in(bool(d.is_on), gain, noise),
        gain if measured else None,
        noise if measured else None,
    )


def _by_geometry(model: RelightModel) -> list[PlanLine]:
    """The effects that follow from others, and need no evidence of their own."""
    lines = []
    for mirror in model.mirrors:
        why = "the patch of light that a plane mirror throws" if mirror.is_plane else "a curved mirror throws no patch"
        lines.append(PlanLine("thrown", mirror.surface, name_of(model, mirror.surface), mirror.throws_light, why))
    for surface, lobes in enumerate(model.lobes):
        for number, lobe in enumerate(lobes, start=1):
            is_round = lobe.axes[0] == lobe.axes[1]
            kind = (
                ("half-way" if is_round else "brushed")
                if lobe.is_halfway
                else "isotropic"
                if is_round
                else "anisotropic"
            )
            why = f"{kind}, exponent {lobe.exponent:.3g}, colour {np.round(lobe.color, 3).tolist()}"
            lines.append(PlanLine(f"lobe {number}", surface, name_of(model, surface), True, why, "with the lobes"))
    mirrors, has_background = model.mirrors, model.background is not None
    meet = len(mirrors) > 1 or any(not m.is_plane for m in mirrors)
    alone = "one plane mirror cannot show itself" if mirrors else "no mirror"
    around = "mirrors show surroundings that the mesh does not have"
    rest = {
        "borders": (True, "a pixel on a shadow's border sees a part of the light"),
        "outlines": (True, "a pixel on an outline mixes what it covers"),
        "second mirror": (meet, "mirrors can show each other" if meet else alone),
        "background": (has_background, around if has_background else "no mirror shows anything beyond the mesh"),
        "soft shadows": (False, "when a light has an extent"),
    }
    return lines + [PlanLine(name, SCENE, "scene", on, why) for name, (on, why) in rest.items()]


def name_of(model: RelightModel, surface: int) -> str:
    return "scene" if surface == SCENE else model.surfaces.names[surface]


def _number(value: float | int | None, form: str) -> str:
    return "" if value is None else format(value, form)

"""relight3d plan: which effects a model has on which surface, the evidence for each, and what they cost in a frame."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from relight3d.commands.command import Command, Flag, ModelPath
from relight3d.commands.relighting import Relighting
from relight3d.commands.tables import terminal_table
from relight3d.io.light_files import read_lights
from relight3d.io.model_file import load_model
from relight3d.lights import Light
from relight3d.progress import say, show
from relight3d.records import RelightModel
from relight3d.relight.plan import plan_of
from relight3d.relight.plan_lines import COLUMNS


@dataclass(frozen=True)
class Plan(Command):
    """Show every effect on or off, surface by surface, with its evidence, its rays and its share of a frame's time."""

    model: ModelPath
    lights: Path | None = None  # LIGHTS.json of the frame to measure; the first photograph's if left out
    json: Flag = False  # print JSON instead of a table
    relighting: Annotated[Relighting, tyro.conf.arg(name="")] = field(default_factory=Relighting)

    def run(self) -> None:
        model = load_model(self.model)
        relighter = self.relighting.relighter(model)
        plan = plan_of(relighter.given_model, relighter, self._lights(model))
        if self.json:
            say(json.dumps(plan.to_dict(), indent=2))
            return
        show(terminal_table(str(self.model), COLUMNS, plan.rows()))
        for fact in plan.facts:
            say(fact)
        say(f"frame: {sum(plan.milliseconds.values()):.1f} ms, {sum(plan.rays.values())} rays")

    def _lights(self, model: RelightModel) -> list[Light]:
        if self.lights is None:
            return list(next((each for each in model.lights if each), ()))
        return read_lights(self.lights)[0][0]

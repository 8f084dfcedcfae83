"""relight3d evaluate: a model against photographs it has not seen, beside what interpolation makes of the same."""

import json
from dataclasses import dataclass, field
from typing import Annotated

import tyro

import relight3d
from relight3d.commands.command import CapturePath, Command, Flag, ModelPath
from relight3d.commands.relighting import Relighting
from relight3d.commands.tables import METHOD_COLUMNS, SURFACE_COLUMNS, method_cells, surface_cells, terminal_table
from relight3d.evaluate.run import Evaluation
from relight3d.io.capture import load_capture
from relight3d.io.model_file import load_model
from relight3d.progress import say, show, working


@dataclass(frozen=True)
class Evaluate(Command):
    """Compare a model with the held-out photographs of a capture: PSNR, SSIM, FLIP and relative error.

    PTM, HSH and RBF interpolation, fitted to the same training photographs, stand beside it.
    """

    model: ModelPath
    capture: CapturePath
    split: str = "test"  # which photographs
    json: Flag = False  # print JSON instead of tables
    no_baselines: Flag = False  # leave the interpolations out
    relighting: Annotated[Relighting, tyro.conf.arg(name="")] = field(default_factory=Relighting)

    def run(self) -> None:
        model, capture = load_model(self.model), load_capture(self.capture)
        with working("evaluate", self.hides_bar):
            relighter = self.relighting.relighter(model)
            evaluation = relight3d.evaluate(
                relighter.given_model, capture, self.split, relighter.options, baselines=not self.no_baselines
            )
        if self.json:
            say(json.dumps(evaluation.to_dict(), indent=2))
        else:
            print_evaluation(evaluation)


def print_evaluation(evaluation: Evaluation) -> None:
    """Both tables, methods and surfaces."""
    title = f"Photographs of split {evaluation.split!r}"
    show(terminal_table(title, METHOD_COLUMNS, method_cells(evaluation)))
    if evaluation.surfaces:
        show(terminal_table("By surface", SURFACE_COLUMNS, surface_cells(evaluation)))

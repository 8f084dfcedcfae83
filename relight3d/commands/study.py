"""relight3d study: what accuracy costs in time, measured on a capture."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

import relight3d
from relight3d.commands.command import CapturePath, Command, Flag, require_writable
from relight3d.commands.tables import terminal_table
from relight3d.evaluate.study import COSTS, cost_of, key_of
from relight3d.evaluate.study import Study as Measured
from relight3d.io.capture import load_capture
from relight3d.progress import remark, say, show, stage_bar

COLUMNS = ("setting", "PSNR dB", "cost")


@dataclass(frozen=True)
class Study(Command):
    """Measure a ladder of settings: error, recovery time, frame time; and mark those worth choosing.

    Finished settings are kept in the folder: a stopped study goes on where it was.
    """

    capture: CapturePath
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FOLDER")]  # gets the page, tables and plots
    quick: Flag = False  # fewer settings, recovery at half resolution: a few minutes
    budget_s: float | None = None  # begin nothing new after so many seconds

    def run(self) -> None:
        require_writable(self.output / "study.html")
        capture = load_capture(self.capture)
        with stage_bar("study", self.hides_bar) as report:
            study = relight3d.study(capture, self.output, self.quick, self.budget_s, report)
        for family in COSTS:
            show(terminal_table(f"Worth choosing: {family}", COLUMNS, _front(study, family)))
        if study.skipped:
            remark(f"no time for {len(study.skipped)} of the settings (the page names them); a longer run goes on")
        say(f"{self.output / 'study.html'}: {len(study.points)} settings in {study.seconds:.0f} s")


def _front(study: Measured, family: str) -> list[tuple[str, str, str]]:
    """The settings that no other beats in both error and cost, cheapest first."""
    beaten, unit = study.dominators(), "s" if family == "recovery" else "ms"
    points = [point for point in study.family(family) if key_of(point) not in beaten]
    return [(f"{p.factor}: {p.name}", f"{p.psnr_db:.2f}", f"{cost_of(p):.2f} {unit}") for p in points]

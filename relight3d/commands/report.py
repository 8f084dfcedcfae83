"""relight3d report: one page about a model and its capture, to be opened in a browser."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

import relight3d
from relight3d.commands.command import CapturePath, Command, ModelPath, require_writable
from relight3d.io.capture import load_capture
from relight3d.io.model_file import load_model
from relight3d.progress import say, working


@dataclass(frozen=True)
class Report(Command):
    """Write an HTML page that stands on its own: frames, figures, inspection layers, health of every fit."""

    model: ModelPath
    capture: CapturePath
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FOLDER")]  # gets the page
    study: Path | None = None  # the folder of a study whose plots are to be shown

    def run(self) -> None:
        require_writable(self.output / "index.html")
        model, capture = load_model(self.model), load_capture(self.capture)
        with working("report", self.hides_bar):
            page = relight3d.report(model, capture, self.output, study=self.study)
        say(f"{page}: {page.stat().st_size / 1e6:.1f} MB")

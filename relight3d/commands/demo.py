"""relight3d demo: the whole way on the desk that comes with the repository, in a few minutes."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

import relight3d
from relight3d.commands.command import Command
from relight3d.commands.contact_sheet import contact_sheet, strips
from relight3d.commands.evaluate import print_evaluation
from relight3d.commands.light_path import round_trip
from relight3d.commands.recover import recover_to
from relight3d.commands.render import Render
from relight3d.commands.tables import METHOD_COLUMNS, SURFACE_COLUMNS, markdown_table, method_cells, surface_cells
from relight3d.errors import InputError
from relight3d.evaluate.run import Evaluation
from relight3d.io.capture import load_capture
from relight3d.io.files import write_json, write_text
from relight3d.io.images import write_png
from relight3d.progress import say, working
from relight3d.records import RelightModel
from relight3d.recover.run import RecoverOptions

DESK = Path(__file__).parents[2] / "data" / "desk"  # in a clone; an installed package has no data


@dataclass(frozen=True)
class Demo(Command):
    """Recover the demo capture, evaluate it beside the baselines, relight it, and leave pictures and tables."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FOLDER")] = Path("output/demo")
    capture: Path = DESK
    num_frames: int = 48  # of the film in which a light goes round
    options: Annotated[RecoverOptions, tyro.conf.arg(name="recover")] = field(default_factory=RecoverOptions)

    def run(self) -> None:
        if self.capture == DESK and not DESK.exists():
            raise InputError("capture", f"no {DESK}", "a clone of the repository", "or name one: --capture FOLDER")
        if not 1 <= self.num_frames <= 10000:
            raise InputError("num_frames", self.num_frames, "1 to 10000")
        folder, capture = self.output, load_capture(self.capture)
        model = recover_to(folder / "model.relight", self.capture, self.options, self.hides_bar)
        with working("evaluate", self.hides_bar):
            evaluation = relight3d.evaluate(model, capture)
            mean, worst = evaluation.model.mean.psnr_db, evaluation.model.worst.psnr_db
            title = f"{capture.folder.name}: held-out photographs, mean {mean:.1f} dB, worst {worst:.1f} dB"
            sheet = contact_sheet(title, strips(model, capture, evaluation))
        write_png(folder / "contact_sheet.png", sheet)
        write_tables(folder, evaluation)
        print_evaluation(evaluation)
        self._relight(model, folder)
        say(self._where())

    def _relight(self, model: RelightModel, folder: Path) -> None:
        """A film of a light that goes round, and a few places of it as pictures."""
        write_json(folder / "round.json", [[light.to_dict()] for light in round_trip(model, self.num_frames)])
        write_json(folder / "few.json", [[light.to_dict()] for light in round_trip(model, 6)])
        common = {"model": folder / "model.relight", "quiet": self.quiet, "verbose": self.verbose}
        Render(lights=folder / "round.json", output=str(folder / "relit.mp4"), **common).run()
        Render(lights=folder / "few.json", output=str(folder / "relit"), **common).run()

    def _where(self) -> str:
        files = {
            "contact_sheet.png": "held-out photographs, relit and as taken",
            "evaluation.md": "the table above (also .json)",
            "relit.mp4": "a light going round (its lights: round.json)",
            "relit": "frames of it (their lights: few.json)",
            "model.relight": "the model: relight3d view, render, plan and report take it",
        }
        width = max(len(str(self.output / name)) for name in files)
        lines = [f"  {self.output / name!s:<{width}}  {words}" for name, words in files.items()]
        return "\n".join(["", f"Results are in {self.output.resolve()}:", *lines])


def write_tables(folder: Path, evaluation: Evaluation) -> None:
    """The evaluation as Markdown and as JSON."""
    text = "# Evaluation\n\n" + markdown_table(METHOD_COLUMNS, method_cells(evaluation))
    if evaluation.surfaces:
        text += "\n## By surface\n\n" + markdown_table(SURFACE_COLUMNS, surface_cells(evaluation))
    write_text(folder / "evaluation.md", text)
    write_json(folder / "evaluation.json", evaluation.to_dict())

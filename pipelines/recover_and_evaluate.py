"""The whole way: recover a capture, evaluate the model beside the baselines, leave a contact sheet.

    python pipelines/recover_and_evaluate.py data/desk --output output/desk

The model is kept: a second run with the same capture, options and code only evaluates.
"""

from pathlib import Path

from stages import CapturePath, Options
from start import start

import relight3d
from relight3d.commands.contact_sheet import contact_sheet, strips
from relight3d.commands.demo import write_tables
from relight3d.commands.evaluate import print_evaluation
from relight3d.io.images import write_png
from relight3d.io.stage_file import kept
from relight3d.progress import say, stage_bar
from relight3d.recover.run import RecoverOptions

CAPTURE, OUTPUT = Path("data/desk"), Path("output/desk")
OPTIONS = RecoverOptions()


def main(capture: CapturePath = CAPTURE, output: Path = OUTPUT, options: Options = OPTIONS) -> None:
    read = relight3d.load_capture(capture)
    with stage_bar("recover") as report:
        model = kept(
            output / "model.npz", lambda: relight3d.recover(read, options, progress=report), read, options
        )
    model.save(output / "model.relight")
    evaluation = relight3d.evaluate(model, read)
    print_evaluation(evaluation)
    write_tables(output, evaluation)
    write_png(output / "contact_sheet.png", contact_sheet(read.folder.name, strips(model, read, evaluation)))
    say(f"{output}: model.relight, evaluation.md, evaluation.json, contact_sheet.png")


if __name__ == "__main__":
    start(main, __doc__)

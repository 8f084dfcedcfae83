"""One line a capture: the model and every baseline on the held-out photographs at the captured viewpoint, as Markdown.

    python pipelines/compare_baselines.py data/desk data/desk_tiny --output output/baselines

Models are kept: a second run with the same captures and code only evaluates.
"""

from pathlib import Path
from typing import Annotated

import tyro
from start import start

import relight3d
from relight3d.commands.tables import markdown_table
from relight3d.evaluate.baselines import BASELINES
from relight3d.io.files import write_text
from relight3d.io.stage_file import kept
from relight3d.progress import say, stage_bar

CAPTURES, OUTPUT = (Path("data/desk"), Path("data/desk_tiny")), Path("output/baselines")
COLUMNS = ("capture", "photographs", "relight3d", *BASELINES)


def main(captures: Annotated[tuple[Path, ...], tyro.conf.Positional] = CAPTURES, output: Path = OUTPUT) -> None:
    table = markdown_table(COLUMNS, [row(capture, output) for capture in captures])
    write_text(output / "baselines.md", table)
    say(table)


def row(folder: Path, output: Path) -> tuple[str, ...]:
    """PSNR in dB of each method over the frames that all of them can do."""
    capture = relight3d.load_capture(folder)
    with stage_bar(f"recover {folder.name}") as report:
        model = kept(output / f"{folder.name}.npz", lambda: relight3d.recover(capture, progress=report), capture)
    evaluation = relight3d.evaluate(model, capture)
    shared = [frame.name for frame in next(iter(evaluation.baselines.values())).frames]
    methods = [evaluation.model.only(shared), *evaluation.baselines.values()]
    count = len(capture.split("train"))
    return (folder.name, str(count), *(f"{metrics.mean.psnr_db:.2f}" for metrics in methods))


if __name__ == "__main__":
    start(main, __doc__)

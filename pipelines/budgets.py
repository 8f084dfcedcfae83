"""Is a time budget kept? Settings chosen for budgets, timed in turn, and what held-out photographs say of them.

    python pipelines/budgets.py data/desk --output output/budgets

The model is kept until its inputs change. A setting is timed when it is chosen; later, frames of all budgets are rendered in
turn, so that what else the machine does falls on each of them.
"""

from pathlib import Path

import numpy as np
from stages import CapturePath, Options
from start import start

import relight3d
from relight3d.commands.tables import markdown_table
from relight3d.evaluate.worth import HeldOut
from relight3d.io.files import write_text
from relight3d.io.stage_file import kept
from relight3d.progress import say, stage_bar
from relight3d.recover.run import RecoverOptions
from relight3d.relight.budget import options_of
from relight3d.relight.calibrate import frame_times_ms

CAPTURE, OUTPUT, BUDGETS = (
    Path("data/desk"),
    Path("output/budgets"),
    (4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0, 64.0),
)
OPTIONS = RecoverOptions()
NUM_TURNS = 15
COLUMNS = ("budget ms", "timed ms", "later ms", "promised loss dB", "held-out PSNR dB", "setting", "warning")


def main(
    capture: CapturePath = CAPTURE,
    output: Path = OUTPUT,
    budgets: tuple[float, ...] = BUDGETS,
    options: Options = OPTIONS,
) -> None:
    read = relight3d.load_capture(capture)
    with stage_bar("recover") as report:
        model = kept(output / "model.npz", lambda: relight3d.recover(read, options, progress=report), read, options)
    chosen = [relight3d.Relighter(model, budget_ms=budget) for budget in budgets]
    times = np.array([[frame_times_ms(each, 1)[0] for each in chosen] for _ in range(NUM_TURNS)])
    held_out, rows = HeldOut(read, model), []
    for budget, relighter, took in zip(budgets, chosen, np.median(times, axis=0)):
        price = next(p for p in model.prices if options_of(p) == relighter.options)
        said, _, missed = relighter.render([]).stats.notes[0].removeprefix(f"{price.name}: ").partition("; ")
        psnr = held_out.psnr_db(model, relighter.options).mean()
        figures = (f"{budget:g}", said.partition(" ms")[0], f"{took:.1f}", f"{price.error_db:.2f}", f"{psnr:.2f}")
        rows.append((*figures, price.name, missed))
    text = f"{read.folder.name}\n\n" + markdown_table(COLUMNS, rows)
    write_text(output / "budgets.md", text)
    say(text)


if __name__ == "__main__":
    start(main, __doc__)

"""Stage 5: which surfaces are glossy, and the Lafortune lobes that left-out photographs gain by.

    python pipelines/lobes.py data/desk --output output/stages/desk --number 1
"""

from pathlib import Path

from stages import CapturePath, Options, Stages
from start import start

from relight3d.commands.tables import terminal_table
from relight3d.progress import show
from relight3d.recover.run import RecoverOptions

CAPTURE, OUTPUT = Path("data/desk"), Path("output/stages/desk")
OPTIONS = RecoverOptions()
COLUMNS = ("surface", "lobe", "colour", "axes", "exponent")


def main(capture: CapturePath = CAPTURE, output: Path = OUTPUT, number: int = 1, options: Options = OPTIONS) -> None:
    stages = Stages(capture, output, options)
    rows = []
    for name, lobes in zip(stages.surfaces.names, stages.lobes(number).lobes):
        for index, lobe in enumerate(lobes):
            color, axes = (" ".join(f"{value:.3g}" for value in values) for values in (lobe.color, lobe.axes))
            rows.append((name, str(index), color, axes, f"{lobe.exponent:.1f}"))
        if not lobes:
            rows.append((name, "", "", "", ""))
    show(terminal_table(f"Lobes, round {number}", COLUMNS, rows))


if __name__ == "__main__":
    start(main, __doc__)

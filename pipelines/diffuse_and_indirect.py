"""Stage 4: albedo from shadow borders and all photographs, and the indirect light, in turn; no lobes yet.

    python pipelines/diffuse_and_indirect.py data/desk --output output/stages/desk
"""

from pathlib import Path

import numpy as np
from stages import CapturePath, Options, Stages
from start import start

from relight3d.commands.tables import terminal_table
from relight3d.io.images import write_exr, write_png
from relight3d.maths.color import display_u8
from relight3d.progress import say, show
from relight3d.recover.run import RecoverOptions

CAPTURE, OUTPUT = Path("data/desk"), Path("output/stages/desk")
OPTIONS = RecoverOptions()
COLUMNS = ("surface", "textured", "red", "green", "blue")


def main(capture: CapturePath = CAPTURE, output: Path = OUTPUT, options: Options = OPTIONS) -> None:
    stages = Stages(capture, output, options)
    fitted = stages.diffuse(0)
    rows = [
        (name, "yes" if textured else "", *(f"{value:.3f}" for value in albedo))
        for name, textured, albedo in zip(stages.surfaces.names, fitted.is_textured, fitted.surface_albedo)
    ]
    show(terminal_table("Albedo", COLUMNS, rows))
    for name, solution in {"shadow borders": fitted.border, "indirect light": fitted.solution}.items():
        say(f"{name}: {'' if solution is None else solution.counts()}")
    write_exr(output / "albedo.exr", stages.picture(fitted.albedo))
    write_png(output / "albedo.png", display_u8(stages.picture(fitted.albedo)))
    irradiance = stages.picture(fitted.irradiance.mean(axis=0))
    write_png(output / "indirect.png", display_u8(irradiance, 1 / max(float(np.percentile(irradiance, 99.5)), 1e-9)))
    say(f"{output / 'albedo.png'}, {output / 'albedo.exr'}, {output / 'indirect.png'} (mean of all photographs)")


if __name__ == "__main__":
    start(main, __doc__)

"""Stage 6: surface detail (normals or lobe gains per pixel) and the mirrors' reflectance, with the evidence for each.

    python pipelines/detail.py data/desk --output output/stages/desk --number 1
"""

from pathlib import Path

import numpy as np
from stages import CapturePath, Options, Stages
from start import start

from relight3d.commands.tables import terminal_table
from relight3d.io.images import write_png
from relight3d.progress import say, show
from relight3d.recover.run import RecoverOptions

CAPTURE, OUTPUT = Path("data/desk"), Path("output/stages/desk")
OPTIONS = RecoverOptions()
COLUMNS = ("surface", "effect", "gain dB", "why")


def main(capture: CapturePath = CAPTURE, output: Path = OUTPUT, number: int = 1, options: Options = OPTIONS) -> None:
    stages = Stages(capture, output, options)
    fitted, mirrors = stages.detail(number)
    names = stages.surfaces.names
    rows = [
        (names[surface], effect, f"{found.gain_db:.2f}", found.reason)
        for (effect, surface), found in fitted.evidence.items()
        if effect in ("detail", "mirror")
    ]
    show(terminal_table(f"Detail and mirrors, round {number}", COLUMNS, rows))
    for one in mirrors:
        color = " ".join(f"{value:.3f}" for value in one.reflectance)
        say(f"mirror {names[one.surface]}: reflectance {color}, {'plane' if one.is_plane else 'curved'}")
    tilt = np.einsum("pi,pi->p", fitted.normal, stages.points.normal).clip(-1, 1)
    say(f"normals moved by {np.degrees(np.arccos(tilt)).mean():.2f} degrees on average")
    write_png(output / "normals.png", (stages.picture(fitted.normal / 2 + 0.5) * 255).clip(0, 255).astype(np.uint8))
    say(f"{output / 'normals.png'}")


if __name__ == "__main__":
    start(main, __doc__)

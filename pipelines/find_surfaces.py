"""Stage 2: the regions of one material, by the mesh's labels or by creases and albedo.

    python pipelines/find_surfaces.py data/desk --output output/stages/desk
"""

from pathlib import Path

import numpy as np
from stages import CapturePath, Options, Stages
from start import start

from relight3d.commands.tables import terminal_table
from relight3d.display.pictures import category_color
from relight3d.io.images import write_png
from relight3d.progress import say, show
from relight3d.recover.run import RecoverOptions

CAPTURE, OUTPUT = Path("data/desk"), Path("output/stages/desk")
OPTIONS = RecoverOptions()


def main(capture: CapturePath = CAPTURE, output: Path = OUTPUT, options: Options = OPTIONS) -> None:
    stages = Stages(capture, output, options)
    found = stages.surfaces
    of_point = found.surface_of_face[stages.points.face]
    num_faces = np.bincount(found.surface_of_face, minlength=found.num_surfaces)
    num_pixels = np.bincount(of_point, minlength=found.num_surfaces)
    rows = [(name, str(faces), str(pixels)) for name, faces, pixels in zip(found.names, num_faces, num_pixels)]
    show(terminal_table(f"{found.num_surfaces} surfaces", ("surface", "faces", "pixels"), rows))
    colors = np.array([category_color(index) for index in range(found.num_surfaces)], np.float32)
    write_png(output / "surfaces.png", stages.picture(colors[of_point]).astype(np.uint8))
    say(f"{output / 'surfaces.png'}")


if __name__ == "__main__":
    start(main, __doc__)

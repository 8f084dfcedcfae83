"""How the error grows as a capture gets worse: fewer photographs, clustered lights, noise, shift, a coarser mesh.

    python pipelines/degradation.py data/desk ../shared/captures/diligent_cat

Writes docs/degradation.csv, docs/images/degradation_*.png and a section of docs/stability.md. Captures that are not
there are left out, points that are in the CSV file already are not made again. About fifteen minutes a capture on two cores.
"""

import argparse
import csv
import logging
import time
from pathlib import Path

from stability.curves import CURVES, reduced
from stability.degradation_page import draw, read, write_page

import relight3d
from relight3d.evaluate.run import evaluate
from relight3d.recover.mesh import MeshOptions
from relight3d.recover.run import RecoverOptions

DOCS = Path(__file__).parents[1] / "docs"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", type=Path, nargs="+")
    parser.add_argument("--width", type=int, default=100, help="photographs are averaged down to about this width")
    parser.add_argument("--faces", type=int, default=4000, help="a mesh of fewer faces is split")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder of the CSV file, the page and its images")
    options = parser.parse_args()
    there = [folder for folder in options.captures if (folder / "transforms.json").exists()]
    if not there:  # else the page would be written anew, without them
        parser.error(f"none of {', '.join(map(str, options.captures))} is a capture folder")
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    recovery = RecoverOptions(mesh=MeshOptions(target_faces=options.faces), prices=False)
    (options.out / "images").mkdir(parents=True, exist_ok=True)
    path = options.out / "degradation.csv"
    known = {(*curve, point[0]) for curve, points in read(path).items() for point in points}
    for folder in there:
        capture = relight3d.load_capture(folder)
        capture = reduced(capture, max(1, round(capture.camera.width / options.width)))
        for curve, (_, values, worsened) in CURVES.items():
            for value in [value for value in values if (folder.name, curve, value) not in known]:
                begin, worse = time.perf_counter(), worsened(capture, value)
                model = relight3d.recover(worse, recovery, quiet=True)
                mean = evaluate(model, worse, baselines=False).model.mean
                with open(path, "a", newline="") as file:
                    num, width = len(worse.split("train")), worse.camera.width
                    row = [folder.name, curve, f"{value:g}", num, width, f"{mean.psnr_db:.2f}"]
                    csv.writer(file, lineterminator="\n").writerow(row)
                print(*row, f"dB ({time.perf_counter() - begin:.1f} s)", flush=True)

    draw(path, options.out / "images")
    write_page(path, options.captures, options.faces)


if __name__ == "__main__":
    main()

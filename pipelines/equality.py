"""How far the compiled frames are from the NumPy reference, over all photographs of a capture.

    python pipelines/equality.py --capture data/desk_tiny [--model tiny.relight]

Prints the largest difference, relative to a value or to a twentieth of white where it is darker; ends with 1 where it
exceeds 1e-4.
"""

import argparse
from pathlib import Path

import numpy as np

from relight3d.io.capture import load_capture
from relight3d.io.model_file import load_model
from relight3d.recover.run import recover
from relight3d.relight.options import RelightOptions
from relight3d.relight.relighter import Relighter

AT_MOST = 1e-4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--capture", type=Path, default=Path("data/desk_tiny"))
    parser.add_argument("--model", type=Path, help="a model of it; else it is recovered first")
    options = parser.parse_args()
    capture = load_capture(options.capture)
    model = load_model(options.model) if options.model else recover(capture)
    compiled, reference = (Relighter(model, options=RelightOptions(backend=b)) for b in ("numba", "numpy"))
    worst = 0.0
    for photograph in sorted(capture.photographs, key=lambda each: not each.camera.same_as(model.camera)):
        if not photograph.camera.same_as(compiled.camera):
            for relighter in (compiled, reference):
                relighter.set_camera(photograph.camera)
        got, wanted = (relighter.render(photograph.lights) for relighter in (compiled, reference))
        floor = np.maximum(np.abs(wanted.radiance), 0.05 / model.exposure)
        difference = float((np.abs(got.radiance - wanted.radiance) / floor).max())
        worst = max(worst, difference)
        print(f"{photograph.name}: {difference:.1e}")
    print(f"{len(capture.photographs)} photographs: at most {worst:.1e}")
    raise SystemExit(1 if worst > AT_MOST else 0)


if __name__ == "__main__":
    main()

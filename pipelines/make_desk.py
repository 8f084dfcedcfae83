"""Makes a demo capture: models a desk, path-traces it with Mitsuba 3, writes a capture folder with its truth.

    python pipelines/make_desk.py --scene desk --out data/desk

Needs `mitsuba`, `OpenEXR`, `imageio` and `scipy` (not relight3d); with LLVM 19 (Debian: libllvm19) it is much faster.
Finished chunks of samples lie in the work folder, so a stopped run goes on where it was. The capture folder is written
twice: as a draft at an eighth of the samples, and at the end.
"""

import argparse
import logging
import math
import tempfile
from dataclasses import replace
from pathlib import Path

from desk import variant
from desk.settings import SCENES


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=sorted(SCENES), default="desk")
    parser.add_argument("--out", type=Path, required=True, help="capture folder to write")
    parser.add_argument(
        "--budget-s", type=float, default=math.inf, help="stop after this many seconds; run again to go on"
    )
    parser.add_argument("--samples", type=int, help="other than the scene's own: few for a look, or for scalar_rgb")
    parser.add_argument(
        "--work", type=Path, default=Path(tempfile.gettempdir()) / "make_desk", help="unfinished renders"
    )
    parser.add_argument("--variant", default="auto", help="auto, llvm_ad_rgb or scalar_rgb (0.5 ms a sample and pixel)")
    options = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    logging.info("variant %s", variant.choose(options.variant))

    from desk.run import make  # after the variant is chosen: its modules define classes of that variant

    settings = SCENES[options.scene]
    if options.samples:
        few = {"samples": options.samples, "ambient_samples": 4 * options.samples}
        settings = replace(settings, **few, chunk=min(settings.chunk, options.samples))
    make(settings, options.out, options.work, options.budget_s)


if __name__ == "__main__":
    main()

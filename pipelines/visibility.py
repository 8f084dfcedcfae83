"""Stage 3: where each photograph's light is seen; red near shadow borders, blue where a highlight may be.

    python pipelines/visibility.py data/desk --output output/stages/desk
"""

from pathlib import Path

import numpy as np
from stages import CapturePath, Options, Stages
from start import start

from relight3d.io.images import write_png
from relight3d.progress import say, track
from relight3d.recover.run import RecoverOptions

CAPTURE, OUTPUT = Path("data/desk"), Path("output/stages/desk")
OPTIONS = RecoverOptions()


def main(capture: CapturePath = CAPTURE, output: Path = OUTPUT, options: Options = OPTIONS) -> None:
    stages = Stages(capture, output, options)
    observed, photographs = stages.observed, stages.capture.split("train")
    for index, photograph in enumerate(track(photographs, "visibility", len(photographs))):
        lit = observed.is_lit[index].astype(np.float32)
        unsafe, glare = ~observed.is_safe[index], observed.is_highlight[index] & observed.is_lit[index]
        colors = np.stack([np.maximum(lit, unsafe), lit * ~unsafe, np.where(glare, 1.0, lit * ~unsafe * 0.6)], axis=1)
        write_png(output / "visibility" / f"{photograph.name}.png", (stages.picture(colors) * 255).astype(np.uint8))
    seen = 100 * observed.is_lit.mean(axis=1)
    say(f"{observed.num_rays} shadow rays; lit: {seen.min():.0f} to {seen.max():.0f} % of the points")
    say(f"never lit: {100 * (~observed.is_lit.any(axis=0)).mean():.1f} % of the points")
    say(f"{output / 'visibility'}")


if __name__ == "__main__":
    start(main, __doc__)

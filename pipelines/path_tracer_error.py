"""How long Mitsuba's path tracer takes for an error: a held-out photograph of data/desk at more and more samples.

    MITSUBA_PYTHON pipelines/path_tracer_error.py --samples 4 16 64

The scene is the true one, of which the model knows nothing; so its error is noise alone. Compare with the seconds of a
frame (pipelines/benchmark.py) at the model's own held-out error (relight3d evaluate). Needs what make_desk.py needs.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from desk import variant
from desk.settings import SCENES

DESK = Path(__file__).resolve().parents[1] / "data" / "desk"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, nargs="+", default=[1, 4, 16, 64])
    options = parser.parse_args()
    print(f"variant {variant.choose('auto')}")  # modules of desk define classes of that variant

    from desk import checks, folder
    from desk.lights import place_lamps
    from desk.passes import render_chunk
    from desk.run import plan_passes, plan_shots
    from desk.shapes import read_ply

    settings, mesh = SCENES["desk"], DESK / "mesh.ply"
    lamps = place_lamps(settings.lamps, settings.walls, np.concatenate([part.points for part in read_ply(mesh)]))
    shot = next(s for s in plan_shots(settings, *lamps) if s.split == "test" and s.group == "one_light")
    passes = plan_passes(settings, [shot])
    wanted = folder.read_exr(DESK / "images" / f"{shot.name}.exr")
    white = float(np.percentile(wanted, 99.5))
    with tempfile.TemporaryDirectory() as work:
        for samples in [options.samples[0], *options.samples]:  # the first turn compiles
            start, start_cores = time.perf_counter(), time.process_time()
            image = np.zeros_like(wanted)
            for one in passes.values():
                color = 1.0 if one.lamp is None else np.array(shot.lamps[0][1])
                image += render_chunk(settings, mesh, one, Path(work), samples, 0)[..., :3] * color
            seconds, cores = time.perf_counter() - start, time.process_time() - start_cores
            error = checks.psnr_db(image, wanted, white, np.ones(wanted.shape[:2], bool))
            print(f"{samples:5d} samples: {seconds:7.2f} s, {cores:7.2f} s of the cores, {error:.1f} dB")


if __name__ == "__main__":
    main()

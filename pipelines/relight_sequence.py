"""A film of a recovered scene: a light goes once round it while the camera stays, then as numbered frames too.

    python pipelines/relight_sequence.py output/desk/model.relight --output output/desk/round

The frames go on where an earlier run stopped; the lights' path is left beside them for `relight3d render`.
"""

from pathlib import Path
from typing import Annotated

import tyro
from start import start

from relight3d.commands.light_path import round_trip
from relight3d.commands.render import Render
from relight3d.io.files import write_json
from relight3d.io.model_file import load_model

MODEL, OUTPUT = Path("output/desk/model.relight"), Path("output/desk/round")


def main(
    model: Annotated[Path, tyro.conf.Positional] = MODEL, output: Path = OUTPUT, num_frames: int = 96, fps: float = 24.0
) -> None:
    lights = output / "lights.json"
    write_json(lights, [[light.to_dict()] for light in round_trip(load_model(model), num_frames)])
    Render(model=model, lights=lights, output=str(output / "frames")).run()
    Render(model=model, lights=lights, output=str(output / "film.mp4"), fps=fps).run()


if __name__ == "__main__":
    start(main, __doc__)

"""What the tests of all commands share."""

import json
import subprocess
from pathlib import Path

import imageio_ffmpeg
import numpy as np

TINY = Path(__file__).parents[2] / "data" / "desk_tiny"
SIZE = (64, 48)
QUICK = [
    "--mesh.target-faces",
    "2000",
    "--num-rounds",
    "0",
    "--num-alternations",
    "2",
]  # a model good enough to test with


def light(x: float, y: float = -0.4, power: float = 3.0) -> list[dict]:
    """One frame's lights as LIGHTS.json has them."""
    return [{"type": "directional", "to_light": [x, y, 0.9], "irradiance": power}]


def write(path: Path, value: object) -> Path:
    path.write_text(json.dumps(value))
    return path


def decoded(film: Path, size: tuple[int, int]) -> np.ndarray:
    """Every frame of a film, which must be of this size."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", film, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, check=True, capture_output=True).stdout
    return np.frombuffer(raw, np.uint8).reshape(-1, size[1], size[0], 3)


def assert_one_line(status: int, err: str, *words: str) -> None:
    """Exit 2 and one line on standard error that holds all the words."""
    assert status == 2, err
    assert err.startswith("relight3d: ") and err.count("\n") == 1 and err.endswith("\n"), err
    for word in words:
        assert word in err, f"{word!r} is not in {err!r}"

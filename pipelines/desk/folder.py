"""The files of a capture folder. Each is written whole beside its place and then moved there."""

import json
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import OpenEXR

from desk.lights import Lamp
from desk.settings import View


def settle(path: Path, write) -> None:
    """`write(temporary)`, then rename: a reader never sees half a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".writing_{path.name}")
    write(temporary)
    temporary.replace(path)


def write_exr(path: Path, pixels: np.ndarray) -> None:
    """Linear colour (or one channel), half-float, lossless. A single channel is float32: it holds metres."""
    is_color = pixels.ndim == 3
    held = np.ascontiguousarray(pixels, np.float16 if is_color else np.float32)
    header = {
        "compression": OpenEXR.PIZ_COMPRESSION if is_color else OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
    }
    settle(path, lambda temporary: OpenEXR.File(header, {"RGB" if is_color else "Z": held}).write(str(temporary)))


def read_exr(path: Path) -> np.ndarray:
    with OpenEXR.File(str(path)) as file:
        channels = file.channels()
        return np.array(channels["RGB" if "RGB" in channels else "Z"].pixels, np.float32)


def write_png(path: Path, pixels: np.ndarray) -> None:
    settle(path, lambda temporary: iio.imwrite(temporary, pixels, extension=".png"))


def write_json(path: Path, content: dict | list) -> None:
    settle(path, lambda temporary: temporary.write_text(json.dumps(content, indent=1) + "\n"))


def light(lamp: Lamp, color: np.ndarray) -> dict:
    """A light of transforms.json; `color` is its irradiance, or its intensity."""
    color = [round(float(c), 6) for c in color]
    if lamp.position is None:
        return {"type": "directional", "to_light": list(lamp.to_light), "irradiance": color}
    return {"type": "point", "position": list(lamp.position), "intensity": color}


def transforms(view: View, frames: list[dict]) -> dict:
    return {
        "w": view.width_px, "h": view.height_px, "fl_x": view.focal_px, "fl_y": view.focal_px,
        "cx": view.width_px / 2, "cy": view.height_px / 2, "color_space": "linear", "unit": "metre",
        "mesh_path": "mesh.ply", "frames": frames,
    }  # fmt: skip

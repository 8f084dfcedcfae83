"""A capture folder of a few tiny pixels, whole and valid, for tests to spoil one thing of."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight3d.camera import look_at
from relight3d.io.capture import load_capture
from relight3d.io.images import write_png
from relight3d.io.meshes import write_mesh
from relight3d.records import Capture, TriangleMesh

WIDTH, HEIGHT = 6, 4
SQUARE = TriangleMesh(
    np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float64),
    np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
)


@dataclass
class CaptureFolder:
    """The folder and the content of its transforms.json, which `load` writes first."""

    path: Path
    top: dict

    def load(self) -> Capture:
        (self.path / "transforms.json").write_text(json.dumps(self.top))
        return load_capture(self.path)


def make_capture_folder(path: Path) -> CaptureFolder:
    """Three training frames of one camera under one light each, a mask, a square, and a test frame from elsewhere."""
    random = np.random.default_rng(7)
    frames = []
    for index in range(4):
        is_test = index == 3
        write_png(
            path / f"images/{index}.png", random.integers(1, 60000, (HEIGHT, WIDTH, 3), dtype=np.uint16, endpoint=True)
        )
        eye = (1.0, -3.0, 3.0) if is_test else (0.0, -3.0, 3.0)
        frames.append(
            {
                "file_path": f"images/{index}.png",
                "mask_path": "mask.png",
                "split": "test" if is_test else "train",
                "transform_matrix": look_at(np.array(eye), np.zeros(3)).tolist(),
                "lights": [{"type": "directional", "to_light": [0.1 * index, 0.2, 1.0], "irradiance": [3, 2, 1]}],
            }
        )
    mask = np.full((HEIGHT, WIDTH), 255, dtype=np.uint8)
    mask[0, 0] = 0
    write_png(path / "mask.png", mask)
    write_mesh(path / "mesh.ply", SQUARE)
    lens = {"w": WIDTH, "h": HEIGHT, "fl_x": 6.0, "fl_y": 6.5, "cx": 3.25, "cy": 2.0, "k1": 0.01}
    return CaptureFolder(path, lens | {"color_space": "linear", "mesh_path": "mesh.ply", "unit": "m", "frames": frames})

"""Held-out photographs at the captured viewpoint, read once, and the truth beside them."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight3d.evaluate.baselines import fit_baseline
from relight3d.io.capture import read_photograph
from relight3d.io.images import read_image
from relight3d.lights import Light
from relight3d.records import Capture, RelightModel


@dataclass(frozen=True, eq=False)
class Shot:
    """One held-out photograph, its mask being where the mesh is seen too."""

    name: str
    lights: tuple[Light, ...]
    wanted: np.ndarray
    mask: np.ndarray


@dataclass(frozen=True, eq=False)
class Truth:
    """What the demo capture's makers put in: per pixel the surface (255: none) and its albedo; per surface its kind."""

    label: np.ndarray
    albedo: np.ndarray
    surfaces: dict[int, dict]

    def of_kind(self, kind: str) -> np.ndarray:
        """True for the pixels of the surfaces of one kind."""
        return np.isin(self.label, [key for key, each in self.surfaces.items() if each["kind"] == kind])


def shots_of(capture: Capture, model: RelightModel) -> list[Shot]:
    """The photographs of split "test" at the captured viewpoint."""
    is_hit = np.zeros((capture.camera.height, capture.camera.width), bool)
    is_hit.ravel()[model.pixels.points.pixel] = True
    shots = []
    for photograph in capture.split("test"):
        if photograph.camera.same_as(capture.camera):
            picture, valid = read_photograph(capture, photograph)
            shots.append(Shot(photograph.name, photograph.lights, picture, valid & is_hit))
    return shots


def baseline_frames(
    name: str, capture: Capture, model: RelightModel, shots: list[Shot], asked: np.ndarray
) -> list[np.ndarray]:
    """What an interpolation of the training photographs makes of each shot, at the pixels that are asked for."""
    training = capture.split("train")
    pictures = [read_photograph(capture, photograph) for photograph in training]
    radiance = np.stack([np.where(valid[..., None], rgb, np.float32(np.nan))[asked] for rgb, valid in pictures])
    fitted = fit_baseline(name, [photograph.lights for photograph in training], radiance, model.mesh.center)
    frames = []
    for shot in shots:
        frame = np.zeros_like(shot.wanted)
        frame[asked] = fitted.predict(shot.lights)
        frames.append(frame)
    return frames


def truth_of(folder: Path) -> Truth | None:
    """The truth of a capture that has one."""
    truth = folder / "truth"
    if not (truth / "surfaces.json").is_file():
        return None
    given = json.loads((truth / "surfaces.json").read_text("utf-8"))
    label = np.asarray(read_label(truth / "surface_label.png"))
    return Truth(label, read_image(truth / "albedo.exr")[0], {int(key): each for key, each in given.items()})


def read_label(path: Path) -> np.ndarray:
    """An 8-bit picture of numbers, as they are."""
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image)

"""What goes wrong with real captures, one fault a function: each gives a new capture and leaves the old one alone.

Faults of the photographs strike the training photographs only, so that the held-out ones keep telling the truth.
White is the 99.5th percentile of the training values.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float32

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.io.capture import read_photograph
from relight3d.lights import DirectionalLight, Light
from relight3d.maths.color import exposure_of
from relight3d.records import Capture, Photograph
from relight3d.recover.registration import moved

Image = Float32[np.ndarray, "height width 3"]


def with_noise(capture: Capture, read: float, shot: float = 0.0, seed: int = 0) -> Capture:
    """Sensor noise: a standard deviation of `read` whites everywhere, plus one of `shot` whites at white that falls
    with the square root of the value."""
    rng, white = np.random.default_rng(seed), _white(capture)

    def add(image: Image) -> np.ndarray:
        variance = read**2 + shot**2 * np.maximum(image, 0.0) / white
        return image + white * np.sqrt(variance) * rng.standard_normal(image.shape)

    return _with_images(capture, add)


def with_saturation(capture: Capture, level: float = 1.0) -> Capture:
    """A sensor that is full at `level` whites."""
    limit = level * _white(capture)
    return _with_images(capture, lambda image: np.minimum(image, limit))


def with_quantisation(capture: Capture, num_bits: int) -> Capture:
    """Linear integers of `num_bits`, the highest of them white; what is brighter is cut."""
    step = _white(capture) / (2**num_bits - 1)
    return _with_images(capture, lambda image: np.clip(np.rint(image / step), 0, 2**num_bits - 1) * step)


def with_blocked_light(capture: Capture, index: int, share: float = 0.5) -> Capture:
    """Something outside the mesh keeps all light from the picture's left `share` in one training photograph."""

    def block(image: Image) -> np.ndarray:
        blocked = image.copy()
        blocked[:, : round(share * image.shape[1])] = 0.0
        return blocked

    return _with_images(capture, block, only=_training_name(capture, index))


def with_wrong_light(capture: Capture, index: int, angle_deg: float, seed: int = 0) -> Capture:
    """One training photograph whose lights stand elsewhere than its file says."""
    rng, name = np.random.default_rng(seed), _training_name(capture, index)
    return _with_lights(capture, lambda light: _turned(light, capture, angle_deg, rng), only=name)


def with_light_error(capture: Capture, angle_deg: float, seed: int = 0) -> Capture:
    """Every training light off by about `angle_deg`, as a chrome ball gives them."""
    rng = np.random.default_rng(seed)
    return _with_lights(capture, lambda light: _turned(light, capture, angle_deg * abs(rng.standard_normal()), rng))


def with_few_lights(capture: Capture, num: int) -> Capture:
    """The first `num` training photographs, and all of the others."""
    kept = {photograph.name for photograph in capture.split("train")[:num]}
    photographs = [p for p in capture.photographs if p.split != "train" or p.name in kept]
    return replace(capture, photographs=tuple(photographs))


def with_rough_mesh(capture: Capture, size: float, seed: int = 0) -> Capture:
    """Vertices off by a standard deviation of `size` (the capture's unit); those at one place move together."""
    places, index = np.unique(capture.mesh.vertices, axis=0, return_inverse=True)
    error = size * np.random.default_rng(seed).standard_normal(places.shape)
    return replace(capture, mesh=replace(capture.mesh, vertices=capture.mesh.vertices + error[index.ravel()]))


def with_misplaced_mesh(capture: Capture, right_px: float, down_px: float, turn_deg: float = 0.0) -> Capture:
    """A mesh whose place the photographs show so far to the right and below, and turned in the picture (clockwise)."""
    camera = capture.camera
    length = float(np.linalg.norm(capture.mesh.vertices.mean(axis=0) - camera.center))
    shift = np.array([-right_px / camera.fx, down_px / camera.fy, 0.0]) * length
    turn = np.array([0.0, 0.0, np.deg2rad(turn_deg)])
    return replace(capture, mesh=moved(capture.mesh, camera, np.concatenate([turn, shift])))


def with_far_origin(capture: Capture, offset: tuple[float, float, float]) -> Capture:
    """Everything moved, as in a georeferenced model: mesh, cameras and lights. Nothing else should change."""
    move = np.asarray(offset, np.float64)
    cameras: dict[int, Camera] = {}  # photographs that shared a camera go on sharing it

    def moved(photograph: Photograph) -> Photograph:
        camera = cameras.setdefault(id(photograph.camera), photograph.camera.translated(move))
        return replace(photograph, camera=camera, lights=tuple(light.translated(move) for light in photograph.lights))

    return replace(
        capture,
        camera=cameras.setdefault(id(capture.camera), capture.camera.translated(move)),
        photographs=tuple(moved(photograph) for photograph in capture.photographs),
        mesh=replace(capture.mesh, vertices=capture.mesh.vertices + move),
    )


def _with_images(capture: Capture, edit: Callable[[Image], np.ndarray], only: str | None = None) -> Capture:
    """The capture with edited training photographs, held in memory."""

    def edited(photograph: Photograph) -> Photograph:
        if photograph.split != "train" or only not in (None, photograph.name):
            return photograph
        radiance, is_valid = read_photograph(capture, photograph)
        pixels = np.ascontiguousarray(edit(radiance), np.float32)
        return replace(photograph, pixels=pixels, is_valid=is_valid, image_path=None, mask_path=None)

    return replace(capture, photographs=tuple(edited(photograph) for photograph in capture.photographs))


def _with_lights(capture: Capture, edit: Callable[[Light], Light], only: str | None = None) -> Capture:
    def edited(photograph: Photograph) -> Photograph:
        if photograph.split != "train" or only not in (None, photograph.name):
            return photograph
        return replace(photograph, lights=tuple(edit(light) for light in photograph.lights))

    return replace(capture, photographs=tuple(edited(photograph) for photograph in capture.photographs))


def _turned(light: Light, capture: Capture, angle_deg: float, rng: np.random.Generator) -> Light:
    """The light moved to `angle_deg` from where it stood, seen from the mesh's middle, to a random side."""
    vertices = capture.mesh.vertices
    center = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    is_far = isinstance(light, DirectionalLight)
    toward = np.asarray(light.to_light) if is_far else np.asarray(light.position) - center
    side = np.cross(toward, rng.standard_normal(3))
    side *= np.linalg.norm(toward) / np.linalg.norm(side)
    angle = np.deg2rad(angle_deg)
    turned = np.cos(angle) * toward + np.sin(angle) * side
    return replace(light, to_light=tuple(turned)) if is_far else light.translated(turned - toward)


def _white(capture: Capture) -> float:
    images = [read_photograph(capture, photograph) for photograph in capture.split("train")]
    return 1.0 / exposure_of(np.concatenate([image[is_valid].ravel() for image, is_valid in images]))


def _training_name(capture: Capture, index: int) -> str:
    training = capture.split("train")
    if not 0 <= index < len(training):
        raise InputError("index", index, f"a training photograph, 0 to {len(training) - 1}")
    return training[index].name

"""Captures and cameras made smaller, for a study."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float32

from relight3d.camera import Camera
from relight3d.io.capture import read_photograph
from relight3d.records import Capture, Photograph


def with_photographs(capture: Capture, num: int | None) -> Capture:
    """The capture with so many of its lit training photographs, evenly through them; lights-off frames stay."""
    if num is None:
        return capture
    training = [p for p in capture.split("train") if p.lights]
    kept = {training[k].name for k in np.linspace(0, len(training) - 1, min(num, len(training))).round().astype(int)}
    photographs = tuple(p for p in capture.photographs if p.split != "train" or not p.lights or p.name in kept)
    return replace(capture, photographs=photographs)


def halved(capture: Capture) -> Capture:
    """The capture at half its resolution, in memory: means of 2 x 2 valid pixels. Odd last rows and columns go."""
    cameras: dict[int, Camera] = {}

    def half(camera: Camera) -> Camera:
        even = replace(camera, width=camera.width // 2 * 2, height=camera.height // 2 * 2)
        return cameras.setdefault(id(camera), even.resized(even.width // 2, even.height // 2))

    def shrunk(photograph: Photograph) -> Photograph:
        picture, valid = read_photograph(capture, photograph)
        height, width = valid.shape[0] // 2, valid.shape[1] // 2
        blocks = picture[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
        whole = valid[: 2 * height, : 2 * width].reshape(height, 2, width, 2).all(axis=(1, 3))
        return replace(
            photograph, camera=half(photograph.camera), image_path=None, mask_path=None, pixels=blocks, is_valid=whole
        )

    photographs = tuple(shrunk(p) for p in capture.photographs)
    return replace(capture, camera=half(capture.camera), photographs=photographs)


def resized(camera: Camera, resolution: float) -> Camera:
    """The camera with so many times its pixels a side; at least one."""
    if resolution == 1.0:
        return camera
    return camera.resized(max(1, round(camera.width * resolution)), max(1, round(camera.height * resolution)))


def brought_to(
    radiance: Float32[np.ndarray, "any_height any_width 3"], shape: tuple[int, int]
) -> Float32[np.ndarray, "height width 3"]:
    """The frame at another size, bilinear between pixel centres."""
    if radiance.shape[:2] == shape:
        return radiance
    from scipy.ndimage import map_coordinates

    rows = (np.arange(shape[0]) + 0.5) * radiance.shape[0] / shape[0] - 0.5
    columns = (np.arange(shape[1]) + 0.5) * radiance.shape[1] / shape[1] - 0.5
    grid = np.meshgrid(rows, columns, indexing="ij")
    channels = [map_coordinates(radiance[..., c], grid, order=1, mode="nearest") for c in range(3)]
    return np.ascontiguousarray(np.stack(channels, axis=-1), np.float32)

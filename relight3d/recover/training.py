"""The training photographs at the points that the camera sees."""

from dataclasses import dataclass

import numpy as np

from relight3d.errors import InputError
from relight3d.maths.color import exposure_of
from relight3d.records import Capture, PatchMesh, ShadingPoints


@dataclass(frozen=True, eq=False)
class Training:
    """The training photographs at the points that the camera sees."""

    radiance: np.ndarray  # photo x point x 3
    is_valid: np.ndarray  # photo x point
    lights: tuple  # of each photograph, in centred coordinates
    exposure: float


def read_training(capture: Capture, mesh: PatchMesh, points: ShadingPoints) -> Training:
    """Read the training photographs, one at a time: 12 bytes a point and photograph stay in memory, and 1 for the mask."""
    from relight3d.io.capture import read_photograph

    training = capture.split("train")
    if not training:
        raise InputError("transforms.json frames", 'none of split "train"', "at least one training photograph")
    if len(points) == 0:
        hint = "check transform_matrix (world_from_camera, OpenGL axes) and the mesh's unit"
        raise InputError("mesh_path", "a mesh that no pixel sees", "a mesh in front of the camera", hint)
    radiance = np.empty((len(training), len(points), 3), np.float32)
    is_valid = np.empty((len(training), len(points)), bool)
    for index, photograph in enumerate(training):
        picture, valid = read_photograph(capture, photograph)
        radiance[index] = picture.reshape(-1, 3)[points.pixel]
        is_valid[index] = valid.ravel()[points.pixel] & ~is_saturated(picture, valid).ravel()[points.pixel]
    if not is_valid.any():
        raise InputError("photographs", "no valid pixel on the mesh", "a mask that leaves some of the mesh")
    radiance[~is_valid] = 0.0
    # A lamp without power is off, as for a capture that was read from a folder.
    lights = tuple(tuple(x.translated(-mesh.center) for x in p.lights if x.power.any()) for p in training)
    exposure = exposure_of(radiance[is_valid])
    return Training(*average_repeats(radiance, is_valid, lights), exposure)


def average_repeats(radiance: np.ndarray, is_valid: np.ndarray, lights: tuple) -> tuple[np.ndarray, np.ndarray, tuple]:
    """Photographs under the same lights made one: less noise, and no fit is tested on a copy of what it was fitted to.

    Leaving a photograph out says nothing while its twin stays in: every effect would seem to earn its place.
    """
    groups = under_same_lights(lights)
    if len(groups) == len(lights):
        return radiance, is_valid, lights
    count = np.stack([is_valid[g].sum(axis=0) for g in groups])
    total = np.stack([radiance[g].sum(axis=0) for g in groups])
    mean = (total / np.maximum(count, 1)[..., None]).astype(np.float32)
    return mean, count > 0, tuple(lights[g[0]] for g in groups)


def under_same_lights(lights: tuple) -> list[list[int]]:
    """Which photographs have the same lights: their numbers, in the order of the first of each group."""
    keys = [repr([light.to_dict() for light in each]) for each in lights]
    return [[i for i, key in enumerate(keys) if key == one] for one in dict.fromkeys(keys)]


def is_saturated(picture: np.ndarray, is_valid: np.ndarray) -> np.ndarray:
    """Pixels at a sensor's limit: a value that none exceeds and that several share exactly."""
    top = picture.max()
    at_top = (picture >= top * 0.9995) & (picture > 0)
    several = int((picture == top).any(axis=2).sum()) > 3
    # A constant picture has no limit to be at.
    return at_top.any(axis=2) if several and (picture[is_valid] < top).any() else np.zeros(picture.shape[:2], bool)

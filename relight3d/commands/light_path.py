"""A path for a light: once round the scene."""

import numpy as np

from relight3d.errors import InputError
from relight3d.lights import Light, light_from_dict
from relight3d.records import RelightModel

_TURNED = ("to_light", "position", "direction", "edge_u", "edge_v")


def round_trip(model: RelightModel, num: int) -> list[Light]:
    """`num` places of a light of the capture, carried once round the mean direction of all of them.

    The light is the one whose angle to that axis is the median, neither steep nor grazing. Raises InputError for a
    model without lights.
    """
    lights = [each[0].translated(-model.mesh.center) for each in model.lights if each]
    if not lights:
        raise InputError("model", "no photograph with a light", "one or more")
    directions = np.array([light.incident(np.zeros((1, 3))).to_light[0] for light in lights])
    axis = directions.mean(axis=0)
    # Lights all around have no mean direction: the world's z then.
    axis = axis / np.linalg.norm(axis) if np.linalg.norm(axis) > 1e-3 else np.array([0.0, 0.0, 1.0])
    start = lights[int(np.argsort(directions @ axis)[len(lights) // 2])]
    angles = 2 * np.pi * np.arange(num) / num
    return [_turned(start, _rotation(axis, angle)).translated(model.mesh.center) for angle in angles]


def _turned(light: Light, rotation: np.ndarray) -> Light:
    entry = light.to_dict()
    return light_from_dict(entry | {key: rotation @ entry[key] for key in _TURNED if key in entry})


def _rotation(axis: np.ndarray, angle_rad: float) -> np.ndarray:
    """Rodrigues' formula, about a unit axis."""
    cross = np.cross(np.eye(3), -axis)
    return np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross

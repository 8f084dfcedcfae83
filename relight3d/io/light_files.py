"""Lights as transforms.json and LIGHTS.json give them."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from relight3d.errors import InputError
from relight3d.io.json_fields import read_json
from relight3d.lights import LIGHT_TYPES, Light, light_from_dict

_VECTORS, _COLORS = ("to_light", "position", "direction", "edge_u", "edge_v"), ("irradiance", "intensity")
_MOST = 1e30  # beyond it squares overflow float64 before anybody notices


def light_of(entry: object, field: str) -> Light:
    """One light. Raises InputError naming `field` and the key at fault, NaN and numbers beyond 1e30 included."""
    if not isinstance(entry, dict):
        return light_from_dict(entry, field)  # which refuses it
    kind = entry.get("type")
    if not isinstance(kind, str) or kind not in LIGHT_TYPES:
        raise InputError(f"{field}.type", "nothing" if kind is None else repr(kind), f"one of {', '.join(LIGHT_TYPES)}")
    arguments = {argument.name: argument for argument in dataclasses.fields(LIGHT_TYPES[kind])}
    values: dict[str, Any] = {"type": kind}
    for key, value in entry.items():
        if key not in (*arguments, "type"):
            raise InputError(f"{field}.{key}", repr(value), f"a key of a {kind} light: {', '.join(arguments)}")
    for key, argument in arguments.items():
        if key in entry:
            values[key] = _argument(key, entry[key], field)
        elif argument.default is dataclasses.MISSING:
            raise InputError(f"{field}.{key}", "nothing", _expected(key))
    return light_from_dict(values, field)


def lights_of(entry: dict, prefix: str, required: bool) -> tuple[Light, ...]:
    """The lights of one frame that are on, `lights` or NRHints' `pl_pos` and `pl_intensity`.

    A lamp of power 0 is off and left out: the frame is then one of ambient light, as with `[]`.
    Raises InputError naming the light and key at fault, or where `required` and the frame says nothing of lights.
    """
    if "lights" not in entry and "pl_pos" in entry:
        point = {"type": "point", "position": entry["pl_pos"], "intensity": entry.get("pl_intensity")}
        if "pl_intensity" not in entry:
            raise InputError(f"{prefix}pl_intensity", "nothing", "the lamp's intensity, [r, g, b]")
        return _shining(light_of(point, f"{prefix}pl_pos, pl_intensity"))
    lights = entry.get("lights", None if required else [])
    if not isinstance(lights, list):
        got = "nothing" if lights is None else repr(lights)
        raise InputError(f"{prefix}lights", got, "a list of lights", "[] for a photograph with all lights off")
    return _shining(*(light_of(light, f"{prefix}lights[{index}]") for index, light in enumerate(lights)))


def read_lights(path: str | Path) -> tuple[list[list[Light]], bool]:
    """The lights of LIGHTS.json, frame by frame, and whether it is a sequence (a list of lists).

    Raises InputError naming the file, the light and the key at fault.
    """
    path = Path(path)
    value = read_json(path)
    if not isinstance(value, list):
        raise InputError(path.name, repr(value), 'a list of lights, [{"type": ...}, ...], or a list of such lists')
    is_sequence = bool(value) and all(isinstance(entry, list) for entry in value)
    if not is_sequence:
        return [[light_of(entry, f"{path.name} [{i}]") for i, entry in enumerate(value)]], False
    return [
        [light_of(entry, f"{path.name} [{i}][{j}]") for j, entry in enumerate(lights)] for i, lights in enumerate(value)
    ], True


def _shining(*lights: Light) -> tuple[Light, ...]:
    # The fits divide a photograph by what its lights give.
    return tuple(light for light in lights if np.any(light.power > 0))


def _argument(key: str, value: object, field: str) -> float | tuple[float, ...]:
    """A light's argument: three floats, of one number too where a colour may be grey, or one float."""
    if key in _COLORS and not isinstance(value, list):
        value = [value] * 3
    numbers: list[Any] = value if isinstance(value, list) else [value]
    is_vector = key in _COLORS + _VECTORS
    if len(numbers) != (3 if is_vector else 1) or not all(_is_number(part) for part in numbers):
        raise InputError(f"{field}.{key}", repr(value), _expected(key))
    floats = tuple(float(part) for part in numbers)
    return floats if is_vector else floats[0]


def _expected(key: str) -> str:
    return "three finite numbers" if key in _COLORS + _VECTORS else "a finite number"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _MOST  # False for NaN

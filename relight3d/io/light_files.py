"""Lights as transforms.json and LIGHTS.json give them."""

import dataclasses
from pathlib import Path

from relight3d.errors import InputError
from relight3d.io.json_fields import read_json
from relight3d.lights import LIGHT_TYPES, Light, light_from_dict

_MOST = 1e30  # beyond it squares overflow float64 before anybody notices


def light_of(entry: object, field: str) -> Light:
    """One light. Raises InputError naming `field` and the key at fault, NaN and numbers beyond 1e30 included."""
    kind = entry.get("type") if isinstance(entry, dict) else None
    if isinstance(entry, dict) and not isinstance(kind, str):
        raise InputError(f"{field}.type", repr(kind), f"one of {', '.join(LIGHT_TYPES)}")
    if isinstance(entry, dict) and kind in LIGHT_TYPES:
        for key in (known.name for known in dataclasses.fields(LIGHT_TYPES[kind])):
            value = entry.get(key, 0.0)
            if not all(_is_number(part) for part in (value if isinstance(value, list) else [value])):
                raise InputError(f"{field}.{key}", repr(value), "finite numbers")
    return light_from_dict(entry, field)


def lights_of(entry: dict, prefix: str, required: bool) -> tuple[Light, ...]:
    """The lights of one frame, `lights` or NRHints' `pl_pos` and `pl_intensity`.

    Raises InputError naming the light and key at fault, or where `required` and the frame says nothing of lights.
    """
    if "lights" not in entry and "pl_pos" in entry:
        point = {"type": "point", "position": entry["pl_pos"], "intensity": entry.get("pl_intensity")}
        if "pl_intensity" not in entry:
            raise InputError(f"{prefix}pl_intensity", "nothing", "the lamp's intensity, [r, g, b]")
        return (light_of(point, f"{prefix}pl_pos, pl_intensity"),)
    lights = entry.get("lights", None if required else [])
    if not isinstance(lights, list):
        got = "nothing" if lights is None else repr(lights)
        raise InputError(f"{prefix}lights", got, "a list of lights", "[] for a photograph with all lights off")
    return tuple(light_of(light, f"{prefix}lights[{index}]") for index, light in enumerate(lights))


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


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _MOST  # False for NaN

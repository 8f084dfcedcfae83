"""Values out of JSON, each checked where it is read, so that an error names the file and the field.

A `prefix` is what stands before a key in an error: "transforms.json " at the top, "transforms.json frames[3]." below.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from relight3d.errors import InputError
from relight3d.io.files import read_bytes


def read_json(path: Path, field: str = "") -> Any:
    """What a JSON file holds. Raises InputError, under `field` or the path, where it is missing or no JSON."""
    data = read_bytes(path, field)
    try:
        return json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:  # ValueError: syntax, or bytes that are not UTF-8
        raise InputError(field or str(path), f"no valid JSON ({error})", "a JSON file") from error


def json_object(value: object, field: str) -> dict[str, Any]:
    """The value, if it is an object with a key or more. Raises InputError otherwise."""
    if not isinstance(value, dict) or not value:
        raise InputError(field, value, "an object with keys, { ... }")
    return value


def number(
    entry: dict, key: str, prefix: str, default: float | None = None, above: float = -1e30, most: float = 1e30
) -> float:
    """A number above `above` and at most `most`. Raises InputError where it is not one, or missing without default."""
    value = entry.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not above < value <= most:
        limits = "" if above <= -1e30 else f" above {above:g}" + (f" and at most {most:g}" if most < 1e30 else "")
        raise InputError(f"{prefix}{key}", shown(entry, key), f"a number{limits}")
    return float(value)


def text(entry: dict, key: str, prefix: str, default: str | None = None) -> str:
    """A string. Raises InputError where it is missing (and has no default), empty without need, or not one."""
    value = entry.get(key, default)
    if not isinstance(value, str) or (value == "" and default is None):
        raise InputError(f"{prefix}{key}", shown(entry, key), "text")
    return value


def matrix(entry: dict, key: str, prefix: str) -> Float64[np.ndarray, "4 4"]:
    """A 4x4 matrix, rows first, whose last row is 0 0 0 1. Raises InputError otherwise."""
    expected = "4 rows of 4 finite numbers, world_from_camera, the last row 0 0 0 1"
    try:
        value = np.asarray(entry.get(key), dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{prefix}{key}", shown(entry, key), expected) from error
    if value.shape != (4, 4) or not np.isfinite(value).all():
        raise InputError(f"{prefix}{key}", shown(entry, key), expected)
    if not np.allclose(value[3], (0, 0, 0, 1)):
        hint = "transpose it" if np.allclose(value[:, 3], (0, 0, 0, 1)) else ""
        raise InputError(f"{prefix}{key}", f"the last row {value[3].tolist()}", expected, hint)
    return value


def shown(entry: dict, key: str) -> object:
    """The value as an error shows it; "nothing" for a missing key."""
    return repr(entry[key]) if key in entry else "nothing"

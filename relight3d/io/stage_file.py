"""A stage's record in a file of its own, believed only while what it was made of is the same.

The records of the library as JSON, their arrays beside it, in an .npz. Nothing in a file can run code: only names of
this library's own records are followed.
"""

import dataclasses
import enum
import json
import logging
from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from relight3d.io.files import atomic_path, hash_of

Record = TypeVar("Record")
log = logging.getLogger("relight3d")
_LIBRARY = Path(__file__).parents[1]


def kept(path: str | Path, make: Callable[[], Record], *made_of: object) -> Record:
    """The record in the file if it was made of the same inputs by the same code; else `make()`, which is then kept.

    `made_of` are all records, options and paths that `make` uses. Raises TypeError for what hash_of cannot tell apart,
    and for a record that holds more than this library's records, arrays, numbers and text.
    """
    path, digest = Path(path), hash_of(library_hash(), *made_of)
    found = _read(path, digest)
    if found is not None:
        log.info("%s: as before", path.name)
        return found[0]
    record = make()
    arrays: dict[str, np.ndarray] = {}
    header = json.dumps({"made_of": digest, "record": _encode(record, arrays)}).encode()
    arrays["header"] = np.frombuffer(header, np.uint8)
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]
    return record


@cache
def library_hash() -> str:
    """Changes with any line of the library: a stage of other code is another stage."""
    return hash_of(*sorted(_LIBRARY.rglob("*.py")))


def _read(path: Path, digest: str) -> tuple[Any] | None:
    """The record, in a tuple because it may be None itself; None for a file that is missing, damaged or out of date."""
    try:
        with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            header = json.loads(file["header"].tobytes())
            return (_decode(header["record"], file),) if header["made_of"] == digest else None
    except Exception:  # what damaged bytes make numpy, zipfile and json raise has no common type
        return None


def _encode(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if value is None or isinstance(value, bool | str) or type(value) in (int, float):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        name = f"a{len(arrays)}"
        arrays[name] = value
        return {"array": name}
    if isinstance(value, enum.Enum):
        return {"enum": _name_of(type(value)), "member": value.name}
    if isinstance(value, np.generic) and value.dtype.kind in "biuf":
        return {"scalar": value.dtype.str, "value": value.item()}
    if isinstance(value, tuple | list):
        return {type(value).__name__: [_encode(item, arrays) for item in value]}
    if isinstance(value, Mapping):
        return {"mapping": [[_encode(key, arrays), _encode(item, arrays)] for key, item in value.items()]}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: _encode(getattr(value, field.name), arrays) for field in dataclasses.fields(value)}
        return {"dataclass": _name_of(type(value)), "fields": fields}
    raise TypeError(f"a stage's file cannot hold a {type(value).__name__}")


def _decode(value: Any, file: Mapping[str, np.ndarray]) -> Any:
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return file[value["array"]]
    if "enum" in value:
        return _type_of(value["enum"])[value["member"]]
    if "scalar" in value:
        return np.dtype(value["scalar"]).type(value["value"])
    if "tuple" in value:
        return tuple(_decode(item, file) for item in value["tuple"])
    if "list" in value:
        return [_decode(item, file) for item in value["list"]]
    if "mapping" in value:
        return {_decode(key, file): _decode(item, file) for key, item in value["mapping"]}
    # Without __init__: a light would normalise its direction once more, and move the last bit.
    record = object.__new__(_type_of(value["dataclass"]))
    for name, item in value["fields"].items():
        object.__setattr__(record, name, _decode(item, file))
    return record


def _name_of(kind: type) -> str:
    if kind.__module__.partition(".")[0] != "relight3d":
        raise TypeError(f"a stage's file cannot hold a {kind.__module__}.{kind.__qualname__}")
    return f"{kind.__module__}:{kind.__qualname__}"


def _type_of(name: str) -> Any:
    module, _, kind = name.partition(":")
    found = getattr(import_module(module), kind) if module.partition(".")[0] == "relight3d" else None
    if not (isinstance(found, type) and (dataclasses.is_dataclass(found) or issubclass(found, enum.Enum))):
        raise TypeError(f"{name} is no record of relight3d")
    return found

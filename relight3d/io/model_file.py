"""Model files: the frozen records of a RelightModel as JSON, their arrays beside it, in a zip.

The same model gives the same bytes: fixed dates, sorted names, no timings (`seconds` is left out, as is every field
declared `compare=False`). Nothing in a file can run code. Each array is a .npy, so `numpy.load("desk.relight")` opens
what it holds without this library, by names such as "pixels.albedo".
"""

import dataclasses
import io
import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from relight3d import camera, lights, records
from relight3d.errors import ModelFileError
from relight3d.io.files import atomic_path
from relight3d.records import RelightModel

FORMAT, VERSION = "relight3d model", 1
_HEADER = "model.json"
_EXPECTED = "a model file written by relight3d recover"
_MOST_EXPANSION = 1100  # deflate cannot do more: a size beyond that is a lie, and not allocated
_RECORD_TYPES: dict[str, Any] = {
    name: value
    for module in (camera, lights, records)
    for name, value in vars(module).items()
    if isinstance(value, type) and dataclasses.is_dataclass(value)
}


def save_model(model: RelightModel, path: str | Path) -> None:
    """Write a model file, whole or not at all. Raises InputError where the place cannot be written."""
    arrays: dict[str, np.ndarray] = {}
    header = {"format": FORMAT, "version": VERSION, "model": _encode(model, "", arrays)}
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as file:
        _add(file, _HEADER, json.dumps(header, indent=1, allow_nan=False).encode())
        for name in sorted(arrays):
            stream = io.BytesIO()
            np.lib.format.write_array(stream, arrays[name], version=(1, 0), allow_pickle=False)
            _add(file, f"{name}.npy", stream.getvalue())


def load_model(path: str | Path) -> RelightModel:
    """Read a model file. Raises ModelFileError for one missing, cut short, damaged, foreign or of another version."""
    path = Path(path)
    if not path.is_file():
        raise ModelFileError(str(path), "no such file", _EXPECTED)
    try:
        with zipfile.ZipFile(path) as file:
            model = _decode(_header(file, path)["model"], file)
        if not isinstance(model, RelightModel):
            raise TypeError(f"a {type(model).__name__} instead of a RelightModel")
        return model
    except ModelFileError:
        raise
    except Exception as error:  # what damaged bytes make zipfile, zlib, json and the records raise has no common type
        reason = str(error) or type(error).__name__
        got = f"a damaged or foreign file ({reason})"
        raise ModelFileError(str(path), got, _EXPECTED, "copy it again, or recover the capture again") from error


def _encode(value: Any, name: str, arrays: dict[str, np.ndarray]) -> Any:
    """The JSON for a value; arrays go to `arrays` under the dotted name. TypeError for what a model may not hold."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        while name in arrays:  # a mapping's key may hold a dot
            name += "_"
        arrays[name] = np.asarray(value, order="C")
        return {"$array": name}
    if isinstance(value, np.generic) and value.dtype.kind in "biuf":
        return {"$scalar": value.dtype.str, "value": _encode(value.item(), name, arrays)}
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else {"$float": repr(value)}
    inside = f"{name}." if name else ""
    if isinstance(value, tuple | list):
        items = [_encode(item, f"{inside}{index}", arrays) for index, item in enumerate(value)]
        return items if isinstance(value, list) else {"$tuple": items}
    if isinstance(value, Mapping):
        pairs = [[_encode(k, "", arrays), _encode(v, f"{inside}{k}", arrays)] for k, v in value.items()]
        return {"$mapping": pairs}
    if type(value).__name__ in _RECORD_TYPES:
        record_type: Any = type(value)
        kept = [field.name for field in dataclasses.fields(record_type) if field.compare]
        fields = {key: _encode(getattr(value, key), f"{inside}{key}", arrays) for key in kept}
        return {"$record": record_type.__name__} | fields
    raise TypeError(f"a model file cannot hold {name}, a {type(value).__name__}")


def _decode(value: Any, file: zipfile.ZipFile) -> Any:
    """The value that `_encode` made the JSON of."""
    if isinstance(value, list):
        return [_decode(item, file) for item in value]
    if not isinstance(value, dict):
        return value
    if "$array" in value:
        return _array(_member(file, f"{value['$array']}.npy"))
    if "$scalar" in value:
        return np.dtype(value["$scalar"]).type(_decode(value["value"], file))
    if "$float" in value:
        return float(value["$float"])
    if "$tuple" in value:
        return tuple(_decode(item, file) for item in value["$tuple"])
    if "$mapping" in value:
        return {_decode(key, file): _decode(item, file) for key, item in value["$mapping"]}
    fields = {key: _decode(item, file) for key, item in value.items() if key != "$record"}
    record = _RECORD_TYPES[value["$record"]](**fields)
    # Lights normalise their directions when they are made; once more would move the last bit.
    for key, item in fields.items():
        object.__setattr__(record, key, item)
    return record


def _header(file: zipfile.ZipFile, path: Path) -> dict[str, Any]:
    header = json.loads(_member(file, _HEADER)) if _HEADER in file.namelist() else {}
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ModelFileError(str(path), "a zip of another kind", _EXPECTED)
    if header.get("version") != VERSION:
        hint = "use the relight3d that wrote it, or recover the capture again"
        raise ModelFileError(str(path), f"a model of version {header.get('version')}", f"version {VERSION}", hint)
    return header


def _add(file: zipfile.ZipFile, name: str, data: bytes) -> None:
    entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
    entry.external_attr, entry.create_system = 0o644 << 16, 3
    # Photographic floats hardly shrink and would cost seconds: a piece out of the middle tells.
    piece = data[len(data) // 2 :][: 1 << 16]
    shrinks = len(zlib.compress(piece, 1)) < 0.8 * len(piece)
    file.writestr(entry, data, zipfile.ZIP_DEFLATED if shrinks else zipfile.ZIP_STORED, compresslevel=1)


def _member(file: zipfile.ZipFile, name: str) -> bytes:
    entry = file.getinfo(name)
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{name} is packed in a way no model file is")
    if entry.file_size > _MOST_EXPANSION * entry.compress_size + 1000:
        raise ValueError(f"{name} claims more bytes than it can hold")
    with file.open(entry) as stream:
        data = stream.read(entry.file_size + 1)
    if len(data) != entry.file_size:
        raise ValueError(f"{name} is cut short")
    return data


def _array(data: bytes) -> np.ndarray:
    stream = io.BytesIO(data)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("an array of another version of .npy")
    shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
    start = stream.tell()
    if dtype.kind not in "biuf" or math.prod(shape) * dtype.itemsize != len(data) - start:
        raise ValueError(f"an array whose header says {dtype} {shape}, and whose bytes say otherwise")
    return np.frombuffer(data, dtype, offset=start).reshape(shape).copy()

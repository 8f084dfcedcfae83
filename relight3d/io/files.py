"""Files that are never half written, and hashes that say whether a stage's inputs have changed."""

import dataclasses
import enum
import hashlib
import json
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from relight3d.errors import InputError


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary name beside `path`, renamed to it when the block ends and removed when the block raises.

    Missing folders are made, so that an hour's result is not lost to one; a link is written through. Raises
    InputError where the place cannot be written (a folder of that name, no permission, no space).
    """
    target = Path(path).resolve()
    temporary = target.with_name(f".{target.stem[:100]}-{secrets.token_hex(4)}{target.suffix}")
    try:
        if target.is_dir():
            raise InputError(str(path), "a folder", "the name of a file")
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        assert temporary.is_file(), f"nothing was written to {temporary}"
        _flush(temporary)
        os.replace(temporary, target)
    except OSError as error:
        raise InputError(str(path), error.strerror or error, "a place that can be written") from error
    finally:
        with suppress(OSError):  # renamed, or never made
            temporary.unlink()


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a whole file at once. Raises InputError where it cannot be written."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: str | Path, text: str) -> None:
    """Write a whole UTF-8 file at once. Raises InputError where it cannot be written."""
    write_bytes(path, text.encode("utf-8"))


def write_json(path: str | Path, value: object) -> None:
    """Write JSON for people: indented, and plain numbers only (no NaN)."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def read_bytes(path: str | Path, field: str = "", limit: int = -1) -> bytes:
    """A file's first `limit` bytes, or all. Raises InputError, under `field` or the path itself, if that fails."""
    try:
        with open(path, "rb") as file:
            return file.read(limit)
    except (OSError, ValueError) as error:  # ValueError: a name with a null character or a lone surrogate
        reason = getattr(error, "strerror", None) or "no valid file name"
        got = f"{path} ({reason})" if field else reason
        raise InputError(field or str(path), got, "a file that can be read") from error


def hash_of(*parts: object) -> str:
    """32 hex digits that change when any part does: records, options, arrays, numbers, text, paths' contents.

    Stable across processes and machines. A path stands for what is in the file, or in all files of the folder; a
    record's field that names a folder says where, not what, and is left out, as are fields declared `compare=False`
    (timings).
    Raises InputError for a missing path, TypeError for a part without content (a function, an open file).
    """
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        _feed(digest, part)
    return digest.hexdigest()


def _flush(path: Path) -> None:
    # Without this a power cut after the rename can leave the new name with the old disk's zeros in it.
    with open(path, "r+b") as file:
        os.fsync(file.fileno())


def _feed(digest: "hashlib.blake2b", part: object) -> None:
    """Add one part, each with its kind and length, so that ("ab", "c") and ("a", "bc") differ."""
    if part is None or isinstance(part, bool | int | float | complex | str | bytes | np.generic):
        value = part.item() if isinstance(part, np.generic) else part
        data = value if isinstance(value, bytes) else repr(value).encode("utf-8", "surrogatepass")
        _add(digest, type(value).__name__, data)
    elif isinstance(part, enum.Enum):
        _add(digest, type(part).__qualname__, part.name.encode())
    elif isinstance(part, np.ndarray):
        if part.dtype.hasobject:
            raise TypeError("hash_of: an array of objects has no stable content")
        _add(digest, f"array {part.dtype.str} {part.shape}", np.ascontiguousarray(part).tobytes())
    elif isinstance(part, Path):
        _feed_path(digest, part)
    elif isinstance(part, Mapping):
        _add(digest, "mapping", str(len(part)).encode())
        for key in sorted(part, key=repr):
            _feed(digest, key)
            _feed(digest, part[key])
    elif isinstance(part, tuple | list):
        _add(digest, "sequence", str(len(part)).encode())
        for item in part:
            _feed(digest, item)
    elif dataclasses.is_dataclass(part) and not isinstance(part, type):
        _feed_record(digest, part)
    else:
        raise TypeError(f"hash_of: a {type(part).__name__} has no stable content")


def _feed_record(digest: "hashlib.blake2b", record: object) -> None:
    _add(digest, "record", type(record).__qualname__.encode())
    for field in dataclasses.fields(record):  # pyright: ignore[reportArgumentType]
        value = getattr(record, field.name)
        if field.compare and not (isinstance(value, Path) and not value.is_file()):
            _add(digest, "field", field.name.encode())
            _feed(digest, value)


def _feed_path(digest: "hashlib.blake2b", path: Path) -> None:
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    for file in files:
        name = file.relative_to(path).as_posix() if file != path else ""
        _add(digest, f"file {name}", read_bytes(file))


def _add(digest: "hashlib.blake2b", kind: str, data: bytes) -> None:
    digest.update(f"{kind} {len(data)}\0".encode("utf-8", "surrogatepass"))
    digest.update(data)

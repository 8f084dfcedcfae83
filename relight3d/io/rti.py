"""Light directions of reflectance transformation imaging: .lp files, and the .dome files of RelightLab.

Both are lenient by tradition, so they are read leniently and what was odd is noted. Their axes are the camera's (x to
the right, y up, z towards the camera), and they say nothing of brightness: every light gets the irradiance under which
a white surface that faces it has radiance 1, so albedos are relative to the lamps.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.io.files import read_bytes
from relight3d.io.images import IMAGE_SUFFIXES
from relight3d.io.json_fields import json_object, read_json
from relight3d.lights import DirectionalLight, Light, PointLight

_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?")
_IRRADIANCE = (math.pi, math.pi, math.pi)


@dataclass(frozen=True, eq=False)
class ImportedLights:
    """The lights of each image, by file name, and lines for a person about what was odd."""

    lights: dict[str, tuple[Light, ...]]
    notes: tuple[str, ...] = ()


def import_lp(path: str | Path, images: str | Path | None = None, camera: Camera | None = None) -> ImportedLights:
    """Read an .lp file: a count, then a line `name x y z` for each image. `camera` turns the directions to the world.

    Decimal commas, quotes, Windows paths, blank and comment lines and vectors of any length are taken; a listed image
    that the folder `images` lacks is left out and noted. Raises InputError naming the line where no light can be read.
    """
    path = Path(path)
    rows, notes = _rows(path)
    lengths = np.array([np.linalg.norm(vector) for _, vector in rows])
    if (np.abs(lengths - 1.0) > 1e-2).any():
        notes.append(f"{path.name}: vectors of length {lengths.min():.3g} to {lengths.max():.3g} taken as directions")
    if any(vector[2] < 0 for _, vector in rows):
        notes.append(f"{path.name}: {sum(v[2] < 0 for _, v in rows)} lights come from behind the image")
    turn = np.eye(3) if camera is None else camera.world_from_camera[:3, :3]
    lights = {name: _directional(turn @ vector) for name, vector in rows}
    if len(lights) < len(rows):
        notes.append(f"{path.name}: an image is listed twice; the last line counts")
    return ImportedLights(lights, tuple(notes)) if images is None else _only_present(lights, notes, path, images)


def import_dome(
    path: str | Path,
    images: str | Path,
    camera: Camera | None = None,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    units_per_mm: float = 1.0,
) -> ImportedLights:
    """Read a .dome file: one light for each image of the folder, in the order of their names.

    Lamps at known places become point lights about `origin` (world; the dome's middle), others directional ones.
    Raises InputError where the file holds no lights, or another number of them than the folder has images.
    """
    path = Path(path)
    if not 0 < units_per_mm < math.inf:
        raise InputError("units_per_mm", units_per_mm, "a finite number above 0")
    dome = json_object(read_json(path), path.name)
    turn = np.eye(3) if camera is None else camera.world_from_camera[:3, :3]
    is_directional = dome.get("lightConfiguration", "directional") == "directional"
    key = "directions" if is_directional else "positions3d"
    places = [_xyz(entry, f"{path.name} {key}[{i}]") for i, entry in enumerate(_list(dome, key, path))]
    names = sorted(p.name for p in _images_of(images))
    if not places or len(places) != len(names):
        raise InputError(f"{path.name} {key}", f"{len(places)} lights", f"one for each of {len(names)} images")
    notes = []
    adjusted = [entry for entry in _list(dome, "ledAdjust", path) if isinstance(entry, dict)]
    if any(value != 1.0 for entry in adjusted for value in entry.values()):
        notes.append(f"{path.name}: ledAdjust is not applied; scale the lights' colours in transforms.json")
    if is_directional:
        return ImportedLights({n: _directional(turn @ p) for n, p in zip(names, places)}, tuple(notes))
    offsets = [turn @ place * units_per_mm for place in places]
    return ImportedLights({n: _point(np.asarray(origin), offset) for n, offset in zip(names, offsets)}, tuple(notes))


def _directional(to_light: np.ndarray) -> tuple[Light, ...]:
    x, y, z = to_light.tolist()
    return (DirectionalLight((x, y, z), _IRRADIANCE),)


def _point(origin: np.ndarray, offset: np.ndarray) -> tuple[Light, ...]:
    """A lamp whose irradiance at the origin is that of all directional ones."""
    x, y, z = (origin + offset).tolist()
    intensity = math.pi * float(offset @ offset)
    return (PointLight((x, y, z), (intensity, intensity, intensity)),)


def _rows(path: Path) -> tuple[list[tuple[str, np.ndarray]], list[str]]:
    """Image names (without folders) and vectors, and notes on the count."""
    lines = read_bytes(path).decode("utf-8-sig", "replace").splitlines()
    count, rows = None, []
    for line_number, raw in enumerate(lines, 1):
        line = raw.strip(" \t;,")
        if not line or line.startswith(("#", "//")):
            continue
        if count is None and not rows and line.isdecimal():
            count = int(line)
            continue
        name, vector = _row(line)
        if name is None or not vector.any():
            raise InputError(f"{path.name} line {line_number}", line, "an image's name and three numbers, not all 0")
        rows.append((name, vector))
    if not rows:
        raise InputError(str(path), "no light", "lines of an image's name and three numbers")
    notes = [] if count in (None, len(rows)) else [f"{path.name}: says {count} images and lists {len(rows)}"]
    return rows, notes


def _row(line: str) -> tuple[str | None, np.ndarray]:
    """Split a line at blanks, tabs or semicolons, else at commas: a comma may be decimal, so it comes last."""
    for separators in (r"[\s;]+", r"[\s;,]+"):
        parts = re.split(separators, line)
        numbers = [part.strip(",") for part in parts[-3:]]
        if len(parts) >= 4 and all(_NUMBER.fullmatch(part) for part in numbers):
            vector = np.array([float(part.replace(",", ".")) for part in numbers])
            name = line[: _start_of_numbers(line, separators)].strip(" \t;,").strip("\"'")
            if name and np.isfinite(vector).all():
                return name.replace("\\", "/").rpartition("/")[2], vector
    return None, np.zeros(3)


def _start_of_numbers(line: str, separators: str) -> int:
    """Where the third part from the end starts: names may hold blanks."""
    return list(re.finditer(separators, line))[-3].start()


def _list(dome: dict, key: str, path: Path) -> list:
    """The list at a key, empty where it is missing or null. Raises InputError for something else."""
    value = dome.get(key)
    if not isinstance(value, list | None):
        raise InputError(f"{path.name} {key}", repr(value), "a list")
    return value or []


def _xyz(entry: object, field: str) -> np.ndarray:
    values = [entry.get(axis) for axis in "xyz"] if isinstance(entry, dict) else entry
    try:
        vector = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not (np.abs(vector) < 1e30).all() or not vector.any():
        raise InputError(field, repr(entry), "x, y and z, not all 0")
    return vector


def _only_present(
    lights: dict[str, tuple[Light, ...]], notes: list[str], path: Path, images: str | Path
) -> ImportedLights:
    """The lights under the names that the files really have; InputError if the folder has none of them."""
    present = sorted(p.name for p in _images_of(images))
    # Lists are made on Windows, where IMG_1.JPG and img_1.jpg are one file, and often for another format.
    by_stem = {Path(name).stem.casefold(): name for name in present}
    by_name = {name.casefold(): name for name in present}
    found = {name: by_name.get(name.casefold()) or by_stem.get(Path(name).stem.casefold()) for name in lights}
    matched = {match: lights[name] for name, match in found.items() if match is not None}
    if not matched:
        raise InputError(
            path.name, f"{len(found)} images, none of them in {images}", "the folder of the images it lists"
        )
    missing = [name for name, match in found.items() if match is None]
    unlisted = [name for name in present if name not in matched]
    for what, names in (("listed but missing", missing), ("not listed, left out", unlisted)):
        if names:
            notes = [*notes, f"{path.name}: {what}: {', '.join(names)}"]
    return ImportedLights(matched, tuple(notes))


def _images_of(folder: str | Path) -> list[Path]:
    try:
        return [path for path in Path(folder).iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
    except OSError as error:
        raise InputError(str(folder), error.strerror or error, "a folder of images") from error

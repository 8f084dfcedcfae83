"""Cameras of a COLMAP sparse model, text or binary.

COLMAP's cameras look down +z with y down and its poses are camera_from_world; ours look down -z with y up and are
world_from_camera. Both put the centre of the first pixel at (0.5, 0.5).
"""

import struct
from pathlib import Path

import numpy as np

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.io.files import read_bytes

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
# The models k1 k2 p1 p2 can say, by COLMAP's number: name, and what each parameter is.
_MODELS = {
    0: ("SIMPLE_PINHOLE", ("f", "cx", "cy")),
    1: ("PINHOLE", ("fx", "fy", "cx", "cy")),
    2: ("SIMPLE_RADIAL", ("f", "cx", "cy", "k1")),
    3: ("RADIAL", ("f", "cx", "cy", "k1", "k2")),
    4: ("OPENCV", ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")),
}
_PARAMETERS = dict(_MODELS.values())
_UNDISTORT = "undistort with COLMAP's image_undistorter"


def read_colmap(folder: str | Path) -> dict[str, Camera]:
    """The camera of every registered image, by the image's name.

    Reads cameras.bin and images.bin, else cameras.txt and images.txt. Raises InputError naming the file and the line
    or entry for a missing, damaged or cut file, or a lens model beyond k1 k2 p1 p2.
    """
    folder = Path(folder)
    suffix = next((s for s in (".bin", ".txt") if (folder / f"cameras{s}").is_file()), None)
    if suffix is None:
        raise InputError(str(folder), "no cameras.bin or cameras.txt", "a COLMAP model, as sparse/0")
    read_lenses, read_poses = (_lenses_bin, _poses_bin) if suffix == ".bin" else (_lenses_txt, _poses_txt)
    lenses_path, poses_path = folder / f"cameras{suffix}", folder / f"images{suffix}"
    lenses = _parsed(lenses_path, read_lenses)
    cameras = {}
    for name, (lens, quaternion, translation) in _parsed(poses_path, read_poses).items():
        if lens not in lenses:
            raise InputError(f"{poses_path.name} {name}", f"camera {lens}", f"one of {sorted(lenses)}")
        cameras[name] = _camera(lenses[lens], quaternion, translation, f"{poses_path.name} {name}")
    if not cameras:
        raise InputError(str(poses_path), "no registered image", "one or more")
    return cameras


def _camera(lens: dict, quaternion: np.ndarray, translation: np.ndarray, field: str) -> Camera:
    length = np.linalg.norm(quaternion)
    if not np.isfinite([*quaternion, *translation]).all() or not 1e-6 < length < 1e6:
        raise InputError(field, f"quaternion {quaternion.tolist()}", "a finite rotation, qw qx qy qz, and translation")
    w, x, y, z = quaternion / length
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = rotation.T
    world_from_camera[:3, 3] = -rotation.T @ translation
    try:
        return Camera(**lens, world_from_camera=world_from_camera @ OPENGL_FROM_OPENCV)
    except InputError as error:
        raise InputError(f"{field} {error.field}", error.got, error.expected, error.hint) from None


def _lens(model: str | int, size: tuple[int, int], values: list[float]) -> dict:
    """Camera's arguments but for the pose."""
    name = model if isinstance(model, str) else _MODELS.get(model, (f"number {model}", ()))[0]
    if name not in _PARAMETERS:
        raise InputError("camera model", name, ", ".join(_PARAMETERS), _UNDISTORT)
    if len(values) != len(_PARAMETERS[name]) or not np.isfinite(values).all():
        raise InputError(f"camera of model {name}", values, f"finite {', '.join(_PARAMETERS[name])}")
    lens = dict(zip(_PARAMETERS[name], values))
    focal = lens.pop("f", None)
    return {"width": size[0], "height": size[1]} | ({} if focal is None else {"fx": focal, "fy": focal}) | lens


def _parsed(path: Path, parse) -> dict:
    data = read_bytes(path)
    try:
        return parse(data)
    except InputError as error:
        raise InputError(f"{path.name} {error.field}", error.got, error.expected, error.hint) from None
    except (ValueError, IndexError, struct.error, OverflowError) as error:
        raise InputError(str(path), f"a damaged file ({error})", "a COLMAP model; export it again") from error


def _rows(data: bytes) -> list[list[str]]:
    lines = data.decode("utf-8-sig").splitlines()
    return [line.split() for line in lines if not line.startswith("#")]


def _lenses_txt(data: bytes) -> dict[int, dict]:
    return {
        int(row[0]): _lens(row[1], (int(row[2]), int(row[3])), [float(value) for value in row[4:]])
        for row in _rows(data)
        if row
    }


def _poses_txt(data: bytes) -> dict[str, tuple]:
    """Every other line is a pose; the one after it lists the points seen and may be empty."""
    poses = {}
    for row in _rows(data)[::2]:
        if row:
            values = np.array([float(value) for value in row[1:8]])
            poses[" ".join(row[9:])] = (int(row[8]), values[:4], values[4:])
    return poses


def _lenses_bin(data: bytes) -> dict[int, dict]:
    lenses, at = {}, 8
    for _ in range(_count(data)):
        number, model, width, height = struct.unpack_from("<iiQQ", data, at)
        at += 24
        length = len(_MODELS[model][1]) if model in _MODELS else 0
        lenses[number] = _lens(model, (width, height), list(struct.unpack_from(f"<{length}d", data, at)))
        at += 8 * length
    return lenses


def _poses_bin(data: bytes) -> dict[str, tuple]:
    poses, at = {}, 8
    for _ in range(_count(data)):
        _, *pose, lens = struct.unpack_from("<i7di", data, at)
        name_end = data.index(b"\0", at + 64)
        (num_points,) = struct.unpack_from("<Q", data, name_end + 1)
        poses[data[at + 64 : name_end].decode("utf-8")] = (lens, np.array(pose[:4]), np.array(pose[4:]))
        at = name_end + 9 + 24 * num_points  # x, y, and the number of the point
    if at > len(data):
        raise ValueError("cut short")
    return poses


def _count(data: bytes) -> int:
    """The number of entries; each takes more than 8 bytes, so a larger one is damage."""
    (count,) = struct.unpack_from("<Q", data, 0)
    if count > len(data) // 8:
        raise ValueError(f"{count} entries in {len(data)} bytes")
    return count

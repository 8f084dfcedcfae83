"""Cameras as transforms.json and CAMERA.json give them."""

import math
from pathlib import Path

import numpy as np

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.io.json_fields import json_object, matrix, number, read_json, shown

INTRINSICS = ("w", "h", "fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2", "camera_angle_x")
_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")  # those k1 k2 p1 p2 can say
_MOST_PIXELS = 65536.0  # a side; an image of more would not fit in memory


def camera_from_keys(
    entry: dict, prefix: str, fallback: dict | None = None, fallback_prefix: str | None = None
) -> Camera:
    """The camera of one frame; intrinsics it does not give come from `fallback` (the file's top level).

    Missing `fl_y`, `cx`, `cy` mean square pixels and the middle of the image; `camera_angle_x` may stand for `fl_x`.
    Raises InputError naming the key at fault, in the frame or in the fallback.
    """
    require_pinhole(entry, prefix)
    own = {key: entry[key] for key in INTRINSICS if key in entry}
    given = {key: (fallback or {})[key] for key in INTRINSICS if key in (fallback or {})}
    if "camera_angle_x" in own and "fl_x" not in own:
        given = {key: value for key, value in given.items() if key not in ("fl_x", "fl_y")}
    keys = given | own

    def read(key: str, **limits: float) -> float:
        place = prefix if key in own or fallback_prefix is None else fallback_prefix
        return number(keys, key, place, **limits)

    width, height = (_whole(read(key, above=0.0, most=_MOST_PIXELS), f"{prefix}{key}") for key in ("w", "h"))
    if "fl_x" not in keys and "camera_angle_x" in keys:
        keys["fl_x"] = width / 2 / math.tan(read("camera_angle_x", above=0.0, most=3.1) / 2)
    fx = read("fl_x", above=0.0, most=1e9)
    fy = read("fl_y", above=0.0, most=1e9, default=fx)
    cx, cy = read("cx", default=width / 2), read("cy", default=height / 2)
    lens = {key: read(key, default=0.0) for key in ("k1", "k2", "p1", "p2")}
    pose = matrix(entry, "transform_matrix", prefix)
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # a wild matrix overflows, and is then no rotation
            camera = Camera(width, height, fx, fy, cx, cy, **lens, world_from_camera=pose)
            corners = camera.directions(np.array([(x, y) for x in (0.0, width) for y in (0.0, height)]))
    except InputError as error:
        raise InputError(f"{prefix}{error.field}", error.got, error.expected, error.hint) from None
    if not np.isfinite(corners).all():
        hint = "undistort the photographs first, or check the calibration"
        raise InputError(f"{prefix}k1, k2, p1, p2", tuple(lens.values()), "a distortion that can be undone", hint)
    return camera


def require_pinhole(entry: dict, prefix: str) -> None:
    """Raises InputError for a lens that k1 k2 p1 p2 cannot describe."""
    undistort = "undistort the photographs first, for example with COLMAP's image_undistorter"
    model = entry.get("camera_model", "OPENCV")
    if model not in _MODELS:
        raise InputError(f"{prefix}camera_model", repr(model), "OPENCV or PINHOLE", undistort)
    for key in ("k3", "k4", "is_fisheye"):
        if entry.get(key):
            raise InputError(f"{prefix}{key}", shown(entry, key), "none, or 0", undistort)


def read_cameras(path: str | Path, like: Camera) -> tuple[list[Camera], bool]:
    """The cameras of CAMERA.json, and whether it is a list of them (a path through space) or a single one.

    Intrinsics that the file leaves out are those of `like`; `w` and `h` alone mean the same view in other pixels.
    Raises InputError naming the file and the key at fault.
    """
    path = Path(path)
    value = read_json(path)
    if not isinstance(value, list):
        return [_camera_like(json_object(value, path.name), f"{path.name} ", like)], False
    if not value:
        raise InputError(path.name, "an empty list", "a camera, or a list of cameras")
    fields = [f"{path.name} [{index}]" for index in range(len(value))]
    return [_camera_like(json_object(v, f), f"{f}.", like) for v, f in zip(value, fields)], True


def read_camera(path: str | Path, like: Camera) -> Camera:
    """The one camera of CAMERA.json. Raises InputError where the file is a list, and as read_cameras does."""
    cameras, is_sequence = read_cameras(path, like)
    if is_sequence:
        raise InputError(Path(path).name, f"a list of {len(cameras)} cameras", "one camera, { ... }")
    return cameras[0]


def _camera_like(entry: dict, prefix: str, like: Camera) -> Camera:
    camera = camera_from_keys(entry, prefix, fallback=like.to_dict())
    given = {key for key in INTRINSICS if key in entry}
    if given and given <= {"w", "h"}:
        resized = like.resized(camera.width, camera.height)
        return Camera.from_transform(camera.world_from_camera, resized)
    return camera


def _whole(value: float, field: str) -> int:
    if value != int(value):
        raise InputError(field, value, "a whole number of pixels")
    return int(value)

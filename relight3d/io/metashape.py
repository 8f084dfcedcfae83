"""Cameras of Agisoft Metashape, exported as XML ("Export Cameras").

Metashape's cameras look down +z with y down; its transforms are chunk_from_camera, and the chunk has one more to the
world, with a scale. Its p1 and p2 are OpenCV's p2 and p1, and cx, cy count from the middle of the image.
"""

import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.io.colmap import OPENGL_FROM_OPENCV
from relight3d.io.files import read_bytes

_TOLERANCE_PX = 0.25  # what terms that Camera cannot hold may move a corner by
_TAGS = ("f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2")
_UNDISTORT = "export undistorted photographs and their cameras"


def read_metashape(path: str | Path) -> dict[str, Camera]:
    """The camera of every aligned photograph, by its label, in the coordinates of a model exported from the chunk.

    Raises InputError naming the sensor or camera for a damaged file, or a lens that k1 k2 p1 p2 cannot say to a
    quarter of a pixel.
    """
    path = Path(path)
    try:
        chunk = ElementTree.fromstring(read_bytes(path)).find(".//chunk")
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(str(path), f"no valid XML ({error})", "cameras exported from Metashape as XML") from error
    if chunk is None:
        raise InputError(str(path), "no chunk", "cameras exported from Metashape as XML")
    lenses = {s.get("id"): _lens(s, f"{path.name} sensor {s.get('id')}") for s in chunk.iterfind("sensors/sensor")}
    # A chunk of one piece has one transform; one of several components has one for each.
    poses = {part.get("id"): _pose(part, path.name) for part in chunk.iterfind("components/component")}
    chunk_pose = _pose(chunk, path.name)
    cameras = {}
    for entry in chunk.iter("camera"):
        values = entry.findtext("transform")
        if values is None:  # not aligned
            continue
        field = f"{path.name} camera {entry.get('label')}"
        lens = lenses.get(entry.get("sensor_id"))
        if lens is None:
            raise InputError(field, f"sensor {entry.get('sensor_id')}", "a calibrated sensor of the file")
        world_from_chunk, scale = poses.get(entry.get("component_id"), chunk_pose)
        chunk_from_camera = _matrix(values, 4, field)
        chunk_from_camera[:3, 3] *= scale
        pose = world_from_chunk @ chunk_from_camera @ OPENGL_FROM_OPENCV
        try:
            cameras[entry.get("label") or ""] = Camera(**lens, world_from_camera=pose)
        except InputError as error:
            raise InputError(f"{field} {error.field}", error.got, error.expected, error.hint) from None
    if not cameras:
        raise InputError(str(path), "no aligned camera", "one or more")
    return cameras


def _lens(sensor: ElementTree.Element, field: str) -> dict | None:
    """Camera's arguments but for the pose; None for a sensor without calibration."""
    calibration = sensor.find("calibration[@class='adjusted']")
    calibration = sensor.find("calibration") if calibration is None else calibration
    if calibration is None:
        return None
    if calibration.get("type", "frame") != "frame":
        raise InputError(field, f"a {calibration.get('type')} camera", "a frame camera", _UNDISTORT)
    size = calibration.find("resolution")
    size = sensor.find("resolution") if size is None else size
    if size is None:
        raise InputError(field, "no resolution", "width and height")
    try:
        width, height = int(size.get("width", "")), int(size.get("height", ""))
        values = {child.tag: float(child.text or "") for child in calibration if child.tag in _TAGS}
    except ValueError as error:
        raise InputError(field, error, "numbers") from None
    if not np.isfinite(list(values.values())).all():
        raise InputError(field, values, "finite numbers")
    if "f" not in values:  # older files give fx and fy
        raise InputError(field, "no focal length <f>", "a calibration of Metashape 1.2 or later")
    focal, b1 = values["f"], values.get("b1", 0.0)
    _require_mild(values, math.hypot(width, height) / 2, field)
    return {
        "width": width,
        "height": height,
        "fx": focal + b1,
        "fy": focal,
        "cx": width / 2 + values.get("cx", 0.0),
        "cy": height / 2 + values.get("cy", 0.0),
        "k1": values.get("k1", 0.0),
        "k2": values.get("k2", 0.0),
        "p1": values.get("p2", 0.0),
        "p2": values.get("p1", 0.0),
    }


def _require_mild(values: dict[str, float], corner_px: float, field: str) -> None:
    """Raises InputError where the terms left out would move the image's corner by more than the tolerance."""
    focal = values["f"]
    r = corner_px / focal if focal > 0 else math.inf
    moved_px = {key: abs(values.get(key, 0.0)) * corner_px * r ** (2 * order) for key, order in (("k3", 3), ("k4", 4))}
    moved_px["b2"] = abs(values.get("b2", 0.0)) * r
    for key, distance in moved_px.items():
        if not distance <= _TOLERANCE_PX:
            raise InputError(
                f"{field} {key}", f"{values.get(key)}: {distance:.2g} pixels", f"{_TOLERANCE_PX} or less", _UNDISTORT
            )


def _pose(chunk: ElementTree.Element, name: str) -> tuple[np.ndarray, float]:
    """Rotation and translation of a chunk or component in the world, and its scale."""
    parts = {part: chunk.findtext(f"transform/{part}") for part in ("rotation", "translation", "scale")}
    field = f"{name} {chunk.tag} transform"
    pose = np.eye(4)
    if parts["rotation"]:
        pose[:3, :3] = _matrix(parts["rotation"], 3, field)
    if parts["translation"]:
        pose[:3, 3] = _numbers(parts["translation"], 3, field)
    return pose, float(_numbers(parts["scale"], 1, field)[0]) if parts["scale"] else 1.0


def _matrix(values: str, size: int, field: str) -> np.ndarray:
    return _numbers(values, size * size, field).reshape(size, size)


def _numbers(values: str, count: int, field: str) -> np.ndarray:
    try:
        numbers = np.array([float(value) for value in values.split()])
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(field, values, f"{count} numbers")
    return numbers

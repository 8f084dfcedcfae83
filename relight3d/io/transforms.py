"""What transforms.json says of a capture, checked field by field.

Sizes and formats of images come from their headers; of masks the pixels are looked at, since one without a valid
pixel is a common slip.
"""

import dataclasses
import os
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.io.cameras import camera_from_keys
from relight3d.io.images import COLOR_SPACES, IMAGE_SUFFIXES, image_format, image_size, read_mask
from relight3d.io.json_fields import json_object, shown, text
from relight3d.io.light_files import lights_of
from relight3d.io.meshes import read_mesh
from relight3d.records import Photograph, TriangleMesh


def photographs_of(top: dict, file: Path) -> tuple[Photograph, ...]:
    """The frames in the file's order, named by their `file_path`; a frame without `split` is a training frame."""
    entries = top.get("frames")
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{file.name} frames", shown(top, "frames"), "a list of frames")
    return tuple(_photograph(entry, f"{file.name} frames[{i}]", top, file) for i, entry in enumerate(entries))


def shared_camera(photographs: tuple[Photograph, ...], prefix: str) -> Camera:
    """The one camera of the training frames. Raises InputError without any, without lights, or if they differ."""
    train = [index for index, photograph in enumerate(photographs) if photograph.split == "train"]
    if not train:
        raise InputError(f"{prefix}frames", "no training frame", 'some with "split": "train"')
    if not any(photographs[index].lights for index in train):
        raise InputError(f"{prefix}frames", "no light in any training frame", "training frames with known lights")
    first = photographs[train[0]].camera
    for index in train[1:]:
        camera = photographs[index].camera
        if not camera.same_as(first):
            key = "transform_matrix" if camera.intrinsics == first.intrinsics else "intrinsics"
            raise InputError(
                f"{prefix}frames[{index}].{key}",
                f"another camera than that of frames[{train[0]}]",
                "one fixed viewpoint for all training frames",
                'give frames from other viewpoints "split": "test"',
            )
    return first


def check_images(photographs: tuple[Photograph, ...], prefix: str) -> None:
    """Raises InputError for an image or mask whose size is not the camera's, or a mask without a valid pixel."""
    masks: dict[Path, np.ndarray] = {}  # one mask often serves all frames
    for index, photograph in enumerate(photographs):
        size = (photograph.camera.width, photograph.camera.height)
        if photograph.image_path is not None:
            with _at(f"{prefix}frames[{index}].file_path", photograph.image_path):
                _require_size(image_size(photograph.image_path), size)
        if photograph.mask_path is not None:
            with _at(f"{prefix}frames[{index}].mask_path", photograph.mask_path):
                if photograph.mask_path not in masks:
                    masks[photograph.mask_path] = read_mask(photograph.mask_path)
                mask = masks[photograph.mask_path]
                _require_size((mask.shape[1], mask.shape[0]), size)
                if not mask.any():
                    raise InputError("", "zero everywhere", "a mask with some pixels above zero")


def color_space_of(top: dict, photographs: tuple[Photograph, ...], prefix: str) -> str:
    """The file's `color_space`; EXR needs none. Raises InputError where it is unknown, missing or contradicted."""
    value = top.get("color_space")
    are_exr = [image_format(p.image_path) == "exr" for p in photographs if p.image_path is not None]
    if value is None and all(are_exr):
        return "linear"
    if value not in COLOR_SPACES:
        raise InputError(
            f"{prefix}color_space",
            shown(top, "color_space"),
            '"linear" or "srgb"',
            "what a camera or phone develops is srgb, what is proportional to light is linear",
        )
    if value == "srgb" and any(are_exr):
        raise InputError(f"{prefix}color_space", '"srgb" for EXR images', '"linear": EXR holds linear light')
    return value


def mesh_of(top: dict, file: Path, camera: Camera) -> TriangleMesh:
    """The mesh at `mesh_path`. Raises MeshError where it cannot be read, InputError where the camera misses it."""
    field = f"{file.name} mesh_path"
    path = _existing(text(top, "mesh_path", f"{file.name} "), file.parent)
    if path is None:
        raise InputError(field, f"{top['mesh_path']} (no such file)", "a PLY, OBJ, STL, glTF or GLB file")
    with _at(field, path):
        mesh = read_mesh(path)
        if not _may_see(camera, mesh.vertices):
            flipped = Camera.from_transform(camera.world_from_camera @ np.diag([1.0, -1.0, -1.0, 1.0]), camera)
            turn = "negate the second and third column of transform_matrix: its axes look like OpenCV's"
            hint = turn if _may_see(flipped, mesh.vertices) else "check unit and axes (OpenGL's: looking down -z)"
            raise InputError("", "a mesh outside the camera's view", "one that the camera sees", hint)
    return mesh


def with_unique_names(photographs: tuple[Photograph, ...]) -> tuple[Photograph, ...]:
    """Names cut down to the file's stem where that tells them apart; a file listed twice is counted."""
    stems = Counter(p.name.rpartition("/")[2] for p in photographs)
    seen: Counter[str] = Counter()
    named = []
    for photograph in photographs:
        stem = photograph.name.rpartition("/")[2]
        name = stem if stems[stem] == 1 else photograph.name
        seen[name] += 1
        named.append(dataclasses.replace(photograph, name=name if seen[name] == 1 else f"{name}-{seen[name]}"))
    return tuple(named)


def _photograph(value: object, field: str, top: dict, file: Path) -> Photograph:
    entry = json_object(value, field)
    prefix = f"{field}."
    split = text(entry, "split", prefix, default="train")
    file_path = text(entry, "file_path", prefix)
    image_path = _existing(file_path, file.parent) or _with_some_suffix(file_path, file.parent, prefix)
    mask_path = None
    if entry.get("mask_path") is not None:
        mask_path = _existing(text(entry, "mask_path", prefix), file.parent)
        if mask_path is None:
            raise InputError(f"{prefix}mask_path", f"{entry['mask_path']} (no such file)", "an image")
    return Photograph(
        name=_name(image_path, file.parent),
        split=split,
        lights=lights_of(entry, prefix, required=split in ("train", "test")),
        camera=camera_from_keys(entry, prefix, top, f"{file.name} "),
        image_path=image_path,
        mask_path=mask_path,
        group=text(entry, "group", prefix, default=""),
    )


def _name(image_path: Path, folder: Path) -> str:
    """The path below the folder without suffix; for an image elsewhere, its stem."""
    inside = image_path.is_relative_to(folder) and ".." not in image_path.relative_to(folder).parts
    return image_path.relative_to(folder).with_suffix("").as_posix() if inside else image_path.stem


def _existing(name: str, folder: Path) -> Path | None:
    """The file of that name, relative to the folder, with / or Windows' backslashes; None if there is none."""
    for candidate in (folder / name, folder / name.replace("\\", "/")):
        if os.path.isfile(candidate):  # unlike Path.is_file, False for names no file system takes
            return candidate
    return None


def _with_some_suffix(name: str, folder: Path, prefix: str) -> Path:
    """The one image called `name` plus a suffix, as Blender's exports mean it. Raises InputError
    for none or several."""
    wanted = folder / name.replace("\\", "/")
    beside = sorted(wanted.parent.iterdir()) if os.path.isdir(wanted.parent) else []
    found = [path for path in beside if path.stem == wanted.name and path.suffix.lower() in IMAGE_SUFFIXES]
    if len(found) == 1:
        return found[0]
    got = f"{name}, which could be {', '.join(p.name for p in found)}" if found else f"{name} (no such file)"
    raise InputError(f"{prefix}file_path", got, "an image, relative to the folder of transforms.json")


@contextmanager
def _at(field: str, path: Path) -> Iterator[None]:
    """Errors of the block name the field and the file."""
    try:
        yield
    except InputError as error:
        raise type(error)(field, f"{path.name}: {error.got}", error.expected, error.hint) from error


def _require_size(size: tuple[int, int], wanted: tuple[int, int]) -> None:
    if size != wanted:
        raise InputError("", f"{size[0]} x {size[1]} pixels", f"the camera's w x h, {wanted[0]} x {wanted[1]}")


def _may_see(camera: Camera, vertices: np.ndarray) -> bool:
    """False if all vertices lie behind the camera or beyond one side of the view, with a fifth of it to spare."""
    vertices = vertices[np.isfinite(vertices).all(axis=1)]
    in_camera = (vertices - camera.center) @ camera.world_from_camera[:3, :3]
    corners = np.array([(x, y) for x in (0, camera.width) for y in (0, camera.height)], dtype=np.float64)
    with np.errstate(all="ignore"):  # a wild lens diverges; it is given the benefit of the doubt
        rays = camera.directions(corners) @ camera.world_from_camera[:3, :3]
        slopes = rays[:, :2] / -rays[:, 2:]
        margin = 0.2 * np.ptp(slopes, axis=0)
        depth = -in_camera[:, 2:]
        is_below = in_camera[:, :2] < depth * (slopes.min(axis=0) - margin)
        is_above = in_camera[:, :2] > depth * (slopes.max(axis=0) + margin)
    is_beyond = np.hstack([depth <= 0, is_below, is_above])
    return not is_beyond.all(axis=0).any()

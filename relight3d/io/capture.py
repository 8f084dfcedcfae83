"""A capture folder: read and checked to the last field before anything is computed, and written."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.io.cameras import INTRINSICS, require_pinhole
from relight3d.io.files import write_json
from relight3d.io.images import read_image, read_mask, write_exr, write_png
from relight3d.io.json_fields import json_object, read_json, text
from relight3d.io.meshes import write_mesh
from relight3d.io.transforms import (
    check_images,
    color_space_of,
    mesh_of,
    photographs_of,
    shared_camera,
    with_unique_names,
)
from relight3d.records import Capture, Photograph

FILE_NAME = "transforms.json"


def load_capture(path: str | Path) -> Capture:
    """Read a capture from its folder or its transforms.json. Pixels stay in their files until they are asked for.

    Raises InputError naming the file and the field at fault, as `transforms.json frames[3].lights[0].to_light`, and
    MeshError where the mesh cannot be read.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(str(path), "nothing there", f"a capture folder, or its {FILE_NAME}")
    file = path / FILE_NAME if path.is_dir() else path
    if not file.is_file():
        raise InputError(str(path), f"a folder without {FILE_NAME}", "a capture folder")
    return capture_of(json_object(read_json(file), file.name), file)


def capture_of(top: dict, file: Path) -> Capture:
    """The capture whose transforms.json, at `file`, holds `top`; it need not be written yet. Raises as load_capture."""
    prefix = f"{file.name} "
    require_pinhole(top, prefix)
    photographs = photographs_of(top, file)
    camera = shared_camera(photographs, prefix)
    check_images(photographs, prefix)
    return Capture(
        folder=file.parent,
        camera=camera,
        photographs=with_unique_names(photographs),
        mesh=mesh_of(top, file, camera),
        color_space=color_space_of(top, photographs, prefix),
        unit=text(top, "unit", prefix, default=""),
    )


def read_photograph(
    capture: Capture, photograph: Photograph
) -> tuple[Float32[np.ndarray, "height width 3"], Bool[np.ndarray, "height width"]]:
    """Linear radiance, 0 where invalid, and which pixels are valid by value, alpha and mask together.

    Raises InputError for an image or mask that is damaged or of another size, or that leaves no valid pixel.
    """
    field = f"photograph {photograph.name}"
    if photograph.pixels is not None:
        radiance, alpha = photograph.pixels, None
    elif photograph.image_path is not None:
        radiance, alpha = read_image(photograph.image_path, capture.color_space)
    else:
        raise InputError(field, "neither pixels nor a file", "one of the two")
    file_mask = None if photograph.mask_path is None else read_mask(photograph.mask_path)
    shape = (photograph.camera.height, photograph.camera.width)
    for part in (radiance, photograph.is_valid, file_mask):
        if part is not None and part.shape[:2] != shape:
            raise InputError(field, f"{part.shape[1]} x {part.shape[0]} pixels", f"{shape[1]} x {shape[0]}")
    is_valid = np.all(np.isfinite(radiance), axis=-1)
    for mask in (alpha, photograph.is_valid, file_mask):
        if mask is not None:
            is_valid = is_valid & mask
    if not is_valid.any():
        raise InputError(field, "no valid pixel", "a mask and alpha that leave some")
    return np.where(is_valid[..., None], radiance, np.float32(0)).astype(np.float32, copy=False), is_valid


def write_capture(capture: Capture, folder: str | Path) -> Path:
    """Write a capture as a folder: half-float EXR, PNG masks, a PLY mesh, and transforms.json, whose path is returned.

    transforms.json comes last, so a folder that has one is whole. Raises InputError where it cannot be written.
    """
    folder = Path(folder)
    frames = []
    for photograph in capture.photographs:
        radiance, is_valid = read_photograph(capture, photograph)
        files = {"file_path": f"images/{photograph.name}.exr"}
        write_exr(folder / files["file_path"], radiance, half=True)
        if not is_valid.all():
            files["mask_path"] = f"masks/{photograph.name}.png"
            write_png(folder / files["mask_path"], is_valid.astype(np.uint8) * np.uint8(255))
        frames.append(files | frame_keys(photograph, capture.camera))
    write_mesh(folder / "mesh.ply", capture.mesh)
    top = camera_keys(capture.camera) | {"color_space": "linear", "mesh_path": "mesh.ply"}
    write_json(folder / FILE_NAME, top | ({"unit": capture.unit} if capture.unit else {}) | {"frames": frames})
    return folder / FILE_NAME


def camera_keys(camera: Camera) -> dict:
    """The intrinsics of a camera as transforms.json has them at its top."""
    return {key: value for key, value in camera.to_dict().items() if key in INTRINSICS}


def frame_keys(photograph: Photograph, shared: Camera) -> dict:
    """One frame of transforms.json but for its files; intrinsics only where they differ from the shared ones."""
    keys: dict = {"split": photograph.split} | ({"group": photograph.group} if photograph.group else {})
    if photograph.camera.intrinsics != shared.intrinsics:
        keys |= camera_keys(photograph.camera)
    keys["transform_matrix"] = photograph.camera.world_from_camera.tolist()
    return keys | {"lights": [light.to_dict() for light in photograph.lights]}

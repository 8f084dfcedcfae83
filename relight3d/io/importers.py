"""From the parts people hold (a mesh, a camera, lights, photographs) to a capture."""

import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.io.capture import FILE_NAME, camera_keys, capture_of, frame_keys
from relight3d.io.colmap import read_colmap
from relight3d.io.files import atomic_path, write_json
from relight3d.io.metashape import read_metashape
from relight3d.lights import Light
from relight3d.records import Capture, Photograph


def import_cameras(path: str | Path) -> dict[str, Camera]:
    """Cameras by image name: of a COLMAP model (a folder) or of Metashape (an XML file). Raises InputError."""
    return read_colmap(path) if Path(path).is_dir() else read_metashape(path)


def camera_of_image(cameras: Mapping[str, Camera], image: str | None = None) -> Camera:
    """The camera of one image, by name, with or without folders and suffix.

    Structure from motion gives each photograph of a fixed camera a pose of its own; a capture needs one, so where
    there are several the image must be named. Raises InputError where it is not, or is not among them.
    """
    if image is None:
        if len(cameras) == 1:
            return next(iter(cameras.values()))
        raise InputError("camera image", f"none, of {len(cameras)}", "the name of the image whose pose to take")
    for key in (str, _base_name, lambda name: Path(_base_name(name)).stem):
        found = [name for name in cameras if key(name) == key(image)]
        if len(found) == 1:
            return cameras[found[0]]
    some = ", ".join(list(cameras)[:5])
    raise InputError("camera image", image, f"one of the {len(cameras)} images with a camera, as {some}")


def capture_from_parts(
    folder: str | Path,
    mesh: str | Path,
    camera: Camera,
    lights: Mapping[str, Sequence[Light]],
    images: str | Path,
    color_space: str,
    mask: str | Path | None = None,
    test: Collection[str] = (),
    unit: str = "",
) -> Capture:
    """Write a transforms.json that joins the parts where they lie, once they make a capture.

    `lights` are by image name; the images are those names in the folder `images`. Those in `test` are held out.
    Raises InputError as load_capture does; an earlier file stays as it was then.
    """
    folder, images = Path(folder), Path(images)
    if not lights:
        raise InputError("lights", "none", "the lights of one image or more")
    unknown = sorted(set(test) - set(lights))
    if unknown:
        raise InputError("test", ", ".join(unknown), "names of images with lights")
    frames = []
    for name, lamps in lights.items():
        split = "test" if name in test else "train"
        files = {"file_path": _relative(images / name, folder)}
        if mask is not None:
            files["mask_path"] = _relative(Path(mask), folder)
        frames.append(files | frame_keys(Photograph(name, split, tuple(lamps), camera), camera))
    top = camera_keys(camera) | {"color_space": color_space, "mesh_path": _relative(Path(mesh), folder)}
    top |= ({"unit": unit} if unit else {}) | {"frames": frames}
    with atomic_path(folder / FILE_NAME) as temporary:
        capture = capture_of(top, folder / FILE_NAME)
        write_json(temporary, top)
    return capture


def _relative(path: Path, folder: Path) -> str:
    """The path as seen from the folder, so that both can move together; absolute on another drive."""
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return path.resolve().as_posix()


def _base_name(name: str) -> str:
    return name.replace("\\", "/").rpartition("/")[2]

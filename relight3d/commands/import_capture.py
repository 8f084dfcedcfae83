"""relight3d import: a capture folder from the parts that other programs leave."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from relight3d.camera import Camera
from relight3d.commands.command import Command
from relight3d.errors import InputError
from relight3d.io.cameras import camera_from_keys
from relight3d.io.capture import FILE_NAME
from relight3d.io.importers import camera_of_image, capture_from_parts, import_cameras
from relight3d.io.json_fields import json_object, read_json
from relight3d.io.rti import ImportedLights, import_dome, import_lp
from relight3d.progress import remark, say


@dataclass(frozen=True)
class Import(Command):
    """Make a capture: write a transforms.json that joins a mesh, a camera, lights and images where they lie."""

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]  # gets the transforms.json
    mesh: Path  # PLY, OBJ, STL, glTF or GLB, in the cameras' coordinates
    camera: Path  # a COLMAP model (folder), a Metashape XML file, or CAMERA.json with pose and intrinsics
    lights: Path  # directions or places of the lamps: .lp or .dome, in the camera's axes
    images: Path  # the folder of the photographs
    color_space: Literal["linear", "srgb"]  # of the photographs: linear (EXR, developed raw) or srgb (JPEG)
    camera_image: str | None = None  # whose pose to take where the cameras are several
    mask: Path | None = None  # an image that is black where the photographs are to be ignored
    test: tuple[str, ...] = field(default_factory=tuple)  # names of images to hold out
    unit: str = ""  # of the mesh's coordinates, for people
    units_per_mm: float = 1.0  # .dome files give millimetres

    def run(self) -> None:
        camera = self._read_camera()
        imported = self._read_lights(camera)
        capture = capture_from_parts(
            self.folder,
            self.mesh,
            camera,
            imported.lights,
            self.images,
            self.color_space,
            self.mask,
            self.test,
            self.unit,
        )
        for note in imported.notes:
            remark(f"note: {note}")
        count = f"{len(capture.split('train'))} training and {len(capture.split('test'))} held-out photographs"
        say(f"{self.folder / FILE_NAME}: {count}, {len(capture.mesh.faces)} faces")

    def _read_camera(self) -> Camera:
        if self.camera.suffix.lower() == ".json":
            return camera_from_keys(json_object(read_json(self.camera), self.camera.name), f"{self.camera.name} ")
        return camera_of_image(import_cameras(self.camera), self.camera_image)

    def _read_lights(self, camera: Camera) -> ImportedLights:
        if self.lights.suffix.lower() == ".lp":
            return import_lp(self.lights, self.images, camera)
        if self.lights.suffix.lower() == ".dome":
            return import_dome(self.lights, self.images, camera, units_per_mm=self.units_per_mm)
        raise InputError("lights", self.lights, "a .lp or .dome file")

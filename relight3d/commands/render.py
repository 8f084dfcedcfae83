"""relight3d render: a model under new lights, as a picture, numbered frames or a film."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from relight3d.camera import Camera
from relight3d.commands.command import Command, ModelPath, require_writable
from relight3d.commands.frames import LIST_NAME, missing_frames, write_film
from relight3d.commands.relighting import Relighting
from relight3d.display.frames import write_frame
from relight3d.errors import InputError
from relight3d.io.cameras import read_cameras
from relight3d.io.files import hash_of
from relight3d.io.light_files import read_lights
from relight3d.io.model_file import load_model
from relight3d.lights import Light
from relight3d.progress import say, track
from relight3d.records import Frame, RelightModel

PICTURE_SUFFIXES, FILM_SUFFIX = (".png", ".exr"), ".mp4"
Shot = tuple[Camera, list[Light]]


@dataclass(frozen=True)
class Render(Command):
    """Relight a model. Several lists of lights, or several cameras, make a sequence.

    A folder of numbered frames is continued where an earlier run stopped; frames of other lights, cameras or models
    are rendered anew. A film is written whole or not at all.
    """

    model: ModelPath
    lights: Path  # LIGHTS.json: a list of lights as in transforms.json, or a list of such lists
    output: Annotated[str, tyro.conf.arg(aliases=["-o"], metavar="OUT")]  # name.png, name.exr, name.mp4 or a folder/
    camera: Path | None = None  # CAMERA.json: another viewpoint, or a list of them; the captured one if left out
    exposure: float | None = None  # factor on the radiance of PNG and film; the capture's own if left out
    format: Literal["png", "exr"] = "png"  # of the numbered frames in a folder
    fps: float = 25.0  # frames a second of a film
    relighting: Annotated[Relighting, tyro.conf.arg(name="")] = field(default_factory=Relighting)

    def run(self) -> None:
        if self.exposure is not None and not 0 < self.exposure < float("inf"):
            raise InputError("exposure", self.exposure, "a finite number above 0")
        if not self.output:  # a folder name would be "./": of an empty shell variable nobody means that
            raise InputError("output", "nothing", "a name that ends in .png, .exr or .mp4, or a folder")
        model = load_model(self.model)
        shots = read_shots(self.lights, self.camera, model.camera)
        suffix = self._suffix(len(shots))
        require_writable(Path(self.output) / LIST_NAME if suffix == "" else Path(self.output))
        if suffix == FILM_SUFFIX:
            self._render_film(model, shots)
        elif suffix in PICTURE_SUFFIXES:
            (frame,) = self._frames(model, shots)
            write_frame(Path(self.output), frame, self.exposure)
            height, width = frame.is_hit.shape
            cost = f"{frame.stats.total_ms:.1f} ms, {frame.stats.num_rays} rays"
            say("; ".join([f"{self.output}: {width} x {height}, {cost}", *frame.stats.notes]))
        else:
            self._render_folder(model, shots)

    def _suffix(self, num_frames: int) -> str:
        """The output's kind by its suffix; "" for a folder. Raises InputError for another kind."""
        suffix = Path(self.output).suffix.lower()
        if self.output.endswith(("/", "\\")) or not suffix or Path(self.output).is_dir():
            return ""
        if suffix not in (*PICTURE_SUFFIXES, FILM_SUFFIX):
            raise InputError("output", self.output, "a name that ends in .png, .exr or .mp4, or a folder")
        if suffix in PICTURE_SUFFIXES and num_frames > 1:
            raise InputError("output", self.output, f"a folder or .mp4 for {num_frames} frames")
        return suffix

    def _frames(self, model: RelightModel, shots: list[Shot]) -> Iterator[Frame]:
        """The shots' frames one by one; what depends on the camera alone is made again only when the camera moves."""
        relighter = None
        for camera, lights in shots:
            if relighter is None:
                relighter = self.relighting.relighter(model, camera)
            elif not relighter.camera.same_as(camera):
                relighter.set_camera(camera)
            yield relighter.render(lights)

    def _render_film(self, model: RelightModel, shots: list[Shot]) -> None:
        frames = track(self._frames(model, shots), "render", len(shots), self.hides_bar)
        write_film(Path(self.output), frames, self.fps, self.exposure)
        say(f"{self.output}: {len(shots)} frames at {self.fps:g} a second")

    def _render_folder(self, model: RelightModel, shots: list[Shot]) -> None:
        folder, same = Path(self.output), hash_of(model, self.relighting, self.exposure)
        hashes = [hash_of(same, *shot) for shot in shots]
        missing = missing_frames(folder, self.format, hashes)
        frames = self._frames(model, [shots[index] for index in missing])
        for frame, path in zip(track(frames, "render", len(missing), self.hides_bar), missing.values()):
            write_frame(path, frame, self.exposure)
        kept = len(shots) - len(missing)
        say(f"{folder}: {len(missing)} frames rendered" + (f", {kept} were there already" if kept else ""))


def read_shots(lights: Path, camera: Path | None, captured: Camera) -> list[Shot]:
    """Camera and lights of each frame. Raises InputError for two sequences of unequal length."""
    lists, _ = read_lights(lights)
    cameras = [captured] if camera is None else read_cameras(camera, captured)[0]
    if len(lists) > 1 and len(cameras) > 1 and len(lists) != len(cameras):
        raise InputError(f"{camera}", f"{len(cameras)} cameras", f"1, or one for each of {len(lists)} lists of lights")
    num_frames = max(len(lists), len(cameras))
    lists = lists * num_frames if len(lists) == 1 else lists
    cameras = cameras * num_frames if len(cameras) == 1 else cameras
    return list(zip(cameras, lists))

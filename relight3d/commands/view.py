"""relight3d view: a model live in a window, or what the window would show as a picture."""

from dataclasses import dataclass
from pathlib import Path

import relight3d
from relight3d.commands.command import Command, ModelPath, require_writable
from relight3d.display.viewer import screenshot
from relight3d.errors import InputError
from relight3d.io.capture import load_capture
from relight3d.io.light_files import read_lights
from relight3d.io.model_file import load_model
from relight3d.lights import Light
from relight3d.progress import say
from relight3d.records import Capture, RelightModel


@dataclass(frozen=True)
class View(Command):
    """Move the lights and the camera, switch effects, look at the layers of evidence; or write one picture of it."""

    model: ModelPath
    capture: Path | None = None  # the model's capture: needed for the layers that compare with photographs
    lights: Path | None = None  # LIGHTS.json to begin with
    screenshot: Path | None = None  # write this picture and open no window
    layer: str | None = None  # of the picture, as "albedo"; the relit frame if left out

    def run(self) -> None:
        if self.layer is not None and self.screenshot is None:
            raise InputError("layer", self.layer, "--screenshot with it", "in the window, layers are chosen by hand")
        model = load_model(self.model)
        capture = None if self.capture is None else load_capture(self.capture)
        lights = None if self.lights is None else read_lights(self.lights)[0][0]
        if self.screenshot is None:
            relight3d.view(model, capture, lights)
        else:
            self._write(self.screenshot, model, capture, lights)

    def _write(self, path: Path, model: RelightModel, capture: Capture | None, lights: list[Light] | None) -> None:
        require_writable(path)
        say(f"{screenshot(model, path, self.layer, lights, capture)}")

"""Pictures of the viewer's window, on a screen that exists already: make_figures.py starts a virtual one for it.

DISPLAY=:99 python pipelines/shoot_viewer.py MODEL CAPTURE FRAMEBUFFER OUTPUT
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import tyro
from start import start
from virtual_screen import read_screen

import relight3d
from relight3d.display.viewer_state import ViewerState
from relight3d.display.viewer_window import ViewerWindow
from relight3d.io.images import write_png

LAMP_COLOR = (1.0, 0.62, 0.3)
PIXEL = (0.73, 0.82)  # looked at: a place in the picture, as parts of its width and height
Argument = Annotated[Path, tyro.conf.Positional]


def main(model: Argument, capture: Argument, framebuffer: Argument, output: Argument) -> None:
    state = ViewerState(relight3d.load_model(model), relight3d.load_capture(capture))
    window = ViewerWindow(state, width=1280, height=800)
    state.rack = state.rack.turn(-0.4, 0.25).strengthen(0.8).add("point").tint(*LAMP_COLOR).strengthen(0.45)
    state.rack = state.rack.turn(0.5, -0.2)
    shoot(window, framebuffer, output / "viewer.png")
    window.open_tab(1)
    shoot(window, framebuffer, output / "viewer_effects.png")
    state.inspect(PIXEL[0] * state.camera.width, PIXEL[1] * state.camera.height)
    state.set_layer("normals")
    state.orbit(0.1 * state.camera.width, 0.04 * state.camera.height)
    window.open_tab(2)
    shoot(window, framebuffer, output / "viewer_inspect.png")
    window.close()
    ticks(window, lambda: False, 0.5)


def shoot(window: ViewerWindow, framebuffer: Path, path: Path) -> None:
    """Wait until nothing is left to do, and write what the screen shows."""
    window.changed()
    ticks(window, lambda: window._is_idle, 120.0)
    ticks(window, lambda: False, 1.0)
    write_png(path, read_screen(framebuffer))


def ticks(window: ViewerWindow, is_done: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end and not is_done():
        window.app.run_one_tick()
        time.sleep(0.01)


if __name__ == "__main__":
    start(main, __doc__)

"""Run in a child under a virtual screen: a hand drives the viewer, and each thing it should do is checked.

Usage: drive_viewer.py FRAMEBUFFER NUM_WINDOWS. Ends with exit 0 and the line "driven".
"""

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from relight3d.display.frames import show_frame_u8
from relight3d.display.viewer_state import ViewerState
from relight3d.display.viewer_window import ViewerWindow
from relight3d.evaluate.truth import true_model
from relight3d.relight.relighter import Relighter
from tests.display.x_screen import XClient, read_screen
from tests.scenes import desk, desk_capture

FRAMEBUFFER = Path(sys.argv[1])


class Driver:
    """A viewer and the hand on its mouse."""

    def __init__(self) -> None:
        capture = desk_capture(4, glossy=True, mirror=True, ambient=0.2, bounce=False)
        lights = [photograph.lights for photograph in capture.split("train")]
        model = true_model(desk(glossy=True, mirror=True, ambient=0.2), lights, exposure=0.6)
        self.state = ViewerState(replace(model, decisions=()), capture)
        self.window = ViewerWindow(self.state, width=1000, height=640)
        self.mouse = XClient(os.environ["DISPLAY"])
        self.wait(lambda: self.shows_picture())

    def ticks(self, num: int) -> None:
        for _ in range(num):
            self.window.app.run_one_tick()
            time.sleep(0.01)

    def wait(self, condition, seconds: float = 60.0) -> None:
        """Tick until a condition holds; an assertion's error where it never does."""
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, "the viewer did not get there"
            self.ticks(2)

    def on_screen(self, x: float, y: float) -> tuple[float, float]:
        """Where a place in the picture is on the screen."""
        left, top, width, height = self.window._box
        camera = self.state.camera
        return left + x * width / camera.width, top + y * height / camera.height

    def shows_picture(self) -> bool:
        """Whether the screen shows what the state says, pixel by pixel but for a rounding of the widgets' scaling."""
        area = self.window.image.frame
        wanted, _ = self.state.display(max(area.width, 1), max(area.height, 1))
        shown = read_screen(FRAMEBUFFER)[area.y : area.y + area.height, area.x : area.x + area.width]
        return shown.shape == wanted.shape and np.mean(np.abs(shown.astype(int) - wanted)) < 0.5

    def drag(self, start: tuple[float, float], *through: tuple[float, float]) -> None:
        self.mouse.move(*start)
        self.ticks(5)
        self.mouse.press()
        self.ticks(5)
        for place in through:
            self.mouse.move(*place)
            self.ticks(8)
        self.mouse.release()
        self.ticks(5)


def drag_the_light(driver: Driver) -> None:
    """The light follows the hand, and the picture is what the Relighter says of it."""
    state = driver.state
    knob = np.array(state.gizmo.knob(state.rack.active[0]))
    before = state.picture()
    target = (knob + state.camera.project(state.pivot[None])[0][0]) / 2  # over the dome, where every place can be had
    driver.drag(driver.on_screen(*knob), driver.on_screen(*(0.5 * knob + 0.5 * target)), driver.on_screen(*target))
    moved = state.gizmo.knob(state.rack.active[0])
    assert np.hypot(*(moved - target)) < 0.5, (knob, target, moved)  # a pixel of the screen is 0.1 of the picture's
    assert (state.picture() != before).any()
    assert (state.picture() == show_frame_u8(Relighter(state.model).render(state.rack.active))).all()
    driver.wait(driver.shows_picture)


def switch_a_layer(driver: Driver) -> None:
    panel = next(part for part in driver.window.parts if part.title == "Layer")
    panel.choose("normals")
    driver.wait(driver.shows_picture)
    assert driver.state.layer_name == "normals"
    panel.choose("relit")
    driver.wait(driver.shows_picture)


def click_a_pixel(driver: Driver) -> None:
    x, y = driver.state.camera.project(np.array([[0.45, -0.15, 0.35]]))[0][0]  # the sphere
    driver.drag(driver.on_screen(x, y))
    driver.wait(lambda: driver.state.pixel is not None)
    assert driver.state.pixel is not None and driver.state.pixel.surface == "sphere"
    assert driver.window.tabs.selected_tab_index == 2


def orbit(driver: Driver) -> None:
    """While the camera moves there is the mesh, and when it stands the picture of its new view."""
    middle = driver.on_screen(8.0, 40.0)
    driver.mouse.move(*middle)
    driver.ticks(5)
    driver.mouse.press()
    driver.ticks(5)
    driver.mouse.move(middle[0] + 60, middle[1] - 10)
    driver.wait(lambda: driver.window.mesh.visible)
    driver.ticks(10)
    assert not driver.state.is_captured_view
    assert read_screen(FRAMEBUFFER).std() > 10  # the mesh is drawn
    driver.mouse.release()
    driver.wait(lambda: not driver.window.mesh.visible)
    driver.wait(driver.shows_picture)
    driver.state.reset_camera()
    driver.window.changed()
    driver.wait(driver.shows_picture)


def main() -> None:
    """One window is driven through everything, further ones only shown, each closed before the next."""
    for index in range(int(sys.argv[2])):
        driver = Driver()
        if index == 0:
            for work in (drag_the_light, switch_a_layer, click_a_pixel, orbit):
                work(driver)
        driver.mouse.close()
        driver.window.close()
        driver.ticks(5)
    sys.stdout.write("driven\n")


if __name__ == "__main__":
    main()

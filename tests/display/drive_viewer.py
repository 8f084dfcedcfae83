"""Run in a child under a virtual screen: a hand drives the viewer, and each thing it should do is checked.

Usage: drive_viewer.py FRAMEBUFFER. Ends with exit 0 and a line "driven".
"""

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipelines.virtual_screen import read_screen
from relight3d.display.frames import show_frame_u8
from relight3d.display.viewer_state import ViewerState
from relight3d.display.viewer_window import ViewerWindow
from relight3d.evaluate.truth import true_model
from relight3d.relight.relighter import Relighter
from tests.display.x_client import XClient
from tests.scenes import desk, desk_capture

FRAMEBUFFER = Path(sys.argv[1])


class WatchedWindow(ViewerWindow):
    """A window that notes what reached it from the mouse."""

    def __init__(self, state: ViewerState) -> None:
        self.heard: list[tuple[str, int, int]] = []
        super().__init__(state, width=1000, height=640)

    def _on_mouse(self, event) -> object:
        self.heard.append((str(event.type).rpartition(".")[2], event.x, event.y))
        return super()._on_mouse(event)


class Driver:
    """A viewer and the hand on its mouse."""

    def __init__(self) -> None:
        capture = desk_capture(4, glossy=True, mirror=True, ambient=0.2, bounce=False)
        lights = [photograph.lights for photograph in capture.split("train")]
        model = true_model(desk(glossy=True, mirror=True, ambient=0.2), lights, exposure=0.6)
        self.state = ViewerState(replace(model, decisions=()), capture)
        self.window = WatchedWindow(self.state)
        self.mouse = XClient(os.environ["DISPLAY"])
        self.wait(lambda: self.shows_picture())

    def ticks(self, num: int) -> None:
        for _ in range(num):
            self.window.app.run_one_tick()
            time.sleep(0.01)

    def wait(self, condition, seconds: float = 120.0) -> None:
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
        area = self.window.image.widget.frame
        wanted, _ = self.state.display(max(area.width, 1), max(area.height, 1))
        shown = read_screen(FRAMEBUFFER)[area.y : area.y + area.height, area.x : area.x + area.width]
        return shown.shape == wanted.shape and np.mean(np.abs(shown.astype(int) - wanted)) < 0.5

    def drag(self, start: tuple[float, float], *through: tuple[float, float]) -> None:
        self.press(*start)
        for place in through:
            self.move("DRAG", *place)
        self.release()

    def panel(self, title: str):
        return next(part for part in self.window.parts if part.title == title)

    def click_and_pull(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """A drag on the panels, whose widgets tell nobody what they hear."""
        for act in (
            lambda: self.mouse.move(*start),
            self.mouse.press,
            lambda: self.mouse.move(*end),
            self.mouse.release,
        ):
            act()
            self.ticks(30)

    def press(self, x: float, y: float) -> None:
        self.mouse.move(x + 3, y + 3)  # a move to where the pointer is would be none
        self.move("MOVE", x, y)
        self.mouse.press()
        self.wait(lambda: self.window.heard[-1][0] == "BUTTON_DOWN")

    def move(self, kind: str, x: float, y: float) -> None:
        """Move the pointer, and wait until the window knows: on a busy machine that takes a while."""
        self.mouse.move(x, y)
        self.wait(lambda: self.window.heard[-1:] == [(kind, round(x), round(y))])

    def release(self) -> None:
        self.mouse.release()
        self.wait(lambda: self.window.heard[-1][0] == "BUTTON_UP")


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


def add_a_lamp(driver: Driver) -> None:
    """It stays where it was put: no widget moves it by being drawn. Then the hand moves it on the disc."""
    state, panel = driver.state, driver.panel("Lights")
    state.rack = state.rack.add("point")
    lamp = state.rack.active[-1]
    driver.window.changed()
    driver.wait(driver.shows_picture)
    driver.ticks(20)
    np.testing.assert_array_equal(state.rack.active[-1].position, lamp.position)
    frame = panel.disc.widget.frame
    middle = (frame.x + frame.width / 2, frame.y + frame.height / 2)
    driver.click_and_pull(middle, (middle[0] + 40, middle[1] - 20))
    half = min(frame.width, frame.height) / 2 - 8
    place = state.dome.place_on_disc(state.dome.direction_of(state.rack.active[-1]))
    np.testing.assert_allclose(place, (40 / half, 20 / half), atol=2 / half)
    state.rack = state.rack.remove()
    driver.window.changed()
    driver.wait(driver.shows_picture)


def pull_the_exposure(driver: Driver) -> None:
    frame = driver.panel("View").exposure.widget.frame
    place = (frame.x + frame.width // 2, frame.y + frame.height // 2)
    driver.click_and_pull(place, (place[0] + frame.width // 4, place[1]))
    assert 0.5 < driver.state.exposure_stops < 3.5
    driver.wait(driver.shows_picture)
    driver.state.exposure_stops = 0.0
    driver.window.changed()
    driver.wait(driver.shows_picture)


def switch_a_layer(driver: Driver) -> None:
    panel = driver.panel("Layer")
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
    driver.press(*middle)
    driver.move("DRAG", middle[0] + 60, middle[1] - 10)
    driver.wait(lambda: driver.window.mesh.visible)
    driver.ticks(10)
    assert not driver.state.is_captured_view
    area = driver.window.mesh.frame
    drawn = read_screen(FRAMEBUFFER)[area.y : area.y + area.height, area.x : area.x + area.width]
    assert drawn.std() > 10  # the mesh, not an empty ground
    driver.release()
    driver.wait(lambda: not driver.window.mesh.visible)
    driver.wait(driver.shows_picture)
    driver.state.reset_camera()
    driver.window.changed()
    driver.wait(driver.shows_picture)


def main() -> None:
    driver = Driver()
    for work in (drag_the_light, add_a_lamp, pull_the_exposure, switch_a_layer, click_a_pixel, orbit):
        work(driver)
    driver.mouse.close()
    driver.window.close()
    driver.ticks(5)
    sys.stdout.write("driven\n")


if __name__ == "__main__":
    main()

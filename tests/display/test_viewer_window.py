"""The viewer's window, driven on a virtual screen; and what is said where no window can be opened."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipelines.virtual_screen import HAS_XVFB, XScreen, read_screen
from relight3d.display.frames import show_frame_u8
from relight3d.display.probe import vulkan_trouble, window_trouble
from relight3d.display.viewer import screenshot, view
from relight3d.errors import DisplayError, InputError
from relight3d.io.images import read_image
from relight3d.records import Capture, RelightModel
from relight3d.relight.relighter import Relighter
from tests.display.x_client import XClient

ROOT = Path(__file__).parents[2]
needs_screen = pytest.mark.skipif(
    not HAS_XVFB or bool(vulkan_trouble()[0]),
    reason="no Xvfb here" if not HAS_XVFB else f"Open3D cannot draw here: {vulkan_trouble()[0]}",
)


def drive(screen: XScreen) -> subprocess.CompletedProcess:
    command = [sys.executable, "-X", "faulthandler", "-m", "tests.display.drive_viewer", str(screen.framebuffer)]
    environment = os.environ | {"DISPLAY": screen.display}
    return subprocess.run(command, capture_output=True, text=True, timeout=400, cwd=ROOT, env=environment)


def close_windows(screen: XScreen) -> None:
    """As with a click on the cross."""
    client = XClient(screen.display)
    for window in client.windows():
        client.ask_to_close(window)
    client.close()


def shows_window(screen: XScreen) -> bool:
    return np.ptp(read_screen(screen.framebuffer)) > 100


def children() -> set[int]:
    """The processes that this one has started and that still run."""
    tasks = Path("/proc/self/task").iterdir()
    return {int(child) for task in tasks for child in (task / "children").read_text().split()}


def wait_for(find: Callable, seconds: float = 60.0):
    """What `find` finds, once it finds something."""
    end = time.monotonic() + seconds
    while not (found := find()):
        assert time.monotonic() < end, "it did not come to that"
        time.sleep(0.1)
    return found


@pytest.fixture
def open_view(tmp_path: Path, model: RelightModel, capture: Capture, monkeypatch: pytest.MonkeyPatch):
    """A view that runs in a thread, as (screen, its process, the thread, what it raised)."""
    raised: list[DisplayError] = []

    def run() -> None:
        try:
            view(model, capture)
        except DisplayError as error:
            raised.append(error)

    with XScreen(tmp_path) as screen:
        monkeypatch.setenv("DISPLAY", screen.display)
        before = children()
        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        # The probe comes and goes first; the window's process stays and puts a picture on the screen.
        wait_for(lambda: shows_window(screen))
        (process,) = children() - before
        yield screen, process, thread, raised
        thread.join(timeout=30)
        assert not thread.is_alive() and children() == before


@needs_screen
def test_a_hand_drives_the_viewer(tmp_path: Path):
    with XScreen(tmp_path) as screen:
        done = drive(screen)
    assert done.returncode == 0, done.stderr[-3000:]
    assert "driven" in done.stdout.splitlines()  # Open3D writes there too, and when it likes


@needs_screen
def test_view_returns_when_its_window_is_closed(open_view: tuple):
    screen, _, thread, raised = open_view
    close_windows(screen)
    thread.join(timeout=30)
    assert not thread.is_alive() and raised == []


@needs_screen
def test_a_window_that_crashes_leaves_one_line(open_view: tuple):
    _, process, thread, raised = open_view
    os.kill(process, 6)  # what Open3D does to its process where a driver fails
    thread.join(timeout=30)
    assert len(raised) == 1 and "exit -6" in str(raised[0]) and "\n" not in str(raised[0])


@needs_screen
@pytest.mark.slow
def test_windows_one_after_the_other_end_well(
    tmp_path: Path, model: RelightModel, capture: Capture, monkeypatch: pytest.MonkeyPatch
):
    # Each in a process of its own, as `view` opens them. In one process, Filament now and then takes a pipeline of a
    # window that is gone for one of the next, which then shows its images as if they were letters.
    before, num_files = children(), len(os.listdir("/proc/self/fd"))
    with XScreen(tmp_path) as screen:
        monkeypatch.setenv("DISPLAY", screen.display)
        for _ in range(6):
            closing = threading.Thread(target=lambda: (wait_for(lambda: shows_window(screen)), close_windows(screen)))
            closing.start()
            view(model, capture)
            closing.join(timeout=30)
            assert not closing.is_alive() and children() - before == {screen.process_id}
            wait_for(lambda: not shows_window(screen))
    assert len(os.listdir("/proc/self/fd")) == num_files


def test_without_a_screen_one_line_says_what_to_do(model: RelightModel, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    before = children()
    with pytest.raises(DisplayError, match="--screenshot") as error:
        view(model)
    assert "\n" not in str(error.value) and children() == before
    if not vulkan_trouble()[0]:
        assert "DISPLAY" in str(error.value)
        monkeypatch.setenv("DISPLAY", ":4711")
        assert ":4711" in window_trouble()[0]


def test_without_vulkan_one_line_says_what_to_do(model: RelightModel, monkeypatch: pytest.MonkeyPatch):
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(name, "/nowhere/icd.json")
    with pytest.raises(DisplayError, match="Vulkan"):
        view(model)


def test_a_screenshot_needs_no_screen(
    model: RelightModel, capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv("DISPLAY", raising=False)
    path = screenshot(model, tmp_path / "relit.png", lights=model.lights[1])
    pixels, _ = read_image(path)
    assert (np.rint(pixels * 255) == show_frame_u8(Relighter(model).render(model.lights[1]))).all()
    sheet, _ = read_image(screenshot(model, tmp_path / "residual.png", "residual", capture=capture))
    assert sheet.shape[1] > 600
    assert screenshot(model, tmp_path / "relit.exr").stat().st_size > 1000


REFUSED = [
    ("a.png", "shiny", "layer"),
    ("a.png", "residual", "capture"),
    ("a.exr", "albedo", "png"),
    ("a.txt", None, "png"),
]


@pytest.mark.parametrize(("name", "layer", "match"), REFUSED)
def test_a_screenshot_that_cannot_be_is_refused(
    model: RelightModel, tmp_path: Path, name: str, layer: str | None, match: str
):
    with pytest.raises(InputError, match=match):
        screenshot(model, tmp_path / name, layer)
    assert list(tmp_path.iterdir()) == []

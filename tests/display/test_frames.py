"""Frames as pictures: the same pixels through Open3D's renderer and without it."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from relight3d.camera import Camera, look_at
from relight3d.display.frames import render_mesh, render_open3d, show_frame_u8, write_frame
from relight3d.display.offscreen import PICTURES_PER_PROCESS, Offscreen
from relight3d.display.probe import vulkan_trouble
from relight3d.errors import DisplayError, InputError
from relight3d.io.images import read_image
from relight3d.maths.color import display_u8
from relight3d.records import RelightModel
from relight3d.relight.relighter import Relighter

needs_vulkan = pytest.mark.skipif(bool(vulkan_trouble()[0]), reason=f"no Open3D renderer here: {vulkan_trouble()[0]}")


def noise(height: int, width: int, seed: int = 0) -> np.ndarray:
    """Radiance with every kind of value: below zero, above white, infinite and NaN."""
    radiance = np.random.default_rng(seed).random((height, width, 3), dtype=np.float32) * 1.6 - 0.3
    radiance[0, 0], radiance[0, 1] = np.nan, np.inf
    return radiance


@pytest.fixture(scope="module")
def renderer() -> Iterator[Offscreen]:
    with Offscreen() as shared:
        yield shared


@pytest.fixture
def no_vulkan(monkeypatch: pytest.MonkeyPatch) -> None:
    """A loader whose drivers are nowhere, as on a machine without a graphics driver."""
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(name, "/nowhere/icd.json")


def test_a_frame_is_shown_under_its_own_exposure(model: RelightModel):
    frame = Relighter(model).render(model.lights[0])
    assert (show_frame_u8(frame) == display_u8(frame.radiance, model.exposure)).all()
    assert (show_frame_u8(frame, 2.0) == show_frame_u8(frame.radiance, 2.0)).all()


@needs_vulkan
def test_open3d_hands_every_pixel_through(renderer: Offscreen):
    # Other sizes make another renderer; a second picture of one size goes through the same.
    for seed, (height, width) in enumerate([(75, 100), (75, 100), (61, 83), (1, 2), (75, 100)]):
        radiance = noise(height, width, seed)
        assert (render_open3d(radiance, 0.9, renderer) == show_frame_u8(radiance, 0.9)).all()


@needs_vulkan
def test_twenty_renderers_in_one_process_one_after_the_other(renderer: Offscreen):
    for index in range(20):
        pixels = show_frame_u8(noise(20 + index, 30), 1.0)
        assert (renderer.render(pixels=pixels) == pixels).all()
    assert renderer._child is not None and renderer._child.poll() is None


@needs_vulkan
def test_another_thread_may_ask(renderer: Offscreen):
    wanted, answers = show_frame_u8(noise(40, 60), 1.0), []
    thread = threading.Thread(target=lambda: answers.append(render_open3d(noise(40, 60), 1.0, renderer)))
    thread.start()
    thread.join()
    assert (answers[0] == wanted).all()


@needs_vulkan
def test_a_renderer_that_dies_or_fails_is_replaced(renderer: Offscreen):
    pixels = show_frame_u8(noise(20, 30), 1.0)
    renderer.render(pixels=pixels)
    assert renderer._child is not None
    renderer._child.kill()
    renderer._child.wait()
    with pytest.raises(DisplayError, match="renderer"):
        renderer.render(pixels=np.zeros(3))  # no picture: an exception in the new child
    assert (renderer.render(pixels=pixels) == pixels).all()


@needs_vulkan
@pytest.mark.slow
def test_a_thousand_frames_leave_memory_and_handles_flat():
    """The driver of Debian 12 leaks 2 MB a picture: it stays in children, which are replaced."""
    pixels = show_frame_u8(noise(60, 80), 1.0)
    processes, sizes = set(), []
    with Offscreen() as renderer:
        for index in range(1000):
            rolled = np.roll(pixels, index, axis=1)
            assert (renderer.render(pixels=rolled) == rolled).all()
            assert renderer._child is not None
            processes.add(renderer._child.pid)
            if index % 100 == 50:
                resident = int(Path("/proc/self/statm").read_text().split()[1]) * 4096
                sizes.append((resident, len(list(Path("/proc/self/fd").iterdir()))))
    memory, handles = zip(*sizes)
    assert max(memory) - min(memory) < 20e6  # allocators breathe; 900 leaked pictures would be 1,900 MB
    assert len(set(handles)) == 1 and len(processes) == 1000 // PICTURES_PER_PROCESS


def test_without_vulkan_the_pixels_are_the_same(no_vulkan: None, caplog: pytest.LogCaptureFixture):
    caplog.set_level("INFO", logger="relight3d")
    radiance = noise(30, 40)
    with Offscreen() as renderer:
        assert (render_open3d(radiance, 1.0, renderer) == show_frame_u8(radiance, 1.0)).all()
        assert renderer._child is None  # nothing was started that could abort
    assert len(caplog.records) == 1 and "Vulkan" in caplog.text and "mesa-vulkan-drivers" in caplog.text


@needs_vulkan
def test_the_mesh_view_is_what_rays_see(model: RelightModel, renderer: Offscreen, monkeypatch: pytest.MonkeyPatch):
    mesh = model.mesh
    colors = (mesh.vertex_normals * 0.5 + 0.5).astype(np.float32)
    eye = mesh.center + np.array([1.2, -3.4, 2.0])
    camera = Camera(120, 90, 150.0, 150.0, 58.0, 47.0, world_from_camera=look_at(eye, mesh.center))
    drawn = render_mesh(mesh, colors, camera, renderer)
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(name, "/nowhere/icd.json")
    traced = render_mesh(mesh, colors, camera)
    assert drawn.shape == traced.shape == (90, 120, 3) and traced.any()
    apart = np.abs(drawn.astype(int) - traced).max(axis=2)
    assert np.mean(apart > 2) < 0.02  # outlines, where a pixel's centre falls to one side or the other


def test_frames_are_written_by_their_name(model: RelightModel, tmp_path: Path):
    frame = Relighter(model).render(model.lights[0])
    write_frame(tmp_path / "a.png", frame)
    shown, _ = read_image(tmp_path / "a.png")
    assert (np.rint(shown * 255) == show_frame_u8(frame)).all()
    write_frame(tmp_path / "a.exr", frame)
    linear, _ = read_image(tmp_path / "a.exr")
    np.testing.assert_allclose(linear, frame.radiance, rtol=1e-3, atol=1e-6)  # half floats keep 11 bits
    with pytest.raises(InputError, match=r"\.png or \.exr"):
        write_frame(tmp_path / "a.bmp", frame)


def test_the_probe_names_what_is_missing(no_vulkan: None):
    problem, hint = vulkan_trouble()
    assert "Vulkan" in problem and "install" in hint


def test_frames_do_not_load_open3d():
    # In a process of its own: other tests of the same session do load it.
    code = "import sys, relight3d.display.frames; sys.exit('open3d' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

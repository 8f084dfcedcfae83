"""Sequences of frames, and environment maps as lights."""

from pathlib import Path

import numpy as np
import pytest

from relight3d.errors import InputError
from relight3d.io.exr import read_exr, write_exr
from relight3d.lights import DirectionalLight
from relight3d.relight.environment import lights_from_environment
from relight3d.relight.relighter import Relighter
from relight3d.relight.sequence import frames_of_sequence, render_sequence
from tests.relight import models

PATH = [[DirectionalLight((0.2 * k, 0.3, 1.0), 3.0)] for k in range(4)]


def test_frames_equal_those_rendered_alone(tmp_path: Path) -> None:
    files = render_sequence(models.plain(), PATH, tmp_path)
    alone = Relighter(models.plain())
    for path, lights in zip(files, PATH):
        np.testing.assert_allclose(read_exr(path)[..., :3], alone.render(lights).radiance, rtol=1e-6)


def test_a_second_run_renders_only_what_is_missing(tmp_path: Path) -> None:
    done: list[int] = []
    files = render_sequence(models.plain(), PATH, tmp_path, progress=lambda n, _: done.append(n))
    assert done == [1, 2, 3, 4]
    stamps = [path.stat().st_mtime_ns for path in files]
    files[2].unlink()
    render_sequence(models.plain(), PATH, tmp_path, progress=lambda n, _: done.append(n))
    assert done == [1, 2, 3, 4, 4]
    assert [path.stat().st_mtime_ns == stamp for path, stamp in zip(files, stamps)] == [True, True, False, True]


def test_other_lights_are_rendered_anew(tmp_path: Path) -> None:
    render_sequence(models.plain(), PATH, tmp_path)
    done: list[int] = []
    render_sequence(models.plain(), [*PATH[:3], [models.RED]], tmp_path, progress=lambda n, _: done.append(n))
    assert done == [4]


def test_a_moving_camera() -> None:
    model = models.plain()
    cameras = [models.other_camera(model, turn) for turn in (0.0, 0.1)]
    frames = [frame.radiance for _, frame in frames_of_sequence(model, [[models.SUN]], cameras)]
    for camera, frame in zip(cameras, frames):
        np.testing.assert_array_equal(Relighter(model, camera).render([models.SUN]).radiance, frame)


def test_unequal_lengths_are_refused() -> None:
    with pytest.raises(InputError):
        list(frames_of_sequence(models.plain(), PATH, [models.plain().camera] * 3))


# ----------------------------------------------------------------------------------------------- environment


@pytest.mark.parametrize("num", [1, 7, 64])
def test_lights_send_what_the_map_sends(num: int) -> None:
    # A constant map of radiance 1 sends 4 pi from all sides.
    lights = lights_from_environment(np.ones((16, 32, 3)), num)
    assert len(lights) == num
    np.testing.assert_allclose(sum(light.power for light in lights), 4 * np.pi, rtol=1e-6)


def test_a_flat_surface_under_a_constant_sky() -> None:
    # Radiance 1 over the upper half gives irradiance pi on the ground; the lights' cosines sum to it.
    sky = np.ones((64, 128, 3))
    sky[32:] = 0
    lights = lights_from_environment(sky, 256)
    total = sum(light.power[0] * light.to_light[2] for light in lights)
    np.testing.assert_allclose(total, np.pi, rtol=0.01)


def test_a_small_sun_is_where_it_is(tmp_path: Path) -> None:
    sky = np.zeros((90, 180, 3), np.float32)
    sky[30, 60] = 100.0  # 30.5 rows of 2 degrees from +z; 29.5 columns left of the middle
    write_exr(tmp_path / "sky.exr", sky)
    (light,) = lights_from_environment(tmp_path / "sky.exr", 8)
    polar, azimuth = np.deg2rad(61.0), np.deg2rad(59.0)
    wanted = (np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar))
    np.testing.assert_allclose(light.to_light, wanted, atol=1e-6)


@pytest.mark.parametrize(
    "bad", [np.ones((4, 8)), np.full((4, 8, 3), np.nan), -np.ones((4, 8, 3)), np.ones((0, 8, 3))], ids=str
)
def test_bad_maps_are_refused(bad: np.ndarray) -> None:
    with pytest.raises((InputError, TypeError)):
        lights_from_environment(bad)

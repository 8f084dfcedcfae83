"""CAMERA.json and LIGHTS.json: single ones, sequences, and what is missing taken from the capture."""

import json
from pathlib import Path

import numpy as np
import pytest

from relight3d.camera import Camera, look_at
from relight3d.errors import InputError
from relight3d.io.cameras import read_camera, read_cameras
from relight3d.io.light_files import read_lights
from relight3d.lights import DirectionalLight, PointLight, SpotLight

LIKE = Camera(40, 30, 50.0, 51.0, 20.5, 14.0, k1=0.02)
POSE = look_at(np.array([1.0, 2.0, 3.0]), np.zeros(3)).tolist()


def write(path: Path, value: object) -> Path:
    path.write_text(json.dumps(value))
    return path


def test_a_camera_takes_what_it_lacks_from_the_capture(tmp_path: Path) -> None:
    camera = read_camera(write(tmp_path / "CAMERA.json", {"transform_matrix": POSE}), LIKE)
    assert camera.intrinsics == LIKE.intrinsics
    np.testing.assert_array_equal(camera.world_from_camera, POSE)
    zoomed = read_camera(write(tmp_path / "CAMERA.json", {"transform_matrix": POSE, "fl_x": 99, "k1": 0}), LIKE)
    assert (zoomed.fx, zoomed.fy, zoomed.k1, zoomed.width) == (99, 51.0, 0, 40)


def test_a_size_alone_is_the_same_view_in_other_pixels(tmp_path: Path) -> None:
    camera = read_camera(write(tmp_path / "CAMERA.json", {"transform_matrix": POSE, "w": 80, "h": 60}), LIKE)
    assert camera.intrinsics[:6] == (80, 60, 100.0, 102.0, 41.0, 28.0)
    np.testing.assert_array_equal(camera.world_from_camera, POSE)


def test_a_list_of_cameras_is_a_path(tmp_path: Path) -> None:
    path = write(tmp_path / "PATH.json", [{"transform_matrix": POSE}, {"transform_matrix": np.eye(4).tolist()}])
    cameras, is_sequence = read_cameras(path, LIKE)
    assert is_sequence and len(cameras) == 2
    with pytest.raises(InputError, match=r"PATH.json: got a list of 2 cameras"):
        read_camera(path, LIKE)


CAMERA_SLIPS = [
    ([], "CAMERA.json: got an empty list"),
    ({}, "CAMERA.json: got {}"),
    ({"w": 3}, "CAMERA.json transform_matrix: got nothing"),
    ([{"transform_matrix": POSE}, 3], r"CAMERA.json \[1\]: got 3"),
    ([{"transform_matrix": POSE, "fl_x": 0}], r"CAMERA.json \[0\].fl_x: got 0"),
    ({"transform_matrix": POSE, "w": 1e9}, "CAMERA.json w: .*at most 65536"),
    ({"transform_matrix": POSE, "k1": -50.0}, r"CAMERA.json k1, k2, p1, p2: got \(-50.0, .*can be undone"),
]


@pytest.mark.parametrize(("value", "words"), CAMERA_SLIPS)
def test_a_slip_in_a_camera_is_named(tmp_path: Path, value: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_cameras(write(tmp_path / "CAMERA.json", value), LIKE)


SUN = DirectionalLight((0.0, 0.6, 0.8), (3.0, 2.0, 1.0))
LAMP = PointLight((1.0, 2.0, 3.0), (4.0, 4.0, 4.0))
SPOT = SpotLight((1.0, 2.0, 3.0), (0.0, 0.0, -1.0), (5.0, 5.0, 5.0), 0.2, 0.4)


def test_lights_of_one_frame_and_of_a_sequence(tmp_path: Path) -> None:
    path = tmp_path / "LIGHTS.json"
    frames, is_sequence = read_lights(write(path, [light.to_dict() for light in (SUN, LAMP, SPOT)]))
    assert not is_sequence and [light.to_dict() for light in frames[0]] == [x.to_dict() for x in (SUN, LAMP, SPOT)]
    frames, is_sequence = read_lights(write(path, [[SUN.to_dict()], [], [LAMP.to_dict(), SPOT.to_dict()]]))
    assert is_sequence and [len(lights) for lights in frames] == [1, 0, 2]
    assert read_lights(write(path, [])) == ([[]], False)


LIGHT_SLIPS = [
    (SUN.to_dict(), "LIGHTS.json: got {'type'"),
    ([SUN.to_dict(), 3], r"LIGHTS.json \[1\]: got 3"),
    ([[SUN.to_dict()], [SUN.to_dict(), SUN.to_dict() | {"to_light": [0, 0, 0]}]], r"LIGHTS.json \[1\]\[1\].to_light: "),
    ([[SUN.to_dict()], SUN.to_dict()], r"LIGHTS.json \[0\]: got \["),
    ([{"type": "point", "intensity": 1}], r"LIGHTS.json \[0\].position: got nothing, expected three finite numbers"),
    ([SUN.to_dict() | {"colour": 3}], r"LIGHTS.json \[0\].colour: got 3, expected a key of a directional light: to_li"),
    ([SPOT.to_dict() | {"outer_cone_angle": "wide"}], r"LIGHTS.json \[0\].outer_cone_angle: got 'wide'"),
    ([SPOT.to_dict() | {"outer_cone_angle": 0.1}], r"LIGHTS.json \[0\].inner_cone_angle, outer_cone_angle: "),
]


@pytest.mark.parametrize(("value", "words"), LIGHT_SLIPS)
def test_a_slip_in_a_light_is_named(tmp_path: Path, value: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_lights(write(tmp_path / "LIGHTS.json", value))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none.json: got No such file"):
        read_lights(tmp_path / "none.json")

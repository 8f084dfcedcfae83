"""Captures that do not mean what they say are told from those that do, and what is wrong is named."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.evaluate import disturb
from relight3d.io.capture import load_capture
from relight3d.io.images import image_bits, write_png
from relight3d.lights import DirectionalLight, Light
from relight3d.maths.color import display_u8
from relight3d.records import Capture, Photograph
from relight3d.recover.conventions import ConventionOptions, doubts_of
from relight3d.recover.run import recover
from tests.plan.models import QUICK, plain_capture, rich_capture
from tests.scenes import desk_capture

TRUST = ConventionOptions(trust=True)
TINY = Path("data/desk_tiny")
EXPOSURES = (1.0, 0.6, 1.5, 0.8, 1.3, 0.55, 1.1, 0.7, 1.45, 0.9, 0.65, 1.25)


@cache
def with_lamps() -> Capture:
    """The desk under point lights."""
    return desk_capture(12, glossy=True, ambient=0.3, distance=3.0, lights_off=True)


def turned_lights(capture: Capture, turn: np.ndarray) -> Capture:
    """Lights given in another frame."""

    def turned(light: Light) -> Light:
        if isinstance(light, DirectionalLight):
            return replace(light, to_light=tuple(turn @ np.asarray(light.to_light)))
        return replace(light, position=tuple(turn @ np.asarray(light.position)))

    return each_training(capture, lambda p: replace(p, lights=tuple(turned(light) for light in p.lights)))


def each_training(capture: Capture, change: Callable[[Photograph], Photograph]) -> Capture:
    photographs = tuple(change(p) if p.split == "train" else p for p in capture.photographs)
    return replace(capture, photographs=photographs)


def in_order(capture: Capture, order: Callable[[list], list]) -> Capture:
    """The lit training photographs' lights in another order."""
    lit = [p for p in capture.split("train") if p.lights]
    lights = dict(zip((p.name for p in lit), order([p.lights for p in lit])))
    return each_training(capture, lambda p: replace(p, lights=lights.get(p.name, p.lights)))


def scaled_mesh(capture: Capture, factor: float) -> Capture:
    return replace(capture, mesh=replace(capture.mesh, vertices=capture.mesh.vertices * factor))


def with_camera(capture: Capture, change: Callable[[Camera], Camera]) -> Capture:
    camera = change(capture.camera)
    return each_training(replace(capture, camera=camera), lambda p: replace(p, camera=camera))


def with_exposures(capture: Capture) -> Capture:
    gains = dict(zip((p.name for p in capture.split("train") if p.lights), EXPOSURES))
    return each_training(capture, lambda p: replace(p, pixels=(p.pixels * gains.get(p.name, 1.0)).astype(np.float32)))


def in_8_bits(capture: Capture, folder: Path, color_space: str, encoded: bool) -> Capture:
    """The training photographs as PNG files."""
    white = max(float(np.percentile(p.pixels, 99.5)) for p in capture.split("train"))

    def written(photograph: Photograph) -> Photograph:
        linear = np.clip(photograph.pixels / white, 0.0, 1.0)
        pixels = display_u8(linear) if encoded else np.rint(linear * 255).astype(np.uint8)
        path = folder / f"{photograph.name}.png"
        write_png(path, pixels)
        return replace(photograph, pixels=None, image_path=path)

    return replace(each_training(capture, written), color_space=color_space)


GOOD = {
    "everything on a desk": rich_capture,
    "two convex things on nothing": plain_capture,
    "point lights": with_lamps,
    "the path-traced desk": lambda: load_capture(TINY),
    "four photographs": lambda: disturb.with_few_lights(rich_capture(), 4),
    "noise": lambda: disturb.with_noise(rich_capture(), 0.05, 0.05),
    "one blocked lamp": lambda: disturb.with_blocked_light(rich_capture(), 2),
    "one wrong light": lambda: disturb.with_wrong_light(rich_capture(), 2, 60.0),
    "lights 8 degrees off": lambda: disturb.with_light_error(rich_capture(), 8.0),
    "a mesh beside its place": lambda: disturb.with_misplaced_mesh(rich_capture(), 3.0, 2.0),
    "a rough mesh": lambda: disturb.with_rough_mesh(rich_capture(), 0.01),
    "far from the origin": lambda: disturb.with_far_origin(rich_capture(), (4e5, 5e6, 200.0)),
}


@pytest.mark.parametrize("name", GOOD)
def test_nothing_is_said_of_a_good_capture(name: str) -> None:
    assert doubts_of(GOOD[name]()) == ()


POSE = rich_capture().camera.world_from_camera[:3, :3]
# A capture that is hopeless as it is given, the field to name, and words of what to do.
HOPELESS = {
    "lights negated": (lambda: turned_lights(rich_capture(), -np.eye(3)), "lights", "negate it"),
    "lights in the camera's axes": (lambda: turned_lights(rich_capture(), POSE.T), "lights", "transform_matrix"),
    "lights y up": (
        lambda: turned_lights(rich_capture(), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])),
        "lights",
        "(x, -z, y)",
    ),
    "lamps y up": (
        lambda: turned_lights(with_lamps(), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])),
        "lights",
        "(x, -z, y)",
    ),
    "lights of the next": (lambda: in_order(rich_capture(), lambda x: x[1:] + x[:1]), "lights", "shift them by one"),
    "lights reversed": (lambda: in_order(rich_capture(), lambda x: x[::-1]), "lights", "reverse"),
    "a mesh in millimetres": (lambda: scaled_mesh(rich_capture(), 1000.0), "mesh_path", "0.001"),
    "a mesh in millimetres, lamps": (lambda: scaled_mesh(with_lamps(), 1000.0), "mesh_path", "0.001"),
    "pictures upside down": (
        lambda: each_training(rich_capture(), lambda p: replace(p, pixels=p.pixels[::-1, ::-1].copy())),
        "photographs",
        "turned by 180",
    ),
    "half the focal length": (
        lambda: with_camera(rich_capture(), lambda c: replace(c, fx=0.5 * c.fx, fy=0.5 * c.fy)),
        "fl_x, fl_y",
        "2 times as long",
    ),
}


@pytest.mark.parametrize("name", HOPELESS)
def test_what_is_hopeless_is_refused_with_the_reading_that_fits(name: str) -> None:
    make, field, words = HOPELESS[name]
    with pytest.raises(InputError) as raised:
        doubts_of(make())
    line = str(raised.value)
    assert raised.value.field == f"transforms.json {field}" and words in line and "\n" not in line, line
    (trusted,) = doubts_of(make(), TRUST)
    assert trusted.startswith(field) and words in trusted, trusted


def test_of_few_photographs_there_is_no_verdict() -> None:
    flipped = turned_lights(rich_capture(), -np.eye(3))
    assert doubts_of(disturb.with_few_lights(flipped, 3)) == ()


def test_exposures_that_differ_are_named() -> None:
    (line,) = doubts_of(with_exposures(rich_capture()))
    assert line.startswith("photographs: exposures differ")
    named = dict(part.split(" x") for part in line[line.index("(") + 1 : line.index(")")].split(", ") if " x" in part)
    assert len(named) == 8
    # Up to one factor for all, which is the median's: the middle of these exposures is 0.95.
    for name, gain in named.items():
        wanted = EXPOSURES[int(name[-3:])] / np.median(EXPOSURES)
        assert float(gain) == pytest.approx(wanted, rel=0.15), line
    assert line in recover(with_exposures(rich_capture()), QUICK, quiet=True).warnings


@pytest.mark.parametrize(("color_space", "encoded"), [("linear", True), ("srgb", False)])
def test_the_other_curve_is_recognised(tmp_path: Path, color_space: str, encoded: bool) -> None:
    (line,) = doubts_of(in_8_bits(plain_capture(), tmp_path, color_space, encoded))
    other = {"linear": "srgb", "srgb": "linear"}[color_space]
    assert line.startswith(f'color_space: "{color_space}"') and f'set it to "{other}"' in line


@pytest.mark.parametrize(("color_space", "encoded"), [("linear", False), ("srgb", True)])
def test_the_right_curve_is_left_alone(tmp_path: Path, color_space: str, encoded: bool) -> None:
    assert doubts_of(in_8_bits(plain_capture(), tmp_path, color_space, encoded)) == ()


def test_8_bits_said_to_be_linear_are_remarked_where_the_photographs_do_not_tell(tmp_path: Path) -> None:
    few = disturb.with_few_lights(plain_capture(), 5)
    (line,) = doubts_of(in_8_bits(few, tmp_path, "linear", encoded=True))
    assert line.startswith('color_space: "linear" for 8-bit files is rare')


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_bits_of_a_file(tmp_path: Path, dtype: type) -> None:
    write_png(tmp_path / "a.png", np.zeros((3, 4, 3), dtype))
    assert image_bits(tmp_path / "a.png") == 8 * np.dtype(dtype).itemsize


@pytest.mark.parametrize("make", [rich_capture, with_lamps])
def test_a_mesh_that_is_a_speck_may_have_another_unit(make: Callable[[], Capture]) -> None:
    (line,) = doubts_of(scaled_mesh(make(), 0.1))
    assert line.startswith("mesh_path: a mesh seen by ") and "one unit" in line


def test_lights_in_no_order_at_all_are_remarked() -> None:
    """Lights in no particular order: nothing to name, but nothing to be silent about."""
    (line,) = doubts_of(in_order(rich_capture(), lambda x: [x[(5 * k + 2) % len(x)] for k in range(len(x))]))
    assert line.startswith("lights: shading that agrees with the photographs by ") and "check the lights' frame" in line


def test_lights_turned_about_an_axis_are_recognised() -> None:
    angle = np.radians(60.0)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    with pytest.raises(InputError, match="lights turned by about -60° about z"):
        doubts_of(turned_lights(rich_capture(), turn))

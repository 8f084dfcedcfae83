"""Whatever stands in the JSON, loading answers with a capture or with one InputError of one line."""

import copy
import json
import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.io.cameras import read_cameras
from relight3d.io.light_files import read_lights
from tests.io.folders import CaptureFolder, make_capture_folder

NUMBERS = st.one_of(
    st.integers(-3, 8), st.floats(), st.just(10**400), st.sampled_from([1e-320, 1e-200, 1e155, 1e300, -0.0, math.nan])
)
JSON = st.recursive(
    st.none()
    | st.booleans()
    | NUMBERS
    | st.text(max_size=5)
    | st.sampled_from(["directional", "spot", "train", ".", "/"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)
VECTORS = st.lists(NUMBERS, min_size=3, max_size=3)
LIGHTS = st.fixed_dictionaries(
    {"type": st.sampled_from(["directional", "point", "spot", "sphere", "rectangle"])},
    optional={
        "to_light": VECTORS,
        "irradiance": VECTORS | NUMBERS,
        "position": VECTORS,
        "intensity": VECTORS | NUMBERS,
        "direction": VECTORS,
        "inner_cone_angle": NUMBERS | JSON,
        "outer_cone_angle": NUMBERS | JSON,
        "radius": NUMBERS | JSON,
        "edge_u": VECTORS,
        "edge_v": VECTORS,
    },
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> CaptureFolder:
    return make_capture_folder(tmp_path_factory.mktemp("fuzz"))


def places(value: object, at: tuple = ()) -> list[tuple]:
    """Every place in a JSON value, the root left out."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, item in items for place in [(*at, key), *places(item, (*at, key))]]


def answers(load) -> None:
    try:
        load()
    except InputError as error:
        assert "\n" not in str(error) and ": got " in str(error)


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_a_capture_with_one_to_three_fields_spoilt(folder: CaptureFolder, data: st.DataObject) -> None:
    top = copy.deepcopy(folder.top)
    for _ in range(data.draw(st.integers(1, 3))):
        *above, last = data.draw(st.sampled_from(places(top)))
        inner = top
        for key in above:
            inner = inner[key]
        if data.draw(st.booleans()):
            inner[last] = data.draw(JSON | NUMBERS | LIGHTS)
        else:
            del inner[last]
        if not places(top):
            break
    answers(CaptureFolder(folder.path, top).load)


@settings(max_examples=50, deadline=None)
@given(value=JSON)
def test_any_json_for_a_capture(folder: CaptureFolder, value: object) -> None:
    answers(CaptureFolder(folder.path, value).load)  # type: ignore[arg-type]


@settings(max_examples=100, deadline=None)
@given(value=JSON | st.lists(LIGHTS | JSON, max_size=3) | st.lists(st.lists(LIGHTS, max_size=2), max_size=3))
def test_any_json_for_lights_and_cameras(folder: CaptureFolder, value: object) -> None:
    path: Path = folder.path / "ANY.json"
    path.write_text(json.dumps(value))
    answers(lambda: read_lights(path))
    answers(lambda: read_cameras(path, Camera(4, 3, 5.0, 5.0, 2.0, 1.5)))

"""evaluate(): which frames and pixels count, what the baselines may do, and what comes out."""

import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.evaluate.baselines import BASELINES
from relight3d.evaluate.metrics import PSNR_CEILING_DB
from relight3d.evaluate.run import Evaluation, evaluate
from relight3d.evaluate.scenes import Scene
from relight3d.evaluate.synthetic import synthesize
from relight3d.evaluate.truth import true_model, truth_of
from relight3d.records import Capture, Frame, RelightModel, Stats
from tests.scenes import desk, desk_capture

OPTIONS = dict(num_lights=8, glossy=True, ambient=0.2, bounce=False, lights_off=True)


@pytest.fixture(scope="module")
def capture() -> Capture:
    return desk_capture(**OPTIONS)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return desk(glossy=True, ambient=0.2)


@pytest.fixture(scope="module")
def model(scene: Scene) -> RelightModel:
    return true_model(scene)


@pytest.fixture(scope="module")
def renderer(scene: Scene) -> Iterator[dict]:
    """In place of the real one: the truth, with an error on demand, so that evaluate() is tested and nothing else."""
    settings = {}

    class Relighter:
        def __init__(self, model: RelightModel, camera: Camera | None = None, options: object = None) -> None:
            self.camera = camera if camera is not None else model.camera
            settings["cameras"].append(self.camera)
            settings["options"].append(options)

        def render(self, lights: list) -> Frame:
            view = replace(scene, camera=self.camera)
            pixels = synthesize(view, [lights]).photographs[0].pixels * np.float32(settings["gain"])
            if settings["hole"]:
                pixels[20, 30] = np.nan
            return Frame(pixels, truth_of(view).is_hit, 1.0, Stats({}, {}))

    module = ModuleType("relighter")
    module.Relighter = Relighter
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "relight3d.relight.relighter", module)
        yield settings


@pytest.fixture
def fake_relighter(renderer: dict) -> dict:
    """The renderer's settings, as they are without any error."""
    renderer.update(gain=1.0, hole=False, cameras=[], options=[])
    return renderer


@pytest.fixture(scope="module")
def result(renderer: dict, model: RelightModel, capture: Capture) -> Evaluation:
    renderer.update(gain=1.0, hole=False, cameras=[], options=[])
    return evaluate(model, capture)


def test_a_perfect_model_and_the_baselines(result: Evaluation):
    assert result.model.mean.psnr_db == PSNR_CEILING_DB and result.model.mean.num_frames == 5
    assert set(result.baselines) == set(BASELINES)
    for metrics in result.baselines.values():
        # They cannot do the new viewpoint, and eight lights do not give them shadows.
        assert [frame.group for frame in metrics.frames] == ["light"] * 4
        assert 10.0 < metrics.mean.psnr_db < 35.0
    same_pixels = {frame.name: frame.num_pixels for frame in result.model.frames}
    assert all(frame.num_pixels == same_pixels[frame.name] for frame in result.baselines["rbf"].frames)


def test_another_capture_of_the_scene_has_a_view_of_its_own(
    fake_relighter: dict, scene: Scene, model: RelightModel, capture: Capture
):
    """Its baselines are judged at its own captured view, the surfaces where the model's pixels are."""
    small = replace(scene, camera=scene.camera.resized(32, 24))
    lights = [photograph.lights for photograph in capture.split("train")]
    other = synthesize(small, lights, test_lights=lights[:1])
    result = evaluate(model, other)
    assert result.model.mean.psnr_db == PSNR_CEILING_DB and result.surfaces == ()
    assert set(result.baselines) == set(BASELINES)
    own = replace(other, photographs=(*other.photographs, *capture.split("test")))
    surfaces = {surface.name: surface.psnr_db for surface in evaluate(model, own).surfaces}
    assert surfaces == dict.fromkeys(("table", "box", "sphere"), PSNR_CEILING_DB)


def test_an_error_of_known_size(fake_relighter: dict, model: RelightModel, capture: Capture):
    fake_relighter["gain"] = 1.05
    result = evaluate(model, capture, baselines=False)
    assert result.baselines == {}
    assert result.model.mean.relative_rmse == pytest.approx(0.05, rel=1e-4)
    assert 30.0 < result.model.mean.psnr_db < 45.0
    per_surface = {surface.name: surface for surface in result.surfaces}
    assert set(per_surface) == {"table", "box", "sphere"}
    assert per_surface["sphere"].kinds == ("diffuse", "glossy")
    assert all(30.0 < s.worst_psnr_db <= s.psnr_db < 50.0 for s in result.surfaces)
    assert sum(s.num_pixels for s in result.surfaces) == result.model.frames[0].num_pixels


def test_masked_pixels_do_not_count(fake_relighter: dict, model: RelightModel, capture: Capture):
    mask = np.ones((48, 64), bool)
    mask[:, :30] = False
    spoiled = []
    for photograph in capture.photographs:
        pixels = photograph.pixels.copy()
        pixels[~mask] = 1e3
        spoiled.append(replace(photograph, pixels=pixels, is_valid=mask))
    result = evaluate(model, replace(capture, photographs=tuple(spoiled)))
    assert result.model.mean.psnr_db == PSNR_CEILING_DB
    assert result.model.frames[0].num_pixels == (truth_of(desk(glossy=True)).is_hit & mask).sum()
    assert result.baselines["rbf"].mean.psnr_db > 10.0


def test_a_pixel_that_some_photographs_lack(
    fake_relighter: dict, model: RelightModel, capture: Capture, result: Evaluation
):
    """A saturated pixel masked in one training photograph still has a prediction."""
    photographs = list(capture.photographs)
    mask = np.ones((48, 64), bool)
    mask[20:25] = False
    photographs[0] = replace(photographs[0], is_valid=mask)
    lacking = evaluate(model, replace(capture, photographs=tuple(photographs)))
    rbf, whole_rbf = lacking.baselines["rbf"], result.baselines["rbf"]
    assert rbf.frames[0].num_pixels == whole_rbf.frames[0].num_pixels
    assert rbf.mean.psnr_db == pytest.approx(whole_rbf.mean.psnr_db, abs=1.0)


def test_rows_compare_over_the_same_frames(result: Evaluation):
    rows = result.rows()
    assert [(row.method, row.frames) for row in rows] == [
        ("relight3d", "all"),
        ("relight3d", "light"),
        ("relight3d", "viewpoint"),
        ("relight3d", "captured view"),
        *((name, "captured view") for name in BASELINES),
    ]
    assert {row.mean.num_frames for row in rows if row.frames == "captured view"} == {4}
    assert all(row.worst.psnr_db <= row.mean.psnr_db for row in rows)


def test_the_dictionary_is_json_and_finite(result: Evaluation):
    text = json.dumps(result.to_dict(), allow_nan=False)
    assert json.loads(text)["model"]["mean"]["num_frames"] == 5


def test_one_relighter_a_viewpoint(fake_relighter: dict, model: RelightModel, capture: Capture):
    evaluate(model, capture, baselines=False)
    assert len(fake_relighter["cameras"]) == 2
    assert fake_relighter["options"] == [None, None]


def test_a_hole_in_a_rendered_frame_is_an_error(fake_relighter: dict, model: RelightModel, capture: Capture):
    fake_relighter["hole"] = True
    with pytest.raises(InputError, match="frame test_000: rendered radiance: got 1 pixels with NaN"):
        evaluate(model, capture)


def test_an_unknown_split_names_those_there_are(fake_relighter: dict, model: RelightModel, capture: Capture):
    with pytest.raises(InputError, match="split: got validation, expected one of test, train"):
        evaluate(model, capture, split="validation")

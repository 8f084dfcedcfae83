"""A study measures each setting once, keeps to its time, and names what dominates what."""

import csv
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from relight3d.errors import InputError
from relight3d.evaluate import study as module
from relight3d.evaluate import study_settings
from relight3d.evaluate.study import study
from relight3d.evaluate.study_captures import brought_to, halved, with_photographs
from relight3d.evaluate.study_front import dominated, key_of, on_one_clock
from relight3d.evaluate.study_growth import growth_of
from relight3d.evaluate.study_measure import Point
from relight3d.evaluate.study_report import COLUMNS, FRONT, cells_of, csv_of, markdown_of
from relight3d.evaluate.study_settings import RECOVERY, RENDER, Setting, changed, ladder
from relight3d.recover.run import RecoverOptions
from relight3d.relight.options import RelightOptions
from tests.plan.models import rich_model
from tests.scenes import desk_capture

FEW = [
    Setting(RENDER, "default", "default"),
    Setting(RECOVERY, "default", "default", {}),
    Setting(RENDER, "shadows", "none", {"shadows": "off"}),
    Setting(RENDER, "resolution", "half", resolution=0.5),
    Setting(RECOVERY, "photographs", "6 photographs", photographs=6),
    Setting(RECOVERY, "residual", "none", {"residual.max_modes": 0}),
]


def point(name: str, cost: float, psnr_db: float, family: str = RENDER, **more: object) -> Point:
    figure = {"frame_ms" if family == RENDER else "recovery_s": float(cost)}
    return Point(family, "factor", name, float(psnr_db), psnr_db - 3.0, 0.9, 0.1, 0.1, 4, **figure, **more)


@pytest.fixture
def few_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short ladder, in haste."""
    hasty = changed(RecoverOptions(), {"mesh.target_faces": 1000, "num_rounds": 0, "num_alternations": 1})
    monkeypatch.setattr(module, "ladder", lambda num, quick: FEW)
    monkeypatch.setattr(study_settings, "RecoverOptions", lambda: hasty)


def test_a_point_is_dominated_by_one_as_cheap_and_as_accurate() -> None:
    points = [point("a", 1, 20), point("b", 2, 30), point("c", 3, 29), point("d", 4, 40), point("e", 4, 40)]
    assert dominated(points)[1] == ("", "", "factor: b", "", "")
    assert dominated([*points, point("best", 0.5, 50)])[1][:5] == ("factor: best",) * 5


def test_a_setting_within_the_error_of_its_own_time_is_not_dominated() -> None:
    beside = {"frame_low_ms": 1.9, "frame_high_ms": 2.2}  # the median's error is 0.09 ms
    points = [point("a", 1.95, 30), point("b", 2.0, 30, **beside), point("c", 2.2, 30, **beside)]
    assert dominated(points)[1] == ("", "", "factor: a")
    assert dominated([point("a", 1.95, 30.1), points[1]])[1] == ("", "factor: a")


def test_the_ladder_varies_one_thing_and_every_option_exists() -> None:
    for quick in (True, False):
        settings = ladder(24, quick)
        assert len({(s.family, s.factor, s.name) for s in settings}) == len(settings)
        for setting in settings:
            options = setting.relight_options(rich_model())
            is_default = setting.recover_options() == RecoverOptions() and options == RelightOptions()
            assert is_default == (not setting.changes and setting.preset is None)
            if setting.factor not in ("combined", "detail", "shadows"):
                assert len(setting.changes) <= 1
    assert len(ladder(24, True)) < len(ladder(24, False))


def test_a_study_goes_on_where_it_stopped(few_settings: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture = desk_capture(8, bounce=False)
    first = study(capture, tmp_path, quick=True)
    assert {p.name for p in first.points} >= {"default", "none", "half", "6 photographs", "ptm", "rbf"}
    assert first.skipped == () and all(np.isfinite(p.psnr_db) for p in first.points)
    by_name = {(p.family, p.factor, p.name): p for p in first.points}
    assert by_name[RENDER, "shadows", "none"].rays < by_name[RENDER, "default", "default"].rays
    assert by_name[RECOVERY, "photographs", "6 photographs"].num_photographs == 6
    for name in ("study.csv", "study.md", "study.html", "study.json", "plots/error_frame.svg"):
        assert (tmp_path / name).stat().st_size > 100
    page = (tmp_path / "study.html").read_text()
    links = re.findall(r'(?:src|href)="[^#]|url\([^#]', page)
    assert "<svg" in page and not links, "the page stands on its own"

    def fail(*args: object, **more: object) -> None:
        raise AssertionError("measured again")

    for name in ("measure_recovery", "measure_render", "measure_baselines", "frame_growth"):
        monkeypatch.setattr(module, name, fail)
    assert study(capture, tmp_path, quick=True).points == first.points
    kept = sorted((tmp_path / "settings").glob("*.json"))[0]
    whole = kept.read_bytes()
    kept.write_bytes(whole[:-9])  # by a disk, or by hand
    with pytest.raises(AssertionError, match="measured again"):
        study(capture, tmp_path, quick=True)
    kept.write_bytes(whole)
    with pytest.raises(AssertionError, match="measured again"):
        study(desk_capture(9, bounce=False), tmp_path, quick=True)


def test_what_the_time_budget_leaves_out_is_named(few_settings: None) -> None:
    result = study(desk_capture(8, bounce=False), quick=True, budget_s=0.0)
    assert [p.factor for p in result.points] == ["default", "default"]
    assert len(result.skipped) == 4 and "render, shadows: none" in result.skipped


def test_a_capture_without_held_out_photographs_is_refused() -> None:
    capture = desk_capture(8, bounce=False)
    with pytest.raises(InputError, match="held-out"):
        study(replace(capture, photographs=capture.split("train")))


def test_tables_say_what_dominates_what() -> None:
    points = (point("a", 2, 30), point("b", 3, 29), point("c", 40, 33, RECOVERY, recovery_mb=12.0))
    result = module.Study(
        "desk", points, ("render, lobes: none",), (growth_of("frame", "lights", (1, 2), (1, 2)),), 1.0
    )
    assert [row[-1] for row in cells_of(result, RENDER)] == [FRONT, "factor: a"]
    assert all(len(row) == len(COLUMNS) for row in cells_of(result, RENDER))
    rows = list(csv.DictReader(io.StringIO(csv_of(result))))
    assert [row["dominated_by"] for row in rows] == ["", "factor: a", ""] and float(rows[2]["recovery_mb"]) == 12.0
    text = markdown_of(result)
    assert "render, lobes: none" in text and "power 1.00" in text
    assert key_of(points[1]) in result.dominators() and json.dumps(result.to_dict())


def test_times_are_brought_to_one_clock() -> None:
    fast = point("fast", 5, 30, default_ms=10.0, frame_low_ms=4.0, frame_high_ms=6.0)
    loaded = point("fast while another program ran", 10, 30, default_ms=20.0)
    once, twice = on_one_clock([fast, loaded])
    assert once.frame_ms / twice.frame_ms == pytest.approx(1.0)
    assert once.frame_low_ms / once.frame_ms == pytest.approx(0.8)


def test_growth_finds_the_exponent_and_tells_quadratic_from_linear() -> None:
    sizes = np.array([1e3, 1e4, 1e5, 1e6])
    linear = growth_of("frame", "pixels", sizes.tolist(), (2e-4 * sizes * np.log(sizes)).tolist())
    assert linear.exponent == pytest.approx(1.1, abs=0.05) and linear.is_at_most_linear
    square = growth_of("frame", "pixels", sizes.tolist(), (1e-9 * sizes**2).tolist())
    assert square.exponent == pytest.approx(2.0) and not square.is_at_most_linear


def test_smaller_captures_keep_what_they_show() -> None:
    capture = desk_capture(8, lights_off=True, ambient=0.2)
    fewer = with_photographs(capture, 3)
    assert sum(bool(p.lights) for p in fewer.split("train")) == 3 and len(fewer.split("test")) == len(
        capture.split("test")
    )
    assert any(not p.lights for p in fewer.split("train"))
    half = halved(capture)
    assert half.camera.width == capture.camera.width // 2
    got, wanted = half.photographs[0].pixels, capture.photographs[0].pixels
    assert got.mean() == pytest.approx(wanted.mean(), rel=1e-5)
    flat = np.full((5, 7, 3), 0.3, np.float32)
    assert np.allclose(brought_to(flat, (10, 14)), 0.3)

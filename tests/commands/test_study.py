"""relight3d study: its arguments reach the study, and the front is printed. What it measures is tested in evaluate."""

from pathlib import Path

import pytest

import relight3d
from relight3d.evaluate.study import Study
from relight3d.evaluate.study_measure import Point
from tests.commands.asserts import TINY, assert_one_line


def point(family: str, name: str, psnr_db: float, cost: float) -> Point:
    costs = {"recovery_s": cost} if family == "recovery" else {"frame_ms": cost}
    return Point(family, "factor", name, psnr_db, psnr_db - 3, 0.9, 0.1, 0.1, 4, **costs)


def test_the_front_is_printed_cheapest_first(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def study(capture: relight3d.Capture, folder: Path, quick: bool, budget_s: float | None, progress) -> Study:
        asked.append((len(capture.photographs), folder, quick, budget_s))
        progress("render, factor: best", 0.5)
        points = [point("render", "best", 35.0, 9.0), point("render", "cheap", 30.0, 2.0)]
        points += [point("render", "beaten", 29.0, 3.0), point("recovery", "only", 35.0, 20.0)]
        return Study("tiny", tuple(points), ("render, factor: late",), (), 12.0)

    monkeypatch.setattr("relight3d.study", study, raising=False)
    status, out, err = run("study", TINY, "-o", tmp_path / "study", "--quick", "--budget-s", 40)
    assert status == 0 and asked == [(18, tmp_path / "study", True, 40.0)]
    assert out.index("factor: cheap") < out.index("factor: best") and "beaten" not in out
    assert "20.00 s" in out and "2.00 ms" in out and "no time for 1 of the settings" in err


@pytest.mark.parametrize("budget", ["nan", "-1"])
def test_a_budget_that_is_no_time_is_refused(run, tmp_path: Path, budget: str) -> None:
    arguments = ("-o", tmp_path / "study", "--budget-s", budget, "--quiet")
    assert_one_line(*run("study", TINY, *arguments)[::2], "budget_s", budget)
    assert not (tmp_path / "study").exists()


def test_a_capture_without_held_out_photographs_is_refused(run, tiny_copy: Path, tmp_path: Path) -> None:
    file = tiny_copy / "transforms.json"
    file.write_text(file.read_text().replace('"test"', '"other"'))
    status, _, err = run("study", tiny_copy, "-o", tmp_path / "study", "--quiet")
    assert_one_line(status, err, "capture", "held-out")
    assert not (tmp_path / "study").exists()

"""relight3d plan and report: what a person and a program can read of a model."""

import json
from pathlib import Path

from tests.commands.asserts import TINY, assert_one_line, light, write


def test_the_plan_names_effects_and_their_reasons(run, model_file: Path) -> None:
    status, out, err = run("plan", model_file)
    assert (status, err) == (0, "")
    for word in ("shadows", "indirect", "mirror", "gain dB", "why", "frame: "):
        assert word in out, word


def test_the_plan_as_json_is_nothing_else(run, model_file: Path, tmp_path: Path) -> None:
    lights = write(tmp_path / "lights.json", light(0.3, power=0.0))
    status, out, _ = run("plan", model_file, "--json", "--lights", lights, "--preset", "balanced")
    lines = json.loads(out)["lines"]
    assert status == 0 and {"effect", "where", "is_on", "gain_db", "reason"} <= set(lines[0])


def test_an_effect_forced_off_is_off_in_the_plan(run, model_file: Path) -> None:
    _, out, _ = run("plan", model_file, "--json", "--force", "mirror=off")
    mirrors = [line for line in json.loads(out)["lines"] if line["effect"] == "mirror"]
    assert mirrors and not any(line["is_on"] for line in mirrors)


def test_the_report_is_one_page(run, model_file: Path, tmp_path: Path) -> None:
    status, out, _ = run("report", model_file, TINY, "-o", tmp_path / "report")
    page = tmp_path / "report" / "index.html"
    assert status == 0 and str(page) in out and "<html" in page.read_text("utf-8")


def test_the_report_refuses_a_file_for_a_folder(run, model_file: Path, tmp_path: Path) -> None:
    (tmp_path / "report").write_text("a file")
    status, _, err = run("report", model_file, TINY, "-o", tmp_path / "report")
    assert_one_line(status, err, str(tmp_path / "report"))


def test_the_report_refuses_a_study_that_is_not_there(run, model_file: Path, tmp_path: Path) -> None:
    arguments = ("-o", tmp_path / "report", "--study", tmp_path / "none")
    assert_one_line(*run("report", model_file, TINY, *arguments)[::2], "study", "none")
    assert list(tmp_path.iterdir()) == []

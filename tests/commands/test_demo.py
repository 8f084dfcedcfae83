"""relight3d demo, on the tiny desk: everything it promises is there."""

import json
from pathlib import Path

import numpy as np

from relight3d.commands.contact_sheet import Strip, contact_sheet
from relight3d.commands.light_path import round_trip
from relight3d.io.model_file import load_model
from tests.commands.asserts import QUICK, SIZE, TINY, assert_one_line, decoded

RECOVER = [word.replace("--", "--recover.") if word.startswith("--") else word for word in QUICK]


def test_the_demo_leaves_what_it_says(run, tmp_path: Path) -> None:
    status, out, _ = run("demo", "-o", tmp_path / "demo", "--capture", TINY, "--num-frames", 4, *RECOVER)
    assert status == 0 and f"Results are in {tmp_path / 'demo'}" in out
    for name in ("contact_sheet.png", "evaluation.md", "evaluation.json", "relit.mp4", "relit", "model.relight"):
        assert (name in out or name == "evaluation.json") and (tmp_path / "demo" / name).exists(), name
    assert len(decoded(tmp_path / "demo" / "relit.mp4", SIZE)) == 4
    assert "| rbf |" in (tmp_path / "demo" / "evaluation.md").read_text("utf-8")
    assert json.loads((tmp_path / "demo" / "evaluation.json").read_text("utf-8"))["model"]["mean"]["psnr_db"] > 24


def test_without_its_data_it_says_what_to_do(run, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("relight3d.commands.demo.DESK", tmp_path / "data" / "desk")
    status, _, err = run("demo", "-o", tmp_path / "demo", "--capture", tmp_path / "data" / "desk")
    assert_one_line(status, err, "capture", "--capture FOLDER")
    assert not (tmp_path / "demo").exists()


def test_the_light_goes_round_at_its_own_distance(model_file: Path) -> None:
    model = load_model(model_file)
    lights = round_trip(model, 8)
    directions = np.array([light.to_light for light in lights])  # those of the tiny desk are directional
    photographed = np.array([each[0].to_light for each in model.lights if each])
    axis = photographed.mean(axis=0) / np.linalg.norm(photographed.mean(axis=0))
    cosines = directions @ axis
    assert np.ptp(cosines) < 1e-9 and np.isclose(cosines[0], np.sort(photographed @ axis)[len(photographed) // 2])
    assert np.allclose(directions.mean(axis=0), cosines[0] * axis)  # evenly, and all the way


def test_a_sheet_has_a_row_for_each_strip() -> None:
    pictures = np.zeros((48, 64, 3), np.float32), np.ones((48, 64, 3), np.float32)
    one, two = (contact_sheet("title", [Strip("frame", *pictures, 0.0)] * number) for number in (1, 2))
    assert two.shape[0] - one.shape[0] > 48 and two.shape[1] == one.shape[1]
    assert (one == 255).all(axis=2).sum() > 2 * 48 * 64  # photograph and difference are white

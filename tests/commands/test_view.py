"""relight3d view, without a screen: pictures of the layers, and a line where no window can be opened."""

from pathlib import Path

import pytest

from relight3d.errors import DisplayError
from relight3d.io.images import read_image
from tests.commands.asserts import TINY, assert_one_line, light, write


def test_a_screenshot_is_the_relit_frame(run, model_file: Path, tmp_path: Path) -> None:
    lights = write(tmp_path / "lights.json", light(0.3))
    assert run("view", model_file, "--screenshot", tmp_path / "a.png", "--lights", lights)[0] == 0
    assert run("render", model_file, "-o", tmp_path / "b.png", "--lights", lights)[0] == 0
    assert (read_image(tmp_path / "a.png")[0] == read_image(tmp_path / "b.png")[0]).all()


def test_a_layer_can_be_written(run, model_file: Path, tmp_path: Path) -> None:
    arguments = ("--screenshot", tmp_path / "a.png", "--capture", TINY)
    assert run("view", model_file, *arguments, "--layer", "albedo")[0] == 0
    assert read_image(tmp_path / "a.png")[0].std() > 0.01


def test_an_unknown_layer_is_refused(run, model_file: Path, tmp_path: Path) -> None:
    status, _, err = run("view", model_file, "--screenshot", tmp_path / "a.png", "--layer", "albino")
    assert_one_line(status, err, "albino", "albedo")
    status, _, err = run("view", model_file, "--layer", "albedo")
    assert_one_line(status, err, "layer", "--screenshot")
    assert list(tmp_path.iterdir()) == []


def test_no_screen_is_one_line(run, model_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise DisplayError("view", "no screen", "a screen")

    monkeypatch.setattr("relight3d.display.viewer.view", refuse)
    monkeypatch.setattr("relight3d.view", refuse, raising=False)
    assert_one_line(*run("view", model_file)[::2], "no screen")

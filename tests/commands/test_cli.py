"""The command line as such: overview, help, and how it ends."""

from pathlib import Path

import pytest

import relight3d
from relight3d.cli import COMMANDS
from tests.commands.asserts import TINY, assert_one_line, light, write


def test_the_overview_names_every_command(run) -> None:
    status, out, _ = run()
    assert status == 0 and all(f"\n  {name} " in out for name in COMMANDS)
    assert run("--help")[1] == out


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(run, name: str) -> None:
    status, out, err = run(name, "--help")
    assert (status, err) == (0, "") and f"usage: relight3d {name}" in out and "-v, --verbose" in out


def test_the_version_is_printed(run) -> None:
    assert run("--version")[:2] == (0, f"relight3d {relight3d.__version__}\n")


def test_an_unknown_command_is_one_line(run) -> None:
    status, _, err = run("recovr")
    assert_one_line(status, err, "recovr", "perhaps recover")


def test_an_unknown_flag_is_refused_with_the_nearest(run) -> None:
    status, _, err = run("recover", TINY, "-o", "x", "--specular.max-lobs", 3)
    assert_one_line(status, err, "--specular.max-lobes")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("recover",), ["CAPTURE", "--output"]),
        (("render", "a.relight", "--preset", "wrong"), ["wrong", "--preset", "balanced"]),
        (("recover", TINY, "-o", "x", "--num-rounds", "two"), ["--num-rounds", "two"]),
    ],
    ids=["missing", "choice", "number"],
)
def test_arguments_that_cannot_be_read_are_one_line(run, arguments: tuple, words: list[str]) -> None:
    status, _, err = run(*arguments)
    assert_one_line(status, err, *words, f"see relight3d {arguments[0]} --help")


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (("--num-rounds", 99), ["num_rounds", "99", "0 to 10"]),
        (("--residual.lengths-deg",), ["residual.lengths_deg", "()"]),
        (("--residual.nuggets", 0.1, 0), ["residual.nuggets", "above 0"]),
        (("--residual.energy", "nan"), ["residual.energy", "at most 1"]),
        (("--indirect.damping", "inf"), ["indirect.damping", "finite"]),
        (("--indirect.smoothing-px", -1), ["indirect.smoothing_px", "0 or more"]),
    ],
)
def test_an_option_out_of_range_is_one_line(run, tmp_path: Path, option: tuple, words: list[str]) -> None:
    status, _, err = run("recover", TINY, "-o", tmp_path / "m.relight", *option)
    assert_one_line(status, err, *words)
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_is_one_line(run, model_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("relight3d.commands.render.write_frame", interrupt)
    lights = write(tmp_path / "lights.json", light(0.2))
    assert run("render", model_file, "--lights", lights, "-o", tmp_path / "a.png") == (130, "", "relight3d: stopped\n")
    assert list(tmp_path.iterdir()) == [lights]


def test_a_full_disk_is_one_line(run, model_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_space(*_: object) -> None:
        raise OSError(28, "No space left on device", "a.png")

    monkeypatch.setattr("relight3d.commands.render.write_frame", no_space)
    lights = write(tmp_path / "lights.json", light(0.2))
    status, _, err = run("render", model_file, "--lights", lights, "-o", tmp_path / "a.png")
    assert_one_line(status, err, "a.png", "No space left")

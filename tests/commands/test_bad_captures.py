"""A bad capture ends in one line that names what is wrong, exit 2, and leaves no file."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from relight3d.io.images import write_exr, write_png
from tests.commands.asserts import QUICK, assert_one_line


def _first_train(top: dict) -> dict:
    return next(frame for frame in top["frames"] if frame["split"] == "train" and frame["lights"])


def _spoil_json(change: Callable[[dict], object]) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        top = json.loads((folder / "transforms.json").read_text())
        change(top)
        (folder / "transforms.json").write_text(json.dumps(top))

    return spoil


def _turn_away(folder: Path) -> None:
    def change(top: dict) -> None:
        for frame in top["frames"]:
            frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ np.diag([-1, 1, -1, 1])).tolist()

    _spoil_json(change)(folder)


def _each_light(change: Callable[[dict], object]) -> Callable[[Path], None]:
    """`change` every training light in place."""
    return _spoil_json(
        lambda top: [change(light) for f in top["frames"] if f["split"] == "train" for light in f["lights"]]
    )


def _mask_all(folder: Path) -> None:
    write_png(folder / "mask.png", np.zeros((48, 64), np.uint8))
    _spoil_json(lambda top: [f.update(mask_path="mask.png") for f in top["frames"]])(folder)


BAD_CAPTURES = {
    "image missing": (lambda f: (f / "images/train_00.exr").unlink(), ["train_00.exr", "no such file"]),
    "image unreadable": (lambda f: (f / "images/train_00.exr").write_bytes(b"\x76\x2f\x31\x01xx"), ["train_00.exr"]),
    "image cut short": (
        lambda f: (f / "images/train_00.exr").write_bytes((f / "images/train_00.exr").read_bytes()[:-200]),
        ["train_00.exr", "cut short"],
    ),
    "sizes that differ": (
        lambda f: write_exr(f / "images/train_00.exr", np.ones((47, 64, 3), np.float32)),
        ["train_00.exr", "64 x 47"],
    ),
    "lights missing": (_spoil_json(lambda top: _first_train(top).pop("lights")), ["frames[0].lights"]),
    "light vector zero": (
        _spoil_json(lambda top: _first_train(top)["lights"][0].update(to_light=[0, 0, 0])),
        ["frames[0].lights[0].to_light"],
    ),
    "light vector NaN": (
        _spoil_json(lambda top: _first_train(top)["lights"][0].update(to_light=[0, float("nan"), 1])),
        ["frames[0].lights[0].to_light", "finite"],
    ),
    "light type unknown": (
        _spoil_json(lambda top: _first_train(top)["lights"][0].update(type="laser")),
        ["frames[0].lights[0].type", "laser"],
    ),
    "lights negated": (
        _each_light(lambda light: light.update(to_light=[-x for x in light["to_light"]])),
        ["transforms.json lights", "(-x, -y, -z)", "negate"],
    ),
    "lights y up": (
        _each_light(
            lambda light: light.update(to_light=[light["to_light"][i] * s for i, s in ((0, 1), (2, 1), (1, -1))])
        ),
        ["transforms.json lights", "(x, -z, y)"],
    ),
    "mesh missing": (lambda f: (f / "mesh.ply").unlink(), ["mesh_path", "mesh.ply"]),
    "mesh empty": (lambda f: (f / "mesh.ply").write_text("ply\nformat ascii 1.0\nend_header\n"), ["mesh.ply"]),
    "mesh missed": (_turn_away, ["mesh"]),
    "all masked": (_mask_all, ["mask"]),
    "colour space unknown": (_spoil_json(lambda top: top.update(color_space="rec709")), ["color_space", "rec709"]),
    "another camera": (
        _spoil_json(lambda top: top["frames"][1]["transform_matrix"][0].__setitem__(3, 0.5)),
        ["frames[1].transform_matrix"],
    ),
    "no training frame": (_spoil_json(lambda top: [f.update(split="test") for f in top["frames"]]), ["train"]),
    "no JSON": (lambda f: (f / "transforms.json").write_text("{"), ["transforms.json", "JSON"]),
    "no folder": (shutil.rmtree, ["tiny"]),
}


@pytest.mark.parametrize("slip", BAD_CAPTURES)
def test_a_bad_capture_is_one_line_and_leaves_nothing(run, tiny_copy: Path, tmp_path: Path, slip: str) -> None:
    spoil, words = BAD_CAPTURES[slip]
    spoil(tiny_copy)
    output = tmp_path / "out" / "tiny.relight"
    status, out, err = run("recover", tiny_copy, "-o", output, "--quiet", *QUICK)
    assert_one_line(status, err, *words)
    assert out == "" and not list(tmp_path.rglob("*.relight"))


def test_what_is_doubtful_is_said_and_recovered_all_the_same(run, tiny_copy: Path, tmp_path: Path) -> None:
    powers = iter([1.0, 0.5, 1.6, 0.8, 1.3, 0.6] * 3)

    def change(light: dict) -> None:
        power = next(powers)
        light["irradiance"] = [power * x for x in light["irradiance"]]

    _each_light(change)(tiny_copy)
    status, out, err = run("recover", tiny_copy, "-o", tmp_path / "tiny.relight", "--quiet", *QUICK)
    assert status == 0 and "tiny.relight" in out
    (line,) = [line for line in err.splitlines() if "exposures differ" in line]
    assert line.startswith("warning: photographs: ") and "train_01 x" in line


def test_what_is_refused_can_be_trusted(run, tiny_copy: Path, tmp_path: Path) -> None:
    spoil, words = BAD_CAPTURES["lights negated"]
    spoil(tiny_copy)
    asked = ("recover", tiny_copy, "-o", tmp_path / "tiny.relight", "--quiet", *QUICK, "--conventions.trust")
    status, _, err = run(*asked)
    assert status == 0 and "warning: lights: " in err and words[-1] in err

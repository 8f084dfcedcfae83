"""relight3d import: the tiny desk's own parts, as other programs would hold them, make a capture again."""

from pathlib import Path

import numpy as np

import relight3d
from tests.commands.asserts import TINY, assert_one_line, write


def parts(folder: Path) -> tuple[relight3d.Capture, list[object]]:
    """The tiny desk, and the arguments that name its mesh, camera, lights and images as files."""
    capture = relight3d.load_capture(TINY)
    camera_from_world = capture.camera.world_from_camera[:3, :3].T
    lit = [photograph for photograph in capture.split("train") if photograph.lights]
    directions = [camera_from_world @ photograph.lights[0].to_light for photograph in lit]
    rows = [f"{p.name}.exr {x} {y} {z}" for p, (x, y, z) in zip(lit, directions)]
    (folder / "lights.lp").write_text("\n".join([str(len(rows)), *rows]))
    camera = write(folder / "camera.json", capture.camera.to_dict())
    files = ["--mesh", TINY / "mesh.ply", "--camera", camera, "--lights", folder / "lights.lp"]
    return capture, [*files, "--images", TINY / "images", "--color-space", "linear"]


def test_parts_become_a_capture(run, tmp_path: Path) -> None:
    capture, arguments = parts(tmp_path)
    tests = ("train_03.exr", "train_05.exr")
    status, out, _ = run("import", tmp_path / "made", *arguments, "--test", *tests, "--unit", "metre")
    assert status == 0 and "10 training and 2 held-out photographs" in out
    made = relight3d.load_capture(tmp_path / "made")
    assert made.camera.same_as(capture.camera) and made.unit == "metre" and len(made.mesh.faces) == 1465
    wanted = {photograph.name: photograph.lights for photograph in capture.photographs}
    for photograph in made.photographs:
        name = Path(photograph.name).stem
        np.testing.assert_allclose(photograph.lights[0].to_light, wanted[name][0].to_light, atol=1e-9)
        assert (photograph.split == "test") == (f"{name}.exr" in tests)


def test_other_lights_are_refused(run, tmp_path: Path) -> None:
    _, arguments = parts(tmp_path)
    arguments[arguments.index("--lights") + 1] = tmp_path / "camera.json"
    status, _, err = run("import", tmp_path / "made", *arguments)
    assert_one_line(status, err, "camera.json", ".lp or .dome")
    assert not (tmp_path / "made").exists()


def test_an_unknown_held_out_image_is_refused(run, tmp_path: Path) -> None:
    _, arguments = parts(tmp_path)
    status, _, err = run("import", tmp_path / "made", *arguments, "--test", "nothing.exr")
    assert_one_line(status, err, "nothing.exr")

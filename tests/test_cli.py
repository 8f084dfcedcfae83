"""Every command on the tiny desk: what it writes, what it says, and how it refuses."""

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

import relight3d
from relight3d.cli import COMMANDS, main
from relight3d.io.images import read_image, write_exr, write_png
from relight3d.maths.color import display_u8

TINY = Path(__file__).parents[1] / "data" / "desk_tiny"
QUICK = ["--mesh.target-faces", "2000", "--num-rounds", "0", "--num-alternations", "2"]
SIZE = (64, 48)


@pytest.fixture(scope="session")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of the tiny desk, recovered once and in haste."""
    path = tmp_path_factory.mktemp("model") / "tiny.relight"
    assert main(["recover", str(TINY), "-o", str(path), "--quiet", *QUICK]) == 0
    return path


@pytest.fixture
def tiny_copy(tmp_path: Path) -> Path:
    """A copy of the tiny desk, free to be spoilt."""
    return Path(shutil.copytree(TINY, tmp_path / "tiny", ignore=shutil.ignore_patterns("truth")))


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Runs a command and gives its status and what it wrote to standard output and error."""

    def run_(*arguments: object) -> tuple[int, str, str]:
        capsys.readouterr()
        status = main([str(argument) for argument in arguments])
        written = capsys.readouterr()
        return status, written.out, written.err

    return run_


def light(x: float, y: float = -0.4, power: float = 3.0) -> list[dict]:
    """One frame's lights as LIGHTS.json has them."""
    return [{"type": "directional", "to_light": [x, y, 0.9], "irradiance": power}]


def write(path: Path, value: object) -> Path:
    path.write_text(json.dumps(value))
    return path


def decoded(film: Path, size: tuple[int, int]) -> np.ndarray:
    """Every frame of a film, which must be of this size."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", film, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, check=True, capture_output=True).stdout
    return np.frombuffer(raw, np.uint8).reshape(-1, size[1], size[0], 3)


def assert_one_line(status: int, err: str, *words: str) -> None:
    """Exit 2 and one line on standard error that holds all the words."""
    assert status == 2, err
    assert err.startswith("relight3d: ") and err.count("\n") == 1 and err.endswith("\n"), err
    for word in words:
        assert word in err, f"{word!r} is not in {err!r}"


# ------------------------------------------------------------------------------------------------- in general


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
    assert status == 2 and "--specular.max-lobes" in err


def test_an_option_out_of_range_is_one_line(run, tmp_path: Path) -> None:
    status, _, err = run("recover", TINY, "-o", tmp_path / "m.relight", "--num-rounds", 99)
    assert_one_line(status, err, "num_rounds", "99", "0 to 10")


def test_ctrl_c_is_one_line(run, model_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("relight3d.commands.render.frames_of", interrupt)
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


# ---------------------------------------------------------------------------------------------------- recover


def test_recover_tells_its_stages_and_counts_its_solves(run, tmp_path: Path) -> None:
    path = tmp_path / "new folder" / "tiny.relight"
    status, out, err = run("recover", TINY, "-o", path, *QUICK)
    assert status == 0 and path.is_file() and "solves: " in out and " ok" in out and "13 photographs" in out
    assert err.startswith("recover: ") and "mesh" in err
    assert [p.name for p in path.parent.iterdir()] == ["tiny.relight"]


def test_verbose_logs_each_stage(run, tmp_path: Path) -> None:
    status, _, err = run("recover", TINY, "-o", tmp_path / "tiny.relight", "-v", *QUICK)
    assert status == 0 and " mesh" in err and " s\n" in err


@pytest.mark.parametrize("output", ["", "transforms.json/model.relight"])
def test_a_hopeless_output_is_refused_before_the_work(run, tiny_copy: Path, output: str) -> None:
    status, _, err = run("recover", TINY, "-o", tiny_copy / output)
    assert_one_line(status, err, str(tiny_copy / output))


# ----------------------------------------------------------------------------------------------------- render


def test_pictures_hold_what_the_library_renders(run, model_file: Path, tmp_path: Path) -> None:
    lights = write(tmp_path / "lights.json", light(0.3))
    for name in ("a.png", "a.exr"):
        status, out, err = run("render", model_file, "--lights", lights, "-o", tmp_path / name)
        assert (status, err) == (0, "") and "64 x 48" in out
    frame = relight3d.Relighter(relight3d.load_model(model_file)).render(
        [relight3d.DirectionalLight((0.3, -0.4, 0.9), (3, 3, 3))]
    )
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr")[0], frame.radiance)  # float32, unrounded
    shown = display_u8(frame.radiance, frame.exposure)
    np.testing.assert_allclose(read_image(tmp_path / "a.png")[0], shown / np.float32(255), atol=1e-6)
    assert shown.max() > 100


def test_exposure_brightens_pictures_alone(run, model_file: Path, tmp_path: Path) -> None:
    lights = write(tmp_path / "lights.json", light(0.3))
    mean = []
    for exposure in (0.1, 0.4):
        arguments = ("--lights", lights, "--exposure", exposure, "-o", tmp_path / "a.png")
        assert run("render", model_file, *arguments)[0] == 0
        mean.append(read_image(tmp_path / "a.png")[0].mean())
    assert mean[1] > 1.3 * mean[0]


def test_another_camera_changes_view_and_size(run, model_file: Path, tmp_path: Path) -> None:
    pose = relight3d.load_capture(TINY).split("test")[-1].camera.world_from_camera
    camera = write(tmp_path / "camera.json", {"transform_matrix": pose.tolist(), "w": 33, "h": 25})
    lights = write(tmp_path / "lights.json", light(0.3))
    status, out, _ = run("render", model_file, "--lights", lights, "--camera", camera, "-o", tmp_path / "a.exr")
    assert status == 0 and "33 x 25" in out and read_image(tmp_path / "a.exr")[0].shape == (25, 33, 3)


def test_a_sequence_goes_on_where_it_stopped(run, model_file: Path, tmp_path: Path) -> None:
    frames, path = tmp_path / "frames", tmp_path / "lights.json"
    write(path, [light(0.1 * k) for k in range(4)])
    status, out, err = run("render", model_file, "--lights", path, "-o", frames)
    assert status == 0 and "4 frames rendered" in out and "render: " in err
    names = [f"frame_{k:04d}.png" for k in range(4)]
    assert sorted(p.name for p in frames.iterdir()) == [*names, "frames.json"]
    before = {name: (frames / name).stat().st_mtime_ns for name in names}
    (frames / names[1]).unlink()
    write(path, [light(0.1 * k if k != 2 else -0.5) for k in range(3)])  # one missing, one changed, one too many
    status, out, _ = run("render", model_file, "--lights", path, "-o", frames)
    assert status == 0 and "2 frames rendered, 1 were there already" in out
    after = {p.name: p.stat().st_mtime_ns for p in frames.glob("frame_*")}
    assert sorted(after) == names[:3] and after[names[0]] == before[names[0]] and after[names[2]] > before[names[2]]


def test_foreign_frames_are_not_taken_for_ours(run, model_file: Path, tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    (frames / "frame_0000.png").write_text("a picture of something else")
    lights = write(tmp_path / "lights.json", [light(0.1), light(0.2)])
    assert "2 frames rendered" in run("render", model_file, "--lights", lights, "-o", frames)[1]
    assert read_image(frames / "frame_0000.png")[0].shape == (48, 64, 3)


def test_a_stopped_sequence_leaves_whole_frames(
    run, model_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from relight3d.relight.relighter import Relighter

    render, calls = Relighter.render, []

    def stop_at_third(self: Relighter, lights: list) -> object:
        calls.append(lights)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return render(self, lights)

    monkeypatch.setattr(Relighter, "render", stop_at_third)
    lights = write(tmp_path / "lights.json", [light(0.1 * k) for k in range(5)])
    frames, film = tmp_path / "frames", tmp_path / "film.mp4"
    assert run("render", model_file, "--lights", lights, "-o", f"{frames}/")[0] == 130
    assert sorted(p.name for p in frames.iterdir()) == ["frame_0000.png", "frame_0001.png", "frames.json"]
    calls.clear()
    assert run("render", model_file, "--lights", lights, "-o", film)[0] == 130
    assert sorted(p.name for p in tmp_path.iterdir()) == ["frames", "lights.json"]
    monkeypatch.undo()
    status, out, _ = run("render", model_file, "--lights", lights, "-o", frames)
    assert status == 0 and "3 frames rendered, 2 were there already" in out


def test_a_film_has_every_frame(run, model_file: Path, tmp_path: Path) -> None:
    lights, film = write(tmp_path / "lights.json", [light(0.1 * k) for k in range(6)]), tmp_path / "film.mp4"
    status, out, _ = run("render", model_file, "--lights", lights, "-o", film, "--fps", 10)
    assert status == 0 and "6 frames at 10 a second" in out
    pictures = decoded(film, SIZE)
    assert len(pictures) == 6 and not np.array_equal(pictures[0], pictures[5])


def test_a_film_of_odd_sides_is_made_even(run, model_file: Path, tmp_path: Path) -> None:
    pose = relight3d.load_model(model_file).camera.world_from_camera
    camera = write(tmp_path / "camera.json", {"transform_matrix": pose.tolist(), "w": 33, "h": 25})
    lights = write(tmp_path / "lights.json", [light(0.1), light(0.2)])
    film = tmp_path / "film.mp4"
    assert run("render", model_file, "--lights", lights, "--camera", camera, "-o", film)[0] == 0
    assert len(decoded(film, (34, 26))) == 2


def test_a_camera_path_makes_a_sequence(run, model_file: Path, tmp_path: Path) -> None:
    pose = relight3d.load_model(model_file).camera.world_from_camera
    poses = []
    for shift in (0.0, 0.05, 0.1):
        moved = pose.copy()
        moved[0, 3] += shift
        poses.append({"transform_matrix": moved.tolist()})
    lights, cameras = write(tmp_path / "lights.json", light(0.1)), write(tmp_path / "cameras.json", poses)
    frames = tmp_path / "frames"
    arguments = ("--lights", lights, "--camera", cameras, "-o", frames, "--format", "exr")
    assert run("render", model_file, *arguments)[0] == 0
    pictures = [read_image(frames / f"frame_{k:04d}.exr")[0] for k in range(3)]
    assert not np.array_equal(pictures[0], pictures[2])
    status, _, err = run("render", model_file, "--lights", write(lights, [light(0.1), light(0.2)]), *arguments[2:])
    assert_one_line(status, err, "cameras.json", "3 cameras", "2 lists")


@pytest.mark.parametrize(
    ("lights", "output", "words"),
    [
        ([{"type": "laser"}], "a.png", ["lights.json [0].type", "laser"]),
        ([{"type": "directional", "to_light": [0, 0, 0], "irradiance": 1}], "a.png", ["[0].to_light"]),
        ({"type": "directional"}, "a.png", ["lights.json", "list of lights"]),
        (light(0.1), "a.jpg", ["a.jpg", ".png, .exr or .mp4"]),
        ([light(0.1), light(0.2)], "a.png", ["a.png", "2 frames"]),
    ],
)
def test_render_refuses_in_one_line(
    run, model_file: Path, tmp_path: Path, lights: object, output: str, words: list[str]
) -> None:
    path = write(tmp_path / "lights.json", lights)
    status, _, err = run("render", model_file, "--lights", path, "-o", tmp_path / output)
    assert_one_line(status, err, *words)
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_is_no_model_is_refused(run, tmp_path: Path) -> None:
    lights = write(tmp_path / "lights.json", light(0.1))
    for model in (lights, tmp_path / "none.relight"):
        status, _, err = run("render", model, "--lights", lights, "-o", tmp_path / "a.png")
        assert_one_line(status, err, str(model), "expected a model file")


# --------------------------------------------------------------------------------------------------- evaluate


def test_evaluate_prints_the_table_with_every_baseline(run, model_file: Path) -> None:
    status, out, err = run("evaluate", model_file, TINY)
    assert (status, err) == (0, "")
    for word in ("relight3d", "ptm", "hsh2", "hsh3", "rbf", "one_light", "new_view", "worst frame", "mirror"):
        assert word in out, word


def test_evaluate_prints_json_and_nothing_else(run, model_file: Path) -> None:
    status, out, _ = run("evaluate", model_file, TINY, "--json", "--no-baselines")
    figures = json.loads(out)
    assert status == 0 and len(figures["model"]["frames"]) == 5 and figures["baselines"] == {}
    assert figures["model"]["mean"]["psnr_db"] > 15


def test_evaluate_refuses_an_unknown_split(run, model_file: Path) -> None:
    status, _, err = run("evaluate", model_file, TINY, "--split", "tset")
    assert_one_line(status, err, "split", "tset", "test, train")


# ------------------------------------------------------------------------------- bad captures: one line each


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

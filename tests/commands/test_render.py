"""relight3d render: pictures, sequences that go on where they stopped, films."""

from pathlib import Path

import numpy as np
import pytest

import relight3d
from relight3d.io.images import read_image
from relight3d.maths.color import display_u8
from tests.commands.asserts import SIZE, TINY, assert_one_line, decoded, light, write


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


@pytest.mark.parametrize(
    ("error", "words"), [(BrokenPipeError(32, "Broken pipe"), "disk"), (RuntimeError("No ffmpeg exe"), "No ffmpeg exe")]
)
def test_a_film_that_fails_leaves_nothing(
    run, model_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, words: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("imageio_ffmpeg.write_frames", fail)
    lights = write(tmp_path / "lights.json", [light(0.1), light(0.2)])
    status, _, err = run("render", model_file, "--lights", lights, "-o", tmp_path / "film.mp4", "--quiet")
    assert_one_line(status, err, "film.mp4", words)
    assert list(tmp_path.iterdir()) == [lights]


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


@pytest.mark.parametrize("how", [("--preset", "fast"), ("--budget-ms", "1000"), ("--shadows", "off")])
def test_a_frame_can_be_made_cheaper(run, model_file: Path, tmp_path: Path, how: tuple[str, str]) -> None:
    lights = write(tmp_path / "lights.json", light(0.3))
    status, out, _ = run("render", model_file, "--lights", lights, "-o", tmp_path / "a.png", *how)
    assert status == 0 and (" ms here" in out) == (how[0] == "--budget-ms")


def test_effects_are_switched_by_hand(run, model_file: Path, tmp_path: Path) -> None:
    lights = write(tmp_path / "lights.json", light(0.3))
    pictures = {}
    for force in ("", "residual=off", "shadows=off"):
        path = tmp_path / f"{force or 'all'}.exr"
        arguments = ("--force", force) if force else ()
        assert run("render", model_file, "--lights", lights, "-o", path, *arguments)[0] == 0
        pictures[force] = read_image(path)[0]
    assert pictures["shadows=off"].mean() > pictures[""].mean()
    status, _, err = run("render", model_file, "--lights", lights, "-o", tmp_path / "a.png", "--force", "foo=off")
    assert_one_line(status, err, "foo", "residual")


def test_settings_that_exclude_each_other_are_refused(run, model_file: Path, tmp_path: Path) -> None:
    lights = write(tmp_path / "lights.json", light(0.3))
    arguments = ("--lights", lights, "-o", tmp_path / "a.png", "--preset", "fast", "--budget-ms", 5)
    status, _, err = run("render", model_file, *arguments)
    assert_one_line(status, err, "preset and budget_ms")


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


@pytest.mark.parametrize("exposure", ["nan", "-1", "0", "inf"])
def test_an_exposure_that_shows_nothing_is_refused(run, model_file: Path, tmp_path: Path, exposure: str) -> None:
    lights = write(tmp_path / "lights.json", light(0.1))
    arguments = ("--lights", lights, "-o", tmp_path / "a.png", "--exposure", exposure)
    assert_one_line(*run("render", model_file, *arguments)[::2], "exposure", "above 0")
    assert list(tmp_path.iterdir()) == [lights]


def test_an_empty_name_is_no_folder(run, model_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a shell's variable that is not set: not frames wherever one happens to be."""
    monkeypatch.chdir(tmp_path)
    lights = write(tmp_path / "lights.json", light(0.1))
    assert_one_line(*run("render", model_file, "--lights", lights, "-o", "")[::2], "output")
    assert list(tmp_path.iterdir()) == [lights]


def test_a_file_that_is_no_model_is_refused(run, tmp_path: Path) -> None:
    lights = write(tmp_path / "lights.json", light(0.1))
    for model in (lights, tmp_path / "none.relight"):
        status, _, err = run("render", model, "--lights", lights, "-o", tmp_path / "a.png")
        assert_one_line(status, err, str(model), "expected a model file")

"""A capture is checked to the last field: every slip is one line that names the file and the field."""

import json
from pathlib import Path

import numpy as np
import pytest

from relight3d.camera import Camera, look_at
from relight3d.errors import InputError, MeshError
from relight3d.io.capture import load_capture, read_photograph, write_capture
from relight3d.io.images import write_exr, write_png
from relight3d.io.meshes import write_mesh
from relight3d.lights import DirectionalLight, PointLight, SpotLight
from relight3d.records import Capture, Photograph, TriangleMesh
from tests.io.folders import HEIGHT, SQUARE, WIDTH, CaptureFolder


def test_a_valid_folder_loads(capture_folder: CaptureFolder) -> None:
    capture = capture_folder.load()
    assert [p.name for p in capture.photographs] == ["0", "1", "2", "3"]
    assert [p.split for p in capture.photographs] == ["train"] * 3 + ["test"]
    assert (capture.camera.fx, capture.camera.fy, capture.camera.cx, capture.camera.k1) == (6.0, 6.5, 3.25, 0.01)
    assert capture.unit == "m" and capture.color_space == "linear" and len(capture.mesh.faces) == 2
    assert not capture.photographs[3].camera.same_as(capture.camera)
    radiance, is_valid = read_photograph(capture, capture.photographs[0])
    assert radiance.shape == (HEIGHT, WIDTH, 3) and radiance.dtype == np.float32
    assert not is_valid[0, 0] and is_valid.sum() == WIDTH * HEIGHT - 1 and (radiance[0, 0] == 0).all()


def test_the_json_itself_may_be_given(capture_folder: CaptureFolder) -> None:
    capture_folder.load()
    assert len(load_capture(str(capture_folder.path / "transforms.json")).photographs) == 4


# ------------------------------------------------------------------------------------- one slip, one line

F0, F1, L0 = "frames[0]", "frames[1]", "frames[1].lights[0]"
MOVED = look_at(np.array([0.0, -3.0, 3.01]), np.zeros(3)).tolist()
SLIPS = [
    # where in the JSON, what is put there (... = removed), the field named, a word of the line
    (["w"], ..., "transforms.json w", "nothing"),
    (["w"], 6.5, "frames[0].w", "whole number"),
    (["h"], -4, "transforms.json h", "above 0"),
    (["h"], 10**400, "transforms.json h", "at most"),
    (["fl_x"], ..., "transforms.json fl_x", "nothing"),
    (["fl_x"], 0, "transforms.json fl_x", "above 0"),
    (["fl_y"], "6", "transforms.json fl_y", "'6'"),
    (["cx"], float("nan"), "transforms.json cx", "nan"),
    (["k1"], True, "transforms.json k1", "True"),
    (["k1"], -50.0, "k1, k2, p1, p2", "can be undone"),
    (["k3"], 0.1, "transforms.json k3", "undistort"),
    (["camera_model"], "OPENCV_FISHEYE", "transforms.json camera_model", "OPENCV or PINHOLE"),
    (["camera_model"], ["OPENCV"], "transforms.json camera_model", "OPENCV or PINHOLE"),
    (["color_space"], ..., "transforms.json color_space", "srgb"),
    (["color_space"], "sRGB", "transforms.json color_space", "'sRGB'"),
    (["color_space"], {}, "transforms.json color_space", "linear"),
    (["mesh_path"], ..., "transforms.json mesh_path", "nothing"),
    (["mesh_path"], "no.ply", "transforms.json mesh_path", "no.ply (no such file)"),
    (["mesh_path"], "mask.png", "transforms.json mesh_path", "mask.png"),
    (["unit"], 3, "transforms.json unit", "text"),
    (["frames"], ..., "transforms.json frames", "nothing"),
    (["frames"], [], "transforms.json frames", "a list of frames"),
    (["frames", 0], 3, F0, "an object"),
    (["frames", 0, "file_path"], ..., f"{F0}.file_path", "nothing"),
    (["frames", 0, "file_path"], "images/9.png", f"{F0}.file_path", "images/9.png (no such file)"),
    (["frames", 0, "file_path"], "images/\0.png", f"{F0}.file_path", "no such file"),
    (["frames", 0, "file_path"], "mesh.ply", f"{F0}.file_path", "EXR, PNG, TIFF or JPEG"),
    (["frames", 0, "mask_path"], "no.png", f"{F0}.mask_path", "no.png (no such file)"),
    (["frames", 0, "mask_path"], 3, f"{F0}.mask_path", "text"),
    (["frames", 0, "split"], 3, f"{F0}.split", "text"),
    (["frames", 0, "transform_matrix"], ..., f"{F0}.transform_matrix", "nothing"),
    (["frames", 0, "transform_matrix"], [[1, 2], [3]], f"{F0}.transform_matrix", "4 rows"),
    (["frames", 0, "transform_matrix"], np.eye(3).tolist(), f"{F0}.transform_matrix", "4 rows"),
    (["frames", 0, "transform_matrix", 0, 0], float("inf"), f"{F0}.transform_matrix", "finite"),
    (["frames", 0, "transform_matrix", 0, 0], 1e300, f"{F0}.transform_matrix", "rotation"),
    (["frames", 0, "transform_matrix", 0, 0], 7.0, f"{F0}.transform_matrix", "rotation"),
    (["frames", 0, "transform_matrix"], np.array(MOVED).T.tolist(), f"{F0}.transform_matrix", "transpose"),
    (["frames", 1, "transform_matrix"], MOVED, f"{F1}.transform_matrix", "one fixed viewpoint"),
    (["frames", 1, "fl_x"], 6.01, f"{F1}.intrinsics", "one fixed viewpoint"),
    (["frames", 1, "fl_x"], -1, f"{F1}.fl_x", "above 0"),
    (["frames", 1, "lights"], ..., f"{F1}.lights", "all lights off"),
    (["frames", 1, "lights"], {}, f"{F1}.lights", "a list of lights"),
    (["frames", 1, "lights", 0], "sun", L0, "an object"),
    (["frames", 1, "lights", 0, "type"], "area", f"{L0}.type", "directional, point"),
    (["frames", 1, "lights", 0, "type"], [], f"{L0}.type", "directional, point"),
    (["frames", 1, "lights", 0, "type"], ..., f"{L0}.type", "directional, point"),
    (["frames", 1, "lights", 0, "to_light"], [0, 0, 0], f"{L0}.to_light", "not zero"),
    (["frames", 1, "lights", 0, "to_light"], [0, float("nan"), 1], f"{L0}.to_light", "finite"),
    (["frames", 1, "lights", 0, "to_light"], [0, 1], f"{L0}.to_light", "three"),
    (["frames", 1, "lights", 0, "to_light"], [1e200, 0, 0], f"{L0}.to_light", "finite"),
    (["frames", 1, "lights", 0, "to_light"], ..., f"{L0}.to_light", "three finite numbers"),
    (["frames", 1, "lights", 0, "irradiance"], [1, -1, 1], f"{L0}.irradiance", "negative"),
    (["frames", 1, "lights", 0, "irradiance"], 10**400, f"{L0}.irradiance", "finite"),
    (["frames", 1, "lights", 0, "power"], 3, f"{L0}.power", "directional light"),
]


def spoil(top: dict, where: list, value: object) -> None:
    for key in where[:-1]:
        top = top[key]
    if value is ...:
        del top[where[-1]]
    else:
        top[where[-1]] = value


@pytest.mark.parametrize(
    ("where", "value", "field", "word"), SLIPS, ids=lambda v: None if isinstance(v, dict) else str(v)[:40]
)
def test_a_slip_is_one_line_that_names_file_and_field(
    capture_folder: CaptureFolder, where: list, value: object, field: str, word: str
) -> None:
    spoil(capture_folder.top, where, value)
    with pytest.raises(InputError) as caught:
        capture_folder.load()
    line = str(caught.value)
    assert line.startswith("transforms.json ") and f"{field}: got " in line and word in line and "\n" not in line


def test_frames_without_training_or_light_are_refused(capture_folder: CaptureFolder) -> None:
    for frame in capture_folder.top["frames"]:
        frame["lights"] = []
    with pytest.raises(InputError, match="frames: got no light in any training frame"):
        capture_folder.load()
    for frame in capture_folder.top["frames"]:
        frame["split"] = "test"
    with pytest.raises(InputError, match="frames: got no training frame"):
        capture_folder.load()


def test_a_lamp_without_power_is_off(capture_folder: CaptureFolder) -> None:
    """A photograph is divided by what its lights give: one whose lamps give nothing shows ambient light alone."""
    frames = capture_folder.top["frames"]
    frames[0]["lights"][0]["irradiance"] = 0
    frames[1]["lights"].append(frames[1]["lights"][0] | {"irradiance": [0, 0, 0]})
    frames[2]["lights"][0]["irradiance"] = [0, 0, 1]
    assert [len(p.lights) for p in capture_folder.load().photographs] == [0, 1, 1, 1]
    for frame in frames:
        frame["lights"] = [{"type": "directional", "to_light": [0, 0, 1], "irradiance": 0}]
    with pytest.raises(InputError, match="frames: got no light in any training frame"):
        capture_folder.load()


def test_files_that_do_not_fit_are_named(capture_folder: CaptureFolder) -> None:
    path = capture_folder.path
    cases = [
        (
            "images/2.png",
            lambda p: write_png(p, np.zeros((3, 6, 3), np.uint8)),
            r"frames\[2\].file_path: got 2.png: 6 x 3",
        ),
        (
            "images/2.png",
            lambda p: p.write_bytes(b"\x89PNG\r\n"),
            r"frames\[2\].file_path: got 2.png: a PNG file that is cut",
        ),
        ("mask.png", lambda p: write_png(p, np.ones((6, 4), np.uint8)), r"frames\[0\].mask_path: got mask.png: 4 x 6"),
        ("mask.png", lambda p: write_png(p, np.zeros((4, 6), np.uint8)), r"frames\[0\].mask_path: .*zero everywhere"),
        ("mask.png", lambda p: p.write_text("?"), r"frames\[0\].mask_path: got mask.png: a file of another format"),
    ]
    for name, spoil_file, words in cases:
        whole = (path / name).read_bytes()
        spoil_file(path / name)
        with pytest.raises(InputError, match=words):
            capture_folder.load()
        (path / name).write_bytes(whole)
    capture_folder.load()


def test_a_mesh_that_cannot_be_used_is_named(capture_folder: CaptureFolder) -> None:
    mesh = capture_folder.path / "mesh.ply"
    mesh.write_bytes(mesh.read_bytes()[:-9])
    with pytest.raises(MeshError, match=r"transforms.json mesh_path: got mesh.ply"):
        capture_folder.load()
    write_mesh(mesh, TriangleMesh(SQUARE.vertices + (0.0, 0.0, 90.0), SQUARE.faces))
    with pytest.raises(InputError, match=r"mesh_path: got mesh.ply: a mesh outside the camera's view.*unit and axes"):
        capture_folder.load()


def test_a_mesh_larger_than_the_view_is_seen(capture_folder: CaptureFolder) -> None:
    write_mesh(capture_folder.path / "mesh.ply", TriangleMesh(SQUARE.vertices * 1e3, SQUARE.faces))
    capture_folder.load()


def test_axes_of_opencv_are_recognised(capture_folder: CaptureFolder) -> None:
    for frame in capture_folder.top["frames"]:
        frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1])).tolist()
    with pytest.raises(InputError, match="negate the second and third column"):
        capture_folder.load()


@pytest.mark.parametrize("content", [b"", b"{", b"[1, 2]", b"{}", b"null", b"\xff\xfe", b"[" * 100_000])
def test_what_is_no_transforms_json_is_one_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "transforms.json").write_bytes(content)
    with pytest.raises(InputError, match=r"transforms\.json: got "):
        load_capture(tmp_path)


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"desk: got nothing there"):
        load_capture(tmp_path / "desk")
    with pytest.raises(InputError, match=r"a folder without transforms.json"):
        load_capture(tmp_path)


# ------------------------------------------------------------------------------------ what is let through


def test_windows_paths_and_missing_suffixes(capture_folder: CaptureFolder) -> None:
    frames = capture_folder.top["frames"]
    frames[0]["file_path"] = "images\\0.png"
    frames[1]["file_path"] = "./images/1"
    assert [p.name for p in capture_folder.load().photographs] == ["0", "1", "2", "3"]
    write_exr(capture_folder.path / "images/1.exr", np.ones((HEIGHT, WIDTH, 3), np.float32))
    with pytest.raises(InputError, match=r"frames\[1\].file_path: got ./images/1, which could be 1.exr, 1.png"):
        capture_folder.load()


def test_what_nerfstudio_and_nrhints_leave_out_or_call_otherwise(capture_folder: CaptureFolder) -> None:
    top = capture_folder.top
    for key in ("fl_y", "cx", "cy", "unit"):
        del top[key]
    top["fl_x"], top["camera_model"] = 6, "PINHOLE"
    for frame in top["frames"][:3]:
        del frame["split"], frame["mask_path"], frame["lights"]
        frame |= {"pl_pos": [0, 1, 4], "pl_intensity": [10, 10, 9]}
    capture = capture_folder.load()
    assert (capture.camera.fy, capture.camera.cx, capture.camera.cy) == (6, WIDTH / 2, HEIGHT / 2)
    light = capture.split("train")[0].lights[0]
    assert isinstance(light, PointLight) and light.position == (0, 1, 4) and light.intensity == (10, 10, 9)
    del top["fl_x"]
    top["camera_angle_x"] = 2 * np.arctan(WIDTH / 2 / 6)
    assert capture_folder.load().camera.fx == pytest.approx(6)
    del top["frames"][1]["pl_intensity"]
    with pytest.raises(InputError, match=r"frames\[1\].pl_intensity: got nothing"):
        capture_folder.load()


def test_lights_together_lights_off_and_other_splits(capture_folder: CaptureFolder) -> None:
    frames = capture_folder.top["frames"]
    frames[0]["lights"].append({"type": "point", "position": [0, 0, 2], "intensity": 4})
    frames[1]["lights"] = []
    frames[3]["split"] = "video"
    del frames[3]["lights"]
    capture = capture_folder.load()
    assert [len(p.lights) for p in capture.photographs] == [2, 0, 1, 0]


def test_a_test_frame_may_have_another_lens_and_size(capture_folder: CaptureFolder) -> None:
    write_png(capture_folder.path / "images/3.png", np.full((10, 8, 3), 7, np.uint8))
    frame = capture_folder.top["frames"][3]
    frame |= {"w": 8, "h": 10, "fl_x": 9.0, "fl_y": 9.0, "cx": 4, "cy": 5, "group": "viewpoint"}
    del frame["mask_path"]
    photograph = capture_folder.load().photographs[3]
    assert photograph.camera.intrinsics[:6] == (8, 10, 9.0, 9.0, 4.0, 5.0) and photograph.group == "viewpoint"


def test_exr_needs_no_colour_space_and_takes_no_curve(capture_folder: CaptureFolder) -> None:
    for index, frame in enumerate(capture_folder.top["frames"]):
        frame["file_path"] = f"images/{index}.exr"
        write_exr(capture_folder.path / frame["file_path"], np.ones((HEIGHT, WIDTH, 3), np.float32))
    del capture_folder.top["color_space"]
    assert capture_folder.load().color_space == "linear"
    capture_folder.top["color_space"] = "srgb"
    with pytest.raises(InputError, match='"srgb" for EXR'):
        capture_folder.load()


def test_images_of_one_name_keep_their_folders(capture_folder: CaptureFolder) -> None:
    frames = capture_folder.top["frames"]
    write_png(capture_folder.path / "other/0.png", np.ones((HEIGHT, WIDTH, 3), np.uint8))
    frames[1]["file_path"], frames[2]["file_path"] = "other/0.png", "images/3.png"
    assert [p.name for p in capture_folder.load().photographs] == ["images/0", "other/0", "images/3", "images/3-2"]


# ------------------------------------------------------------------------------- photographs and writing


def in_memory_capture(pixels: np.ndarray, is_valid: np.ndarray | None = None) -> Capture:
    pose = look_at(np.array([0.0, -3.0, 3.0]), np.zeros(3))
    camera = Camera(WIDTH, HEIGHT, 6.0, 6.0, 3.0, 2.0, world_from_camera=pose)
    other = Camera(WIDTH, HEIGHT, 7.0, 7.0, 3.0, 2.0, world_from_camera=pose)
    spot = SpotLight((0.0, 0.0, 3.0), (0.0, 0.0, -1.0), (5.0, 4.0, 3.0), 0.1, 0.9)
    lights = (DirectionalLight((0.3, -0.4, 0.9), (3.0, 2.0, 1.0)), spot)
    photographs = (
        Photograph("a", "train", lights, camera, pixels=pixels, is_valid=is_valid),
        Photograph("b", "test", (), other, group="lights off", pixels=pixels),
    )
    return Capture(Path(), camera, photographs, SQUARE, unit="m")


def test_pixels_in_memory_are_read_like_a_file() -> None:
    pixels = np.ones((HEIGHT, WIDTH, 3), np.float32)
    pixels[0, 0, 0], pixels[0, 1, 0] = np.nan, -0.5
    is_valid = np.ones((HEIGHT, WIDTH), dtype=bool)
    is_valid[1, 1] = False
    capture = in_memory_capture(pixels, is_valid)
    radiance, valid = read_photograph(capture, capture.photographs[0])
    assert not valid[0, 0] and not valid[1, 1] and valid.sum() == WIDTH * HEIGHT - 2
    assert radiance[0, 1, 0] == -0.5 and (radiance[~valid] == 0).all()
    assert np.isnan(pixels[0, 0, 0])  # the record is left alone


def test_a_photograph_without_a_valid_pixel_or_of_another_size_is_named() -> None:
    capture = in_memory_capture(np.full((HEIGHT, WIDTH, 3), np.nan, np.float32))
    with pytest.raises(InputError, match="photograph a: got no valid pixel"):
        read_photograph(capture, capture.photographs[0])
    capture = in_memory_capture(np.ones((HEIGHT + 1, WIDTH, 3), np.float32))
    with pytest.raises(InputError, match=f"photograph a: got {WIDTH} x {HEIGHT + 1} pixels"):
        read_photograph(capture, capture.photographs[0])


def test_a_written_capture_loads_equal(tmp_path: Path) -> None:
    pixels = np.random.default_rng(3).random((HEIGHT, WIDTH, 3), dtype=np.float32) * 40 - 1
    is_valid = np.ones((HEIGHT, WIDTH), dtype=bool)
    is_valid[2, 3] = False
    made = in_memory_capture(pixels, is_valid)
    assert write_capture(made, tmp_path / "out") == tmp_path / "out" / "transforms.json"
    loaded = load_capture(tmp_path / "out")
    assert loaded.camera.same_as(made.camera) and loaded.unit == "m" and loaded.color_space == "linear"
    np.testing.assert_array_equal(loaded.mesh.vertices, made.mesh.vertices)
    for before, after in zip(made.photographs, loaded.photographs):
        assert (after.name, after.split, after.group) == (before.name, before.split, before.group)
        assert after.camera.same_as(before.camera)
        assert [light.to_dict() for light in after.lights] == [light.to_dict() for light in before.lights]
        (wanted, wanted_valid), (got, got_valid) = read_photograph(made, before), read_photograph(loaded, after)
        np.testing.assert_array_equal(got_valid, wanted_valid)
        np.testing.assert_allclose(got, wanted, rtol=2**-11, atol=1e-7)  # half's eleven bits
    json.loads((tmp_path / "out" / "transforms.json").read_text())


@pytest.mark.parametrize("name", ["diligent_cat", "diligent_reading"])
def test_real_captures_load(name: str) -> None:
    folder = Path(__file__).parents[3] / "shared" / "captures" / name
    if not folder.is_dir():
        pytest.skip("the real photographs, ../shared/captures, are not here: they are not redistributed")
    capture = load_capture(folder)
    assert len(capture.split("train")) == 24 and len(capture.split("test")) == 12 and capture.unit == "mm"
    radiance, is_valid = read_photograph(capture, capture.photographs[0])
    # Sixteen bits, not eight: far more levels than 256.
    assert len(np.unique(radiance)) > 2000 and 0.3 < is_valid.mean() < 0.7

"""Files of other programs: light lists of RTI, cameras of COLMAP and Metashape, and a capture made of them."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.io.capture import read_photograph
from relight3d.io.colmap import read_colmap
from relight3d.io.images import write_png
from relight3d.io.importers import camera_of_image, capture_from_parts, import_cameras
from relight3d.io.metashape import read_metashape
from relight3d.io.rti import import_dome, import_lp
from relight3d.lights import DirectionalLight, PointLight
from tests.io.folders import HEIGHT, WIDTH, CaptureFolder

# A camera at (1, 2, 3) that looks along the world's +x with the world's z up: OpenGL axes in columns.
POSE = np.array([[0.0, 0, -1, 1], [-1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 0, 1]])
CAMERA = Camera(WIDTH, HEIGHT, 6.0, 6.0, 3.0, 2.0, world_from_camera=POSE)


def write(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_text(text, encoding=encoding)
    return path


# ------------------------------------------------------------------------------------------- light lists


LP_LINES = [
    ("plain.jpg 0.6 0.0 0.8", "plain.jpg", (0.6, 0.0, 0.8)),
    ("tabs.jpg\t0.6\t-0.8\t0", "tabs.jpg", (0.6, -0.8, 0.0)),
    ("comma.jpg 0,6 0,0 0,8", "comma.jpg", (0.6, 0.0, 0.8)),
    ("csv.jpg,0.6,0.0,0.8", "csv.jpg", (0.6, 0.0, 0.8)),
    ("mixed.jpg; 0,6; 0; 0,8;", "mixed.jpg", (0.6, 0.0, 0.8)),
    (r"C:\RTI data\day 1\a b.jpg 6e-1 .0 +.8", "a b.jpg", (0.6, 0.0, 0.8)),
    ('"quoted name.jpg" 0.6 0 0.8', "quoted name.jpg", (0.6, 0.0, 0.8)),
    ("scale.jpg 300 0 400", "scale.jpg", (0.6, 0.0, 0.8)),
]


@pytest.mark.parametrize(("line", "name", "to_light"), LP_LINES)
@pytest.mark.parametrize("head", ["1\n", "\ufeff1\r\n\r\n# made by hand\r\n", ""])
def test_every_way_a_light_is_listed(tmp_path: Path, head: str, line: str, name: str, to_light: tuple) -> None:
    imported = import_lp(write(tmp_path / "a.lp", f"{head}{line}\n\n"))
    assert list(imported.lights) == [name]
    light = imported.lights[name][0]
    assert isinstance(light, DirectionalLight)
    np.testing.assert_allclose(light.to_light, to_light, atol=1e-12)
    # A white surface that faces it has radiance irradiance / pi = 1.
    np.testing.assert_allclose(light.irradiance, np.pi)


def test_what_was_odd_is_noted(tmp_path: Path) -> None:
    path = write(tmp_path / "a.lp", "9\na.jpg 300 0 400\nb.jpg 0 0.6 -0.8\na.jpg 0 0 1\n")
    notes = "\n".join(import_lp(path).notes)
    for words in ("says 9 images and lists 3", "length 1 to 500", "1 lights come from behind", "listed twice"):
        assert words in notes
    assert import_lp(write(path, "1\na.jpg 0 0.6 0.8\n")).notes == ()


def test_lights_turn_with_the_camera(tmp_path: Path) -> None:
    path = write(tmp_path / "a.lp", "1\na.jpg 0 0 1\n")
    # z towards the camera: it looks along +x, so the light comes from -x.
    np.testing.assert_allclose(import_lp(path, camera=CAMERA).lights["a.jpg"][0].to_light, (-1, 0, 0), atol=1e-12)


def test_listed_images_are_looked_for(tmp_path: Path) -> None:
    images = tmp_path / "images"
    for name in ("IMG_1.png", "IMG_2.png", "other.png"):
        write_png(images / name, np.zeros((2, 2), np.uint8))
    path = write(tmp_path / "a.lp", "3\nimg_1.PNG 0 0 1\nIMG_2.jpg 0 0.6 0.8\ngone.jpg 0.6 0 0.8\n")
    imported = import_lp(path, images)
    assert set(imported.lights) == {"IMG_1.png", "IMG_2.png"}
    assert "a.lp: listed but missing: gone.jpg" in imported.notes
    assert "a.lp: not listed, left out: other.png" in imported.notes
    with pytest.raises(InputError, match=r"1 images, none of them in"):
        import_lp(write(path, "1\ngone.jpg 0 0 1\n"), images)
    with pytest.raises(InputError, match=r"nowhere: got No such file"):
        import_lp(path, tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no light"),
        ("24\n", "no light"),
        ("1\na.jpg 1 2\n", "a.lp line 2: got a.jpg 1 2"),
        ("1\na.jpg 0 0 0\n", "a.lp line 2: "),
        ("1\na.jpg 0 0 north\n", "a.lp line 2: "),
        ("1\na.jpg 0 0 nan\n", "a.lp line 2: "),
        ("1\n0.1 0.2 0.3\n", "a.lp line 2: "),
    ],
)
def test_a_list_without_lights_is_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        import_lp(write(tmp_path / "a.lp", text))


def xyz(*values: float) -> dict:
    return dict(zip("xyz", values))


def test_a_dome_gives_directions_or_lamps(tmp_path: Path) -> None:
    images = tmp_path / "images"
    for name in ("b.png", "a.png"):
        write_png(images / name, np.zeros((2, 2), np.uint8))
    dome = {
        "lightConfiguration": "directional",
        "directions": [xyz(0, 0, 1), xyz(0, 0.6, 0.8)],
        "positions3d": [xyz(0, 0, 300), xyz(0, 300, 400)],
        "ledAdjust": [{"r": 1.0, "g": 1.0, "b": 1.0}, {"r": 1.0, "g": 0.9, "b": 1.0}],
    }
    path = tmp_path / "led.dome"
    imported = import_dome(write(path, json.dumps(dome)), images)
    np.testing.assert_allclose(imported.lights["b.png"][0].to_light, (0, 0.6, 0.8))
    assert "ledAdjust is not applied" in imported.notes[0]
    dome["lightConfiguration"] = "lights3d"
    imported = import_dome(write(path, json.dumps(dome)), images, CAMERA, origin=(1.0, 2.0, 3.0), units_per_mm=0.001)
    lamp = imported.lights["a.png"][0]
    assert isinstance(lamp, PointLight)
    np.testing.assert_allclose(lamp.position, (1 - 0.3, 2, 3))
    np.testing.assert_allclose(np.array(lamp.intensity) / 0.3**2, np.pi)  # irradiance pi at the dome's middle
    for spoilt in ({"positions3d": [xyz(0, 0, 1)]}, {"positions3d": []}, {"positions3d": [xyz(0, 0, 0)] * 2}):
        with pytest.raises(InputError, match=r"led.dome positions3d"):
            import_dome(write(path, json.dumps(dome | spoilt)), images)
    for spoilt in ({"positions3d": 3}, {"positions3d": xyz(0, 0, 1)}, {"ledAdjust": 1.0}):
        with pytest.raises(InputError, match=rf"led.dome {next(iter(spoilt))}: got .*, expected a list"):
            import_dome(write(path, json.dumps(dome | spoilt)), images)
    odd = dome | {"ledAdjust": [{"r": [1.0]}]}  # what no list of numbers is, is not applied either
    assert "ledAdjust is not applied" in import_dome(write(path, json.dumps(odd)), images).notes[0]
    for scale in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="units_per_mm"):
            import_dome(path, images, units_per_mm=scale)


# ------------------------------------------------------------------------------------------------ cameras

# The same pose as POSE for COLMAP: camera_from_world with OpenCV axes (x right, y down, z forward).
OPENCV_FROM_WORLD = np.linalg.inv(POSE @ np.diag([1.0, -1, -1, 1]))
QUATERNION = (0.5, 0.5, -0.5, 0.5)  # of its rotation; checked below
CAMERAS_TXT = (
    "# Camera list\n1 OPENCV 640 480 500 510 320.5 239 0.01 -0.02 0.001 0.002\n7 SIMPLE_RADIAL 64 48 50 32 24 0.1\n"
)
IMAGES_TXT = (
    "# Image list with two lines of data per image:\n"
    "1 {q} {t} 1 a b/first image.jpg\n10.5 20.5 -1 30 40 7\n"
    "2 {q} {t} 7 second.jpg\n\n"
).format(q=" ".join(map(str, QUATERNION)), t=" ".join(map(str, OPENCV_FROM_WORLD[:3, 3])))


def colmap_bin() -> tuple[bytes, bytes]:
    """The same model in binary."""
    first, second = [500, 510, 320.5, 239, 0.01, -0.02, 0.001, 0.002], [50, 32, 24, 0.1]
    cameras = struct.pack("<QiiQQ8d", 2, 1, 4, 640, 480, *first) + struct.pack("<iiQQ4d", 7, 2, 64, 48, *second)
    pose = [*QUATERNION, *OPENCV_FROM_WORLD[:3, 3]]
    points = struct.pack("<Qddqddq", 2, 10.5, 20.5, -1, 30, 40, 7)
    images = struct.pack("<Qi7di", 2, 1, *pose, 1) + b"a b/first image.jpg\0" + points
    return cameras, images + struct.pack("<i7di", 2, *pose, 7) + b"second.jpg\0" + struct.pack("<Q", 0)


@pytest.fixture(params=["txt", "bin"])
def colmap_folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == "txt":
        write(tmp_path / "cameras.txt", CAMERAS_TXT)
        write(tmp_path / "images.txt", IMAGES_TXT)
    else:
        for name, data in zip(("cameras.bin", "images.bin"), colmap_bin()):
            (tmp_path / name).write_bytes(data)
    return tmp_path


def test_colmap_cameras_in_our_axes(colmap_folder: Path) -> None:
    cameras = import_cameras(colmap_folder)
    assert list(cameras) == ["a b/first image.jpg", "second.jpg"]
    camera = cameras["a b/first image.jpg"]
    assert camera.to_dict() | {"transform_matrix": None} == {
        **{"w": 640, "h": 480, "fl_x": 500, "fl_y": 510, "cx": 320.5, "cy": 239},
        **{"k1": 0.01, "k2": -0.02, "p1": 0.001, "p2": 0.002, "transform_matrix": None},
    }
    np.testing.assert_allclose(camera.world_from_camera, POSE, atol=1e-12)
    # What lies ahead of COLMAP's camera along its +z, and below along its +y, does so in ours.
    ahead = np.linalg.inv(OPENCV_FROM_WORLD) @ (0.5, 1.0, 10.0, 1.0)
    (image_point,), (depth,) = cameras["second.jpg"].project(ahead[None, :3])
    r2 = 0.05**2 + 0.1**2
    np.testing.assert_allclose(image_point, np.array([32, 24]) + 50 * np.array([0.05, 0.1]) * (1 + 0.1 * r2))
    assert depth == pytest.approx(10.0)


def test_a_damaged_colmap_model_is_refused(colmap_folder: Path) -> None:
    for path in sorted(colmap_folder.iterdir()):
        whole = path.read_bytes()
        for length in range(0, len(whole) - 12, 7):
            path.write_bytes(whole[:length])
            try:
                read_colmap(colmap_folder)  # a text cut between two lines is whole
            except InputError as error:
                assert "\n" not in str(error)
        path.write_bytes(b"\xff" * 200)
        with pytest.raises(InputError, match="damaged file"):
            read_colmap(colmap_folder)
        path.write_bytes(whole)


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("cameras.txt", "OPENCV", "THIN_PRISM_FISHEYE", "camera model: got THIN_PRISM_FISHEYE.*image_undistorter"),
        ("cameras.txt", "500 510", "510", "camera of model OPENCV"),
        ("cameras.txt", "500 510", "-500 510", r"images.txt a b/first image.jpg camera fl_x, fl_y: got \(-500"),
        ("cameras.txt", "500 510", "nan 510", "camera of model OPENCV"),
        ("images.txt", "7 second", "8 second", r"images.txt second.jpg: got camera 8, expected one of \[1, 7\]"),
        ("images.txt", "0.5 0.5 -0.5 0.5", "0 0 0 0", "quaternion"),
        ("images.txt", IMAGES_TXT, "# none\n", "no registered image"),
    ],
)
def test_a_slip_in_a_colmap_model_is_named(tmp_path: Path, file: str, old: str, new: str, words: str) -> None:
    texts = {"cameras.txt": CAMERAS_TXT, "images.txt": IMAGES_TXT}
    for name, text in texts.items():
        write(tmp_path / name, text.replace(old, new) if name == file else text)
    with pytest.raises(InputError, match=words):
        read_colmap(tmp_path)


METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true">
  <sensors><sensor id="0" label="lens" type="frame"><resolution width="640" height="480"/>
    <calibration type="frame" class="adjusted"><resolution width="640" height="480"/>
      <f>500</f><cx>2.5</cx><cy>-1</cy><b1>10</b1><k1>0.01</k1><k2>-0.02</k2><k3>0</k3><p1>0.002</p1><p2>0.001</p2>
    </calibration></sensor></sensors>
  COMPONENTS
  <cameras>
    <camera id="0" sensor_id="0" COMPONENT label="DSC_1"><transform>{camera}</transform></camera>
    <camera id="1" sensor_id="0" label="not aligned"/>
  </cameras>
  <transform><rotation>{rotation}</rotation><translation>10 20 30</translation><scale>2</scale></transform>
</chunk></document>"""
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # a quarter turn about z
METASHAPE = METASHAPE.replace("{camera}", " ".join(map(str, (POSE @ np.diag([1.0, -1, -1, 1])).ravel()))).replace(
    "{rotation}", " ".join(map(str, TURN.ravel()))
)


def test_metashape_cameras_in_our_axes(tmp_path: Path) -> None:
    cameras = import_cameras(
        write(tmp_path / "cameras.xml", METASHAPE.replace("COMPONENTS", "").replace("COMPONENT", ""))
    )
    assert list(cameras) == ["DSC_1"]
    camera = cameras["DSC_1"]
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (510, 500, 322.5, 239)
    assert (camera.k1, camera.k2, camera.p1, camera.p2) == (0.01, -0.02, 0.001, 0.002)
    np.testing.assert_allclose(camera.world_from_camera[:3, :3], TURN @ POSE[:3, :3], atol=1e-12)
    np.testing.assert_allclose(camera.center, 2 * TURN @ (1, 2, 3) + (10, 20, 30))


def test_metashape_components_have_their_own_place(tmp_path: Path) -> None:
    component = (
        '<components><component id="4"><transform><translation>5 6 7</translation></transform></component></components>'
    )
    text = METASHAPE.replace("COMPONENTS", component).replace("COMPONENT", 'component_id="4"')
    np.testing.assert_allclose(read_metashape(write(tmp_path / "a.xml", text))["DSC_1"].center, (6, 8, 10))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<document", "<documen", "no valid XML"),
        ("<k3>0<", "<k3>0.5<", "sensor 0 k3: got 0.5: .* pixels.*undistorted"),
        ("<f>500<", "<f>wide<", "sensor 0: got .*wide"),
        ("<f>500<", "<f>nan<", "sensor 0: .*finite"),
        ("<f>500</f>", "", "sensor 0: got no focal length"),
        ("<f>500<", "<f>-500<", "sensor 0"),
        ('type="frame" class', 'type="fisheye" class', "a fisheye camera"),
        ('sensor_id="0" COMPONENT', 'sensor_id="3"', "camera DSC_1: got sensor 3"),
        ("<transform>0.0 ", "<transform>", "camera DSC_1: got .*16 numbers"),
        ("<scale>2<", "<scale>two<", "chunk transform: got two"),
        ("<camera ", "<photo ", "no valid XML"),
        ("chunk", "lump", "no chunk"),
        ("<transform>0.0", "<transform>3.0", "camera DSC_1 transform_matrix"),
    ],
)
def test_a_slip_in_a_metashape_file_is_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = METASHAPE.replace("COMPONENTS", "")
    assert old in text
    with pytest.raises(InputError, match=words):
        read_metashape(write(tmp_path / "a.xml", text.replace(old, new).replace("COMPONENT", "")))


def test_one_camera_of_many_must_be_named() -> None:
    cameras = {"day 1/a.jpg": CAMERA, "day 1/b.jpg": CAMERA}
    assert camera_of_image({"a": CAMERA}) is CAMERA
    for name in ("day 1/a.jpg", "a.jpg", "a", "C:\\x\\a.jpg"):
        assert camera_of_image(cameras, name) is CAMERA
    with pytest.raises(InputError, match="camera image: got none, of 2"):
        camera_of_image(cameras)
    with pytest.raises(InputError, match=r"camera image: got c.jpg, expected one of the 2"):
        camera_of_image(cameras, "c.jpg")


# ---------------------------------------------------------------------------------------- the whole import


def test_a_capture_is_made_of_its_parts(
    capture_folder: CaptureFolder, tmp_path_factory: pytest.TempPathFactory
) -> None:
    parts = capture_folder.path
    camera = capture_folder.load().camera
    lights = import_lp(
        write(parts / "a.lp", "4\n" + "".join(f"{i}.png 0 0.{i} 0.8\n" for i in range(4))), parts / "images"
    )
    folder = tmp_path_factory.mktemp("made") / "desk"
    capture = capture_from_parts(
        *(folder, parts / "mesh.ply", camera, lights.lights, parts / "images", "srgb"),
        mask=parts / "mask.png",
        test=["3.png"],
        unit="mm",
    )
    assert [p.split for p in capture.photographs] == ["train"] * 3 + ["test"]
    assert capture.camera.to_dict() == camera.to_dict() and capture.unit == "mm" and capture.color_space == "srgb"
    assert not read_photograph(capture, capture.photographs[0])[1][0, 0]
    assert not Path(json.loads((folder / "transforms.json").read_text())["mesh_path"]).is_absolute()
    with pytest.raises(InputError, match=r"test: got 9.png"):
        capture_from_parts(folder, parts / "mesh.ply", camera, lights.lights, parts / "images", "srgb", test=["9.png"])
    with pytest.raises(InputError, match="lights: got none"):
        capture_from_parts(folder, parts / "mesh.ply", camera, {}, parts / "images", "srgb")


def test_parts_that_make_no_capture_spoil_none(capture_folder: CaptureFolder) -> None:
    parts, camera = capture_folder.path, capture_folder.load().camera
    before = (parts / "transforms.json").read_bytes()
    lights = import_lp(write(parts / "a.lp", "0.png 0 0.1 0.8"), parts / "images").lights
    with pytest.raises(InputError, match="mesh_path"):
        capture_from_parts(parts, parts / "none.ply", camera, lights, parts / "images", "srgb")
    assert (parts / "transforms.json").read_bytes() == before and not list(parts.glob(".*"))

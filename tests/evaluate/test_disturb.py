"""Each fault changes what it names, by how much it says, and nothing else."""

import numpy as np
import pytest

from relight3d.errors import InputError
from relight3d.evaluate import disturb
from relight3d.io.capture import read_photograph
from relight3d.maths.color import exposure_of
from relight3d.records import Capture
from tests.scenes import desk_capture

FAULTS = {
    "noise": lambda c: disturb.with_noise(c, 0.01, 0.02),
    "saturation": lambda c: disturb.with_saturation(c, 0.8),
    "quantisation": lambda c: disturb.with_quantisation(c, 8),
    "misplaced": lambda c: disturb.with_misplaced_mesh(c, 0.5, -0.25, 1.0),
    "blocked": lambda c: disturb.with_blocked_light(c, 1),
    "wrong light": lambda c: disturb.with_wrong_light(c, 1, 20.0),
    "light error": lambda c: disturb.with_light_error(c, 2.0),
    "few": lambda c: disturb.with_few_lights(c, 3),
    "rough": lambda c: disturb.with_rough_mesh(c, 0.01),
    "far": lambda c: disturb.with_far_origin(c, (1e6, -2e6, 300.0)),
}


@pytest.fixture
def capture() -> Capture:
    return desk_capture(num_lights=4)


def stack(capture: Capture, split: str = "train") -> np.ndarray:
    return np.stack([read_photograph(capture, photograph)[0] for photograph in capture.split(split)])


@pytest.mark.parametrize("fault", FAULTS)
def test_held_out_photographs_and_the_old_capture_stay(fault: str, capture: Capture):
    before, test_before = stack(capture), stack(capture, "test")
    disturbed = FAULTS[fault](capture)
    np.testing.assert_array_equal(stack(capture), before)
    np.testing.assert_array_equal(stack(disturbed, "test"), test_before)
    if fault != "far":
        assert [p.lights for p in disturbed.split("test")] == [p.lights for p in capture.split("test")]


def test_noise_has_its_size_and_its_seed(capture: Capture):
    clean, white = stack(capture), 1 / exposure_of(stack(capture))
    noisy = stack(disturb.with_noise(capture, 0.03))
    assert (noisy - clean).std() / white == pytest.approx(0.03, rel=0.03)
    np.testing.assert_array_equal(noisy, stack(disturb.with_noise(capture, 0.03)))
    assert not np.array_equal(noisy, stack(disturb.with_noise(capture, 0.03, seed=1)))
    shot = stack(disturb.with_noise(capture, 0.0, shot=0.05)) - clean
    assert shot[clean == 0].max() == 0.0
    bright = clean > 0.5 * white
    ratio = shot[bright] / np.sqrt(clean[bright] * white)
    assert ratio.std() == pytest.approx(0.05, rel=0.05)


def test_saturation_and_quantisation(capture: Capture):
    white = 1 / exposure_of(stack(capture))
    assert stack(disturb.with_saturation(capture, 0.8)).max() == pytest.approx(0.8 * white, rel=1e-6)
    coarse = stack(disturb.with_quantisation(capture, 4))
    assert len(np.unique(coarse)) <= 16
    below = stack(capture) <= white
    assert np.abs(coarse - stack(capture))[below].max() <= 0.5001 * white / 15


def test_photographs_show_a_misplaced_mesh_right_and_below(capture: Capture):
    camera, middle = capture.camera, capture.mesh.vertices.mean(axis=0)
    moved = disturb.with_misplaced_mesh(capture, 3.0, 2.0)
    off = camera.project(capture.mesh.vertices)[0] - camera.project(moved.mesh.vertices)[0]
    nearest = np.argmin(np.linalg.norm(capture.mesh.vertices - middle, axis=1))
    np.testing.assert_allclose(off[nearest], (3.0, 2.0), rtol=0.2)
    turned = disturb.with_misplaced_mesh(capture, 0.0, 0.0, 2.0)
    off = camera.project(capture.mesh.vertices)[0] - camera.project(turned.mesh.vertices)[0]
    arm = camera.project(capture.mesh.vertices)[0] - (camera.cx, camera.cy)
    # Clockwise in a picture whose y runs down: what is right of the middle goes down, what is below goes left.
    np.testing.assert_allclose(off, np.deg2rad(2.0) * np.stack([-arm[:, 1], arm[:, 0]], axis=1), atol=0.1)


def test_a_blocked_light_darkens_one_photograph(capture: Capture):
    blocked, clean = stack(disturb.with_blocked_light(capture, 1, 0.25)), stack(capture)
    assert blocked[1, :, :16].max() == 0.0
    np.testing.assert_array_equal(blocked[1, :, 16:], clean[1, :, 16:])
    np.testing.assert_array_equal(blocked[[0, 2, 3]], clean[[0, 2, 3]])


@pytest.mark.parametrize("distance", [None, 3.0])
def test_a_wrong_light_stands_where_it_says(distance: float | None):
    capture = desk_capture(num_lights=4, distance=distance)
    wrong = disturb.with_wrong_light(capture, 2, 15.0)
    vertices = capture.mesh.vertices
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    for i, (a, b) in enumerate(zip(capture.split("train"), wrong.split("train"))):
        to_a, to_b = (p.lights[0].incident(middle[None]).to_light[0] for p in (a, b))
        angle_deg = np.rad2deg(np.arccos(np.clip(to_a @ to_b, -1, 1)))
        assert angle_deg == pytest.approx(15.0 if i == 2 else 0.0, abs=1e-5)


def test_light_error_is_about_its_size():
    capture = desk_capture(num_lights=12)
    off = disturb.with_light_error(capture, 2.0)
    pairs = zip(capture.split("train"), off.split("train"))
    cosine = [np.dot(a.lights[0].to_light, b.lights[0].to_light) for a, b in pairs]
    rms_deg = np.sqrt(np.mean(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))) ** 2))
    assert 1.0 < rms_deg < 3.5  # twelve draws


def test_few_lights_keep_the_first(capture: Capture):
    few = disturb.with_few_lights(capture, 2)
    assert [p.name for p in few.split("train")] == ["train_000", "train_001"]
    assert len(few.split("test")) == len(capture.split("test"))


def test_a_rough_mesh_stays_closed(capture: Capture):
    rough = disturb.with_rough_mesh(capture, 0.01).mesh
    error = rough.vertices - capture.mesh.vertices
    # Ten times smaller a sigma per vertex than the box's size; a thousand draws.
    assert error.std() == pytest.approx(0.01, rel=0.1)
    num_places = len(np.unique(capture.mesh.vertices, axis=0))
    assert len(np.unique(rough.vertices, axis=0)) == num_places < len(rough.vertices)


def test_a_far_origin_moves_everything_together():
    capture = desk_capture(num_lights=4, distance=3.0)
    move = (1e6, -2e6, 300.0)
    far = disturb.with_far_origin(capture, move)
    assert all(p.camera is far.camera for p in far.split("train"))
    np.testing.assert_allclose(far.camera.center - capture.camera.center, move)
    np.testing.assert_allclose(
        far.mesh.vertices - capture.mesh.vertices, np.broadcast_to(move, far.mesh.vertices.shape)
    )
    near_light, far_light = capture.photographs[0].lights[0], far.photographs[0].lights[0]
    np.testing.assert_allclose(np.subtract(far_light.position, near_light.position), move)


def test_an_index_beyond_the_photographs_is_named(capture: Capture):
    with pytest.raises(InputError, match="index: got 4, expected a training photograph, 0 to 3"):
        disturb.with_blocked_light(capture, 4)

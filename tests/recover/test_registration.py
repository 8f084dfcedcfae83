"""The mesh is moved to where the photographs show it, and stays where it is when they say nothing else."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import relight3d
from relight3d.errors import InputError
from relight3d.evaluate.disturb import with_few_lights, with_light_error, with_misplaced_mesh, with_noise
from relight3d.io.capture import load_capture
from relight3d.records import Capture, RelightModel
from relight3d.recover.mesh import MeshOptions
from relight3d.recover.registration import Misplacement, RegistrationOptions, misplacement, place
from relight3d.recover.run import Clock, RecoverOptions, begin, recover, register
from tests.scenes import metal_capture

TINY = Path(__file__).resolve().parents[2] / "data" / "desk_tiny"

OFF, AUTO = RegistrationOptions(method="off"), RegistrationOptions()


@cache
def tiny() -> Capture:
    return load_capture(TINY)


def measured(capture: Capture) -> Misplacement | None:
    return misplacement(*begin(capture, RecoverOptions(), Clock(None, 9)).first, AUTO)


def recovered(capture: Capture, registration: RegistrationOptions = AUTO) -> RelightModel:
    return recover(capture, RecoverOptions(prices=False, registration=registration), quiet=True)


def held_out_db(model: RelightModel, capture: Capture) -> float:
    return relight3d.evaluate(model, capture, baselines=False).model.mean.psnr_db


@pytest.mark.parametrize("right_px, down_px", [(0.5, 0.0), (0.0, -1.0), (-0.6, 0.6)])
def test_a_shift_is_measured(right_px: float, down_px: float):
    found = measured(with_misplaced_mesh(tiny(), right_px, down_px))
    assert found is not None and found.is_clear(AUTO)
    wanted = np.hypot(right_px, down_px)
    assert found.shift_px == pytest.approx(wanted, abs=0.15)
    assert found.error_px < 0.1


def pixels_off(capture: Capture) -> float:
    """How far the mesh's vertices are from their true places in the picture, on average, once it is placed."""
    placed, camera = register(capture, RecoverOptions(), Clock(None, 9)), tiny().camera
    true, found = (camera.project(mesh.vertices)[0] for mesh in (tiny().mesh, placed.mesh))
    inside = (true > 0).all(axis=1) & (true < (camera.width, camera.height)).all(axis=1)
    return float(np.linalg.norm(found - true, axis=1)[inside].mean())


@pytest.mark.parametrize("shift_px, turn_deg", [((0.5, 0.0), 0.0), ((1.5, 1.0), 0.0), ((0.3, -0.4), 1.0)])
def test_a_misplaced_mesh_is_moved_back(shift_px: tuple[float, float], turn_deg: float):
    assert pixels_off(with_misplaced_mesh(tiny(), *shift_px, turn_deg)) < 0.25


def test_held_out_photographs_gain_what_the_misplacement_cost():
    off = with_misplaced_mesh(tiny(), 0.5, 0.0)
    wanted, without, model = recovered(tiny(), OFF), recovered(off, OFF), recovered(off)
    assert held_out_db(without, off) < held_out_db(wanted, tiny()) - 3
    assert held_out_db(model, off) > held_out_db(wanted, tiny()) - 1
    assert any("+0.5" in line and "it was moved there" in line for line in model.warnings)
    # In its place, registration changes nothing at all.
    same = recovered(tiny())
    assert np.array_equal(wanted.mesh.vertices, same.mesh.vertices)
    assert np.array_equal(wanted.pixels.albedo, same.pixels.albedo)
    assert not any("place" in line for line in same.warnings)


@pytest.mark.parametrize(
    "spoilt",
    [
        lambda c: with_noise(c, 0.05),
        lambda c: with_light_error(c, 1.0),
        lambda c: with_few_lights(c, 6),
    ],
    ids=["noise", "lights 1 degree off", "six photographs"],
)
def test_faults_of_another_kind_are_no_misplacement(spoilt):
    assert pixels_off(spoilt(tiny())) < 0.15


def test_too_few_photographs_say_nothing():
    assert measured(with_misplaced_mesh(with_few_lights(tiny(), 3), 1.0, 0.0)) is None


class Rig:
    """A fit that shows a share of what is still to go; photographs 0.8 pixels to the right."""

    def __init__(self, share: float, misfit=lambda left: 1.0 + left**2):
        self.mesh, self.camera, self.share, self.misfit, self.fits = tiny().mesh, tiny().camera, share, misfit, 0
        self.unit = np.ones(6)
        self.unit[3] = float(np.linalg.norm(self.mesh.vertices.mean(axis=0) - self.camera.center)) / self.camera.fx

    def fit(self, mesh):
        self.fits += 1
        step = (mesh.vertices - self.mesh.vertices) @ self.camera.world_from_camera[:3, 0]
        return 0.8 - step.mean() / self.unit[3]

    def measure(self, left, scale):
        motion = np.zeros(6)
        motion[3] = self.share * left
        return Misplacement(motion, np.zeros((6, 6)), np.eye(6), self.unit, self.misfit(abs(left)), 1.0)

    def place(self, **options):
        return place(self.mesh, self.camera, self.fit, self.measure, RegistrationOptions(**options))


@pytest.mark.parametrize("share", [1.0, 0.6, 0.25])
def test_steps_are_lengthened_where_a_fit_hides_a_share(share: float):
    rig = Rig(share)
    assert abs(rig.place().fit) < 0.1
    assert rig.fits <= 4


def test_a_motion_that_does_not_help_is_taken_back():
    rig = Rig(1.0, misfit=lambda left: 2.0 - left)
    placed = rig.place()
    assert placed.mesh is rig.mesh and placed.fit == 0.8 and placed.notes == ()


def test_a_mesh_far_off_is_left_with_a_warning():
    rig = Rig(30.0)
    placed = rig.place()
    assert placed.mesh is rig.mesh and rig.fits == 1
    assert "24 pixels off its place" in placed.notes[0]


def test_off_measures_nothing():
    rig = Rig(1.0)
    rig.measure = lambda fit, scale: pytest.fail("measured")
    assert rig.place(method="off").fit == 0.8


def test_lights_off_and_spoilt_photographs_do_not_count():
    capture = with_misplaced_mesh(tiny(), 0.5, 0.0)
    dark = [replace(p, lights=()) if p.split == "train" else p for p in capture.photographs]
    first = begin(replace(capture, photographs=tuple(dark)), RecoverOptions(), Clock(None, 9)).first
    assert misplacement(*first, RegistrationOptions()) is None


@pytest.mark.parametrize(
    "options",
    [
        {"method": "on"},
        {"min_shift_px": 0.0},
        {"min_shift_px": 9.0},
        {"max_steps": 0},
        {"min_certainty": float("nan")},
        {"max_shift_px": 1e3},
    ],
)
def test_options_out_of_range_are_refused(options: dict):
    with pytest.raises(InputError, match="registration"):
        RegistrationOptions(**options)


def test_a_mesh_in_its_place_stays_there_beside_dark_metal() -> None:
    """Metal without an albedo: what no albedo explains of it falls as the mesh leaves its place, and all else rises."""
    options = RecoverOptions(mesh=MeshOptions(target_faces=2000), num_alternations=2)
    assert register(metal_capture(0.0), options, Clock(None, 9)).notes == ()

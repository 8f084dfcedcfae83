"""Shadows that the mesh does not throw: told from all else that is dark, left out, and named."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.evaluate import disturb
from relight3d.evaluate.run import evaluate
from relight3d.records import Capture, Observations
from relight3d.recover import visibility
from relight3d.recover.blockers import darker_than_usual
from relight3d.recover.mesh import prepare_mesh
from relight3d.recover.run import RecoverOptions, ray_scene, recover
from relight3d.recover.training import read_training
from relight3d.views import points_seen
from tests.plan.models import QUICK, rich_capture


def observed_of(capture: Capture, blockers: bool = True) -> tuple[Observations, np.ndarray]:
    """The observations before any fit, and each point's column as a share of the picture's width."""
    mesh = prepare_mesh(capture.mesh, RecoverOptions().mesh)
    rays = ray_scene(mesh)
    points = points_seen(rays, mesh, capture.camera)
    photographs = read_training(capture, mesh, points)
    options = visibility.VisibilityOptions(blockers=blockers)
    observed = visibility.observe(
        rays, mesh, points, capture.camera, photographs.radiance, photographs.is_valid, photographs.lights, options
    )
    return observed, points.pixel % capture.camera.width / capture.camera.width


def first_lit(capture: Capture) -> int:
    return next(i for i, p in enumerate(capture.split("train")) if p.lights)


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_the_part_in_shadow_is_left_out_and_no_other(share: float) -> None:
    clean = rich_capture()
    index = first_lit(clean) + 2
    spoilt = disturb.with_blocked_light(clean, index, share)
    observed, column = observed_of(spoilt)
    had = observed_of(spoilt, blockers=False)[0].weight > 0
    lit, is_out = observed.is_lit[index] & had[index], had & (observed.weight == 0)
    assert not np.delete(is_out, index, axis=0).any()
    is_out = is_out[index]
    assert is_out[lit & (column < share - 0.1)].mean() > 0.95
    if share < 0.3:  # a larger shadow's indirect light is missed all over the photograph
        assert is_out[lit & (column > share + 0.1)].mean() < 0.02
    else:
        assert is_out[had[index]].all()
    assert [i for i, lost in enumerate(observed.blocked_share) if lost > 0] == [index]


@pytest.mark.parametrize(
    "capture",
    [
        rich_capture,
        lambda: disturb.with_noise(rich_capture(), 0.05),
        lambda: disturb.with_light_error(rich_capture(), 2.0),
        lambda: disturb.with_saturation(rich_capture(), 0.7),
        lambda: disturb.with_few_lights(rich_capture(), 4),
    ],
    ids=["clean", "noise", "lights off by 2 degrees", "saturated", "four lights"],
)
def test_nothing_else_is_taken_for_a_blocker(capture) -> None:
    observed, _ = observed_of(capture())
    assert observed.blocked_share == ()


def test_a_lamp_that_fails_as_a_whole_is_no_blocker() -> None:
    """All of a photograph: its lamp is weaker than the file says, of which another part of the project speaks."""
    clean = rich_capture()
    observed, _ = observed_of(disturb.with_blocked_light(clean, first_lit(clean) + 2, 1.0))
    assert observed.blocked_share == ()


def test_a_point_is_as_bright_as_usual_whatever_the_lamps_power() -> None:
    """Radiance over irradiance: less 1 it is 0 for all that is matte, with the ambient light taken off."""
    observed, _ = observed_of(rich_capture())
    relative = darker_than_usual(observed)
    assert np.isfinite(relative).mean() > 0.2
    assert abs(np.nanmedian(relative)) < 0.05 and np.nanquantile(np.abs(relative), 0.8) < 0.3
    dimmed = replace(observed, radiance=observed.radiance * 0.2, form=observed.form * 0.2)
    np.testing.assert_allclose(darker_than_usual(dimmed), relative, rtol=1e-3, atol=1e-4)


def test_it_is_named_and_costs_little() -> None:
    clean = rich_capture()
    index = first_lit(clean) + 2
    spoilt = disturb.with_blocked_light(clean, index, 0.4)
    found, whole = (recover(c, QUICK, quiet=True) for c in (spoilt, clean))
    assert sum("a shadow that the mesh does not throw" in w and f" {index} (" in w for w in found.warnings) == 1
    assert not any("does not throw" in w for w in whole.warnings)
    left_in = recover(spoilt, replace(QUICK, visibility=visibility.VisibilityOptions(blockers=False)), quiet=True)
    score = {
        name: evaluate(m, clean, baselines=False).model.mean.psnr_db
        for name, m in (("found", found), ("whole", whole), ("left in", left_in))
    }
    assert score["found"] > score["whole"] - 0.5 and score["found"] > score["left in"] + 2.0, score

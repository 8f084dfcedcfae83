"""Gloss by colour: glaze on clay, two inks of one print."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.evaluate.run import evaluate
from relight3d.evaluate.scenes import Material, Scene, hemisphere_lights, plastic, scene_camera
from relight3d.evaluate.shapes import joined, sphere
from relight3d.evaluate.synthetic import synthesize
from relight3d.records import Capture, RelightModel
from relight3d.recover.rounds import relief
from relight3d.recover.run import recover
from tests.plan.models import QUICK, means

CLAY, GLAZE = (0.5, 0.4, 0.3), (0.08, 0.06, 0.15)
SIZE = (80, 68)


def chequered(*gloss: tuple) -> Capture:
    """A ball with waves, one scan without labels, chequered in two colours of this gloss; pixels are means of 4 x 4."""
    mesh = joined({"ball": sphere(0.7, 48)})
    x, y, z = mesh.vertices[mesh.faces].mean(axis=1).T
    polar = np.arctan2(z, np.hypot(x, y))
    field = np.floor(np.arctan2(y, x) * 6 / np.pi) + np.floor(polar * 6 / np.pi)
    mesh = replace(mesh, object_id=(field % 2).astype(np.int32), object_names=None)
    waves = {"relief_slope": 0.08, "num_waves": 8.0}
    materials = tuple(Material(color, lobes=lobes, **waves) for color, lobes in zip((CLAY, GLAZE), gloss, strict=True))
    lights, tests = hemisphere_lights(14, seed=1), hemisphere_lights(5, 30.0, 75.0, seed=2)
    fine = synthesize(Scene(mesh, materials, scene_camera(4 * SIZE[0], 4 * SIZE[1])), lights, test_lights=tests)
    camera = scene_camera(*SIZE)
    photographs = tuple(replace(each, camera=camera, pixels=means(each.pixels)) for each in fine.photographs)
    unlabelled = replace(fine.mesh, object_id=None, object_names=None)
    return replace(fine, camera=camera, photographs=photographs, mesh=unlabelled)


def tells_inks(model: RelightModel) -> bool:
    return any("gloss by colour" in line.reason for line in model.decisions if line.effect == "detail")


def test_colours_that_shine_unlike_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    capture = chequered((), (plastic(1.2, 60.0),))
    told = recover(capture, QUICK, quiet=True)
    assert tells_inks(told)
    is_dark = told.pixels.albedo.mean(axis=1) < 0.12
    is_light = told.pixels.albedo.mean(axis=1) > 0.3
    assert np.median(told.pixels.lobe_gain[is_light]) < 0.2 * np.median(told.pixels.lobe_gain[is_dark])
    monkeypatch.setattr(relief, "inks_of", lambda *_: None)
    blind = recover(capture, QUICK, quiet=True)
    ours, theirs = (evaluate(model, capture, baselines=False).model.mean.psnr_db for model in (told, blind))
    assert ours > theirs + 0.7


@pytest.mark.parametrize("gloss", [(), (plastic(0.8, 40.0),)], ids=["matte", "varnished"])
def test_colours_of_one_gloss_are_not_told_apart(gloss: tuple) -> None:
    assert not tells_inks(recover(chequered(gloss, gloss), QUICK, quiet=True))

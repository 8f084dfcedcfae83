"""Highlights about the half-way direction, round and brushed: streaks turn with the surface, from texture coordinates or
from the mesh's own axes.
"""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.evaluate.run import evaluate
from relight3d.evaluate.scenes import Material, Scene, hemisphere_lights, plastic, scene_camera
from relight3d.evaluate.shapes import box, joined, plane, sphere, transformed
from relight3d.evaluate.synthetic import synthesize
from relight3d.records import Capture, Lobe
from relight3d.recover.rounds import relief
from relight3d.recover.run import recover
from relight3d.recover.specular import SpecularOptions
from tests.plan.models import QUICK


def turned_part() -> Capture:
    """A ball turned on a lathe: grooves around z, so that its highlight is a streak from pole to pole."""
    grooves = Lobe(
        np.full(3, 0.6), np.array([6.0, 150.0, 1.0])[[1, 0, 2]], 2.0, np.zeros(3), np.array([0, 0, 1.0]), True
    )
    scene = Scene(joined({"ball": sphere(0.7)}), (Material((0.3, 0.3, 0.3), lobes=(grooves,)),), scene_camera(56, 48))
    return synthesize(scene, hemisphere_lights(12, seed=1), test_lights=hemisphere_lights(4, 30.0, 75.0, seed=2))


@pytest.mark.parametrize("has_uvs", [True, False])
def test_grooves_that_turn_with_the_surface_are_found(has_uvs: bool) -> None:
    capture = turned_part()
    capture = capture if has_uvs else replace(capture, mesh=replace(capture.mesh, corner_uvs=None))
    lafortune = SpecularOptions(kinds=("isotropic", "anisotropic", "retro"))
    found, papers = (recover(capture, options, quiet=True) for options in (QUICK, replace(QUICK, specular=lafortune)))
    brushed = [lobe for lobe in found.lobes[0] if lobe.is_halfway]
    assert brushed
    ours, theirs = (evaluate(model, capture, baselines=False).model.mean.psnr_db for model in (found, papers))
    assert ours > theirs + 3.0


def test_rough_metal_s_peak_and_foot_are_one_lobe() -> None:
    """The distribution of Trowbridge and Reitz, which eq. (4)'s lobes need several of: found, and with its own width."""
    rough = Lobe(np.array([0.9, 0.6, 0.3]), np.array([30.0, 30.0, 1.0]), 2.0, is_halfway=True)
    scene = Scene(joined({"ball": sphere(0.7)}), (Material((0.05, 0.05, 0.05), lobes=(rough,)),), scene_camera(56, 48))
    capture = synthesize(scene, hemisphere_lights(12, seed=1), test_lights=hemisphere_lights(4, 30.0, 75.0, seed=2))
    lafortune = SpecularOptions(kinds=("isotropic", "anisotropic", "retro"))
    found, papers = (recover(capture, options, quiet=True) for options in (QUICK, replace(QUICK, specular=lafortune)))
    ours, theirs = (evaluate(model, capture, baselines=False).model.mean.psnr_db for model in (found, papers))
    strongest = max(found.lobes[0], key=lambda lobe: lobe.color.sum())
    assert strongest.is_halfway and strongest.axes[0] == strongest.axes[1]
    assert ours > theirs + 1.0


def test_lobes_are_found_with_relief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of few photographs a wide lobe explains waves and highlights alike, until both are asked for together."""
    parts = {"table": plane(2.4, 2.0, 6, 5), "box": transformed(box(0.5, 0.4, 0.6), None, (-0.5, 0.1, 0.3))}
    waves = Material((0.3, 0.25, 0.2), lobes=(plastic(0.8, 40.0), plastic(0.1, 8.0)), relief_slope=0.1, num_waves=16.0)
    scene = Scene(joined(parts), (waves, Material((0.6, 0.2, 0.15))), scene_camera(80, 60))
    capture = synthesize(scene, hemisphere_lights(10, seed=1), test_lights=hemisphere_lights(4, 30.0, 75.0, seed=2))
    monkeypatch.setattr(relief, "MIN_TOGETHER", 0)
    together = recover(capture, QUICK, quiet=True)
    monkeypatch.setattr(relief, "_lobes_with_relief", lambda stage, observed, mirrors, fitted, *_: fitted)
    apart = recover(capture, QUICK, quiet=True)
    ours, theirs = (evaluate(model, capture, baselines=False).model.mean.psnr_db for model in (together, apart))
    assert ours > theirs + 0.8

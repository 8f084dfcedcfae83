"""Light that a plane mirror throws on a glossy surface: the photographs may show that surface's highlight by it alone."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from relight3d.evaluate.scenes import desk_scene, hemisphere_lights, plastic
from relight3d.evaluate.synthetic import synthesize
from relight3d.forward import shade_points
from relight3d.lights import Light
from relight3d.records import Capture, Lobe
from relight3d.recover.detail import misfit
from relight3d.recover.mesh import MeshOptions
from relight3d.recover.rounds.alternation import diffuse_weights
from relight3d.recover.rounds.gloss import _lobe_samples
from relight3d.recover.rounds.light import direct_irradiance, specular_layers
from relight3d.recover.rounds.reflections import provisional_model
from relight3d.recover.rounds.relief import _detail_data
from relight3d.recover.run import Clock, FirstFit, RecoverOptions, begin, recover
from relight3d.recover.specular import _model
from relight3d.recover.visibility import highlight_zone
from relight3d.shading import lobe_brdf, mirrored_light
from relight3d.views import ViewOptions, build_view
from tests.scenes import HEIGHT, WIDTH

QUICK = RecoverOptions(mesh=MeshOptions(target_faces=1200), num_rounds=1, prices=False, force=("mirror:mirror=on",))
GLOSS = plastic(0.6, 40.0)
TABLE = 0


@cache
def glossy_table() -> Capture:
    """A glossy table before a mirror, lit from the camera's side: only by way of the mirror a highlight is seen."""
    scene = desk_scene(WIDTH, HEIGHT, mirror=True)
    scene = replace(scene, materials=(replace(scene.materials[TABLE], lobes=(GLOSS,)), *scene.materials[1:]))
    return synthesize(scene, front_lights(12, seed=1), test_lights=front_lights(5, seed=2))


def front_lights(num: int, seed: int) -> list[tuple[Light, ...]]:
    lights = hemisphere_lights(8 * num, 20.0, 60.0, seed=seed)
    return [each for each in lights if each[0].to_light[1] < -0.5 * np.abs(each[0].to_light[0])][:num]


@cache
def first() -> FirstFit:
    return begin(glossy_table(), QUICK, Clock(None, 9)).first


def test_only_the_mirror_shows_the_highlight() -> None:
    """What the other tests rest on."""
    stage, observed, mirrors, _ = first()
    (mirror,) = mirrors
    assert observed.thrown is not None
    table, points = (stage.surface == TABLE) & stage.is_matte, stage.points
    direct, thrown = np.zeros((2, len(observed.lights)), int)
    for photo, (light,) in enumerate(observed.lights):
        for count, one, lit in (
            (direct, light, observed.is_lit[photo]),
            (thrown, mirrored_light(light, mirror), observed.thrown[0, photo].max(axis=1) > 0),
        ):
            near = highlight_zone(points, np.broadcast_to(one.incident(points.position)[0], points.normal.shape), 10.0)
            count[photo] = (table & lit & near).sum()
    assert direct.sum() == 0 and (thrown > 20).sum() >= 2


def test_a_lobe_that_only_a_mirror_shows_is_found() -> None:
    """Its peak within a quarter; without what the mirror throws, there is none."""
    model = recover(glossy_table(), QUICK, quiet=True)
    up = np.array([[0.0, 0.0, 1.0]])
    for elevation_deg in (35.0, 45.0):
        level, height = np.cos(np.radians(elevation_deg)), np.sin(np.radians(elevation_deg))
        lamp, viewer = np.array([[0.0, level, height]]), np.array([[0.0, -level, height]])
        found, truth = (lobe_brdf(each, up, lamp, viewer, 0 * up)[0] for each in (model.lobes[TABLE], (GLOSS,)))
        np.testing.assert_allclose(found, truth, rtol=0.25)
    # What the mirror throws is not overrated to make up for the highlight.
    np.testing.assert_allclose(model.mirrors[0].reflectance, 0.8, atol=0.04)


@pytest.mark.parametrize("has_detail", [False, True])
def test_the_fits_light_surfaces_as_the_frames_do(has_detail: bool) -> None:
    """Direct light and lobes of a photograph, by the rounds and by the forward model."""
    stage, observed, mirrors, fitted = first()
    lobe = Lobe(np.array([0.5, 0.4, 0.3]), np.array([-1.0, -0.9, 1.0]), 20.0, np.array([1.0, 0.0, 0.0]))
    lobes = tuple((lobe,) if s == TABLE else () for s in range(stage.surfaces.num_surfaces))
    normal = stage.points.normal
    if has_detail:
        waves = 0.05 * np.sin(30 * stage.points.position[:, [1, 0, 2]]) * [1, 1, 0]
        normal = (normal + waves).astype(np.float32)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    fitted = replace(fitted, lobes=lobes, normal=normal)
    light = direct_irradiance(stage, observed, mirrors, fitted)
    shine = specular_layers(stage, observed, mirrors, fitted)
    assert shine is not None and observed.thrown is not None
    model = provisional_model(stage, observed, mirrors, fitted)
    view = build_view(stage.rays, model, stage.camera, ViewOptions(edge_samples=1, max_bounces=0))
    at = np.full(stage.camera.num_pixels, -1)
    at[view.points.pixel] = np.arange(len(view.points))
    some = np.flatnonzero((stage.surface == TABLE) & observed.is_interior)
    there = at[stage.points.pixel[some]]
    for photo, each in enumerate(observed.lights):
        shaded = shade_points(stage.rays, model, view, list(each), borders=False)
        # At grazing light the fits clamp the cosine that detail changes.
        clear = observed.is_safe[photo, some]
        for ours, theirs in (
            (fitted.albedo / np.float32(np.pi) * light[photo], shaded.direct),
            (shine[photo], shaded.specular),
        ):
            ours, theirs = ours[some][clear], theirs[there][clear] / observed.scale[photo]
            np.testing.assert_allclose(ours, theirs, rtol=1e-3, atol=1e-3 * theirs.max())
    by_mirror = observed.thrown[0].max(axis=2)[:, some] > 0
    assert shine[:, some][by_mirror].max() > 0.02


def test_a_highlight_by_way_of_a_mirror_is_no_albedo() -> None:
    """Before any lobe is known the diffuse fits leave it out; the rest of what a mirror throws they hear."""
    stage, observed, _, fitted = first()
    table = (stage.surface == TABLE) & observed.is_interior
    assert fitted.specular is None and observed.is_thrown_highlight is not None
    is_glare, is_reached = observed.is_thrown_highlight[:, table], observed.is_reached[:, table]
    is_free = observed.is_safe[:, table] & ~observed.is_highlight[:, table] & (observed.weight[:, table] > 0)
    weight = diffuse_weights(stage, observed, fitted)[:, table]
    assert is_glare.any() and not weight[is_glare].any()
    assert weight[is_reached & ~is_glare & is_free].min() > 0


@pytest.mark.parametrize("in_shadow", [False, True])
def test_lobes_and_detail_are_fitted_to_what_is_predicted(in_shadow: bool) -> None:
    """Photographs made of the fits' own prediction leave them nothing to explain, where the light itself is seen or not."""
    stage, observed, mirrors, fitted = first()
    if in_shadow:
        observed = replace(observed, form=np.zeros_like(observed.form), is_lit=np.zeros_like(observed.is_lit))
    fitted = replace(fitted, lobes=tuple((GLOSS,) if s == TABLE else () for s in range(stage.surfaces.num_surfaces)))
    light = direct_irradiance(stage, observed, mirrors, fitted) + fitted.irradiance
    matte, shine = fitted.albedo / np.float32(np.pi) * light, specular_layers(stage, observed, mirrors, fitted)
    observed = replace(observed, radiance=matte + shine)
    mine = np.flatnonzero((stage.surface == TABLE) & observed.is_interior)
    samples = _lobe_samples(stage, observed, mirrors, fitted, mine)
    assert len(samples.photo) > 100 and (in_shadow or samples.is_lit.all(axis=1).any())
    np.testing.assert_allclose(_model(samples, (GLOSS,)), samples.measured, rtol=1e-4, atol=1e-5)
    data = _detail_data(stage, observed, mirrors, fitted, TABLE, mine)
    one, photos = np.ones(len(mine), np.float32), np.arange(len(observed.lights))
    missed = misfit(replace(data, weight=np.ones_like(data.weight)), (GLOSS,), stage.white, data.normal, one, photos)
    assert missed < 1e-8

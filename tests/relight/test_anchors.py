"""Fewer points than are shown: what anchors stand for, and frames and shadows read off them."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.errors import InputError
from relight3d.forward import gather_pixels, irradiance_at_points, shade_points
from relight3d.lights import Light
from relight3d.records import RelightModel
from relight3d.relight import pixel_kernels
from relight3d.relight.anchors import Anchors, cell_shares, find_anchors, spread_values
from relight3d.relight.fill_engine import anchor_sites
from relight3d.relight.highlights import FAINT
from relight3d.relight.kernels import FULL
from relight3d.relight.options import PRESETS, RelightOptions
from relight3d.relight.relighter import Relighter
from relight3d.relight.work import work_of
from relight3d.shading import cast_light
from tests.relight import models
from tests.relight.test_engine import RELATIVE, worst_difference

LATTICE = RelightOptions(shadows="adaptive", lattice_px=4, borders=False)
FILL = RelightOptions(shading="adaptive", precision="float32")


def anchors_of(relighter: Relighter, spacing: int = 4, shared_rays: bool = False) -> Anchors:
    buffers = relighter._engine.buffers
    return find_anchors(relighter.view, buffers, spacing, pixel_kernels.CHUNK, shared_rays)


def large(model: RelightModel) -> Relighter:
    """A view with room for cells, of another camera, so that nothing is read from the captured pixels alone."""
    return Relighter(model, models.other_camera(model).resized(160, 120))


# ----------------------------------------------------------------------------------------------- anchors


@pytest.mark.parametrize("spacing", [2, 4])
def test_every_point_is_read_once(spacing: int) -> None:
    relighter = large(models.full())
    anchors = anchors_of(relighter, spacing)
    inside = (anchors.cell[:, None] + np.arange(16)).ravel()
    every = np.sort(np.concatenate([inside, anchors.loose]))
    np.testing.assert_array_equal(every, np.arange(len(relighter.view.points)))
    np.testing.assert_allclose(anchors.share.sum(axis=1), 1.0, rtol=1e-6)
    np.testing.assert_allclose(cell_shares().sum(axis=1), 1.0)
    assert (len(inside) > 0.4 * len(every)) == (spacing == 4)
    assert len(anchors.point) < 0.6 * len(every)


def test_no_reading_leaves_its_surface() -> None:
    relighter = large(models.full())
    anchors, order = anchors_of(relighter), relighter._engine.buffers.order
    label = (relighter.view.surface * 2 + relighter.view.is_mirrored)[order].astype(np.float32)[:, None]
    np.testing.assert_allclose(spread_values(anchors, label[anchors.point]), label, atol=1e-5)


def test_an_anchor_reads_itself() -> None:
    relighter = large(models.full())
    anchors = anchors_of(relighter)
    number = np.arange(len(anchors.point), dtype=np.float32)[:, None]
    np.testing.assert_allclose(spread_values(anchors, number)[anchors.point], number, rtol=1e-6)


def test_a_cell_reads_a_bilinear_patch() -> None:
    """The image's own coordinates, which the cells' corners hold, come back at every pixel of a cell."""
    relighter = large(models.plain())
    anchors, order = anchors_of(relighter), relighter._engine.buffers.order
    y, x = np.divmod(relighter.view.points.pixel[order], relighter.camera.width)
    place = np.stack([x, y, x * y], axis=1).astype(np.float32)
    inside = (anchors.cell[:, None] + np.arange(16)).ravel()
    np.testing.assert_allclose(spread_values(anchors, place[anchors.point])[inside], place[inside], rtol=1e-5)


# ----------------------------------------------------------------------------------------------- shading


def bright(model: RelightModel) -> RelightModel:
    """Indirect light that is nowhere clamped at 0: a clamp at anchors is another function than one at vertices."""
    assert model.indirect is not None
    return replace(model, indirect=replace(model.indirect, ambient=model.indirect.ambient + 40.0))


def filled_reference(relighter: Relighter, lights: list[Light]) -> np.ndarray:
    """The readable frame, its irradiance read off anchors."""
    model, view, order = relighter.model, relighter.view, relighter._engine.buffers.order
    anchors, centred = anchors_of(relighter), [light.translated(-model.mesh.center) for light in lights]
    at_anchors = irradiance_at_points(model, view, centred)[order[anchors.point]]
    irradiance = np.empty((len(order), 3), np.float32)
    irradiance[order] = spread_values(anchors, at_anchors)
    shaded = shade_points(relighter._scene, model, view, centred)
    shaded = shaded._replace(indirect=view.albedo / np.float32(np.pi) * irradiance)
    picture = np.maximum(sum(gather_pixels(model, view, centred, shaded)), 0.0)
    return picture.reshape(relighter.camera.height, relighter.camera.width, 3)


@pytest.mark.parametrize("captured", [True, False], ids=["captured", "elsewhere"])
def test_a_filled_frame_equals_its_reference(captured: bool) -> None:
    """Lights at infinity: a lamp's functions are evaluated where an anchor is, not where vertices are."""
    model = bright(models.full())
    camera = model.camera if captured else models.other_camera(model).resized(160, 120)
    relighter = Relighter(model, camera, replace(FILL, max_lobes=0))
    lights = [models.SUN, models.RED]
    got, wanted = relighter.render(lights).radiance, filled_reference(relighter, lights)
    assert worst_difference(got, wanted, 1 / model.exposure) < RELATIVE
    plain = relighter.with_options(RelightOptions(max_lobes=0)).render(lights).radiance
    assert worst_difference(plain, wanted, 1 / model.exposure) > 10 * RELATIVE  # it does read anchors


def test_light_kept_at_anchors_is_what_they_read() -> None:
    """Where a mesh is finer than the lattice, anchors keep indirect light themselves; else they read its sites."""
    model, lights = bright(models.full()), [models.SUN, models.RED]
    reads, keeps = (
        large(model).with_options(FILL)._engine,
        large(models.full("sh2", "pixel")).with_options(FILL)._engine,
    )
    assert reads._blend is not None
    assert keeps._blend is None and len(keeps.sites.positions) < 160 * 120 / 4
    centred = [light.translated(-model.mesh.center) for light in lights]
    read = reads.render(centred).radiance
    anchors = find_anchors(reads.view, reads.buffers, 4, pixel_kernels.CHUNK)
    reads.sites, reads._blend = anchor_sites(anchors, reads.sites, reads.buffers), None
    assert worst_difference(reads.render(centred).radiance, read, 1 / model.exposure) < RELATIVE


@pytest.mark.parametrize("name", ["directional", "point", "spot", "several"])
def test_only_faint_highlights_are_left_out(name: str) -> None:
    model, lights = bright(models.full()), models.LIGHTS[name]
    with_lobes, without = (Relighter(model, options=replace(FILL, max_lobes=k)).render(lights) for k in (8, 0))
    wanted, none = (Relighter(model, options=RelightOptions(max_lobes=k)).render(lights) for k in (8, 0))
    off = (with_lobes.radiance - without.radiance) - (wanted.radiance - none.radiance)
    num = 2 * len(lights) * max(len(lobes) for lobes in model.lobes)  # thrown light too
    assert np.abs(off).max() * model.exposure < num * FAINT + 1e-3
    assert (wanted.radiance - none.radiance).max() * model.exposure > 0.02


def test_what_a_model_lacks_is_not_read_off_anchors() -> None:
    model = replace(models.plain(), indirect=None)
    got, wanted = (Relighter(model, options=o).render([models.SUN]).radiance for o in (FILL, RelightOptions()))
    np.testing.assert_allclose(got, wanted, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("precision", ["int8", "int16"])
def test_a_residual_is_rounded_by_its_steps(precision: str) -> None:
    model = models.full()
    got, wanted = (
        Relighter(model, options=RelightOptions(precision=p)).render([models.SUN]) for p in (precision, "float32")
    )
    off = np.abs(got.radiance - wanted.radiance).max() * model.exposure
    assert off < (0.05 if precision == "int8" else 1e-4)
    assert precision == "int16" or off > 1e-4  # it is coarser


# ----------------------------------------------------------------------------------------------- shadows


def lattice_reference(relighter: Relighter, anchors: Anchors, light: Light) -> np.ndarray:
    """Whether each point is lit, states traced everywhere and read where the lattice reads them."""
    model, view, order = relighter.model, relighter.view, relighter._engine.buffers.order
    centred = light.translated(-model.mesh.center)
    traced = cast_light(relighter._scene, view.points, centred, view.normal, (), model.surfaces.surface_of_face).is_lit
    traced = np.asarray(traced)[order]
    out = traced.copy()
    for first, corners in zip(anchors.cell, anchors.point[anchors.cell_corner]):
        if len(set(traced[corners])) == 1:
            out[first : first + 16] = traced[corners[0]]
    for point, witness, is_sure, lead in zip(anchors.loose, anchors.witness, anchors.is_sure, anchors.lead):
        settled = is_sure and len(set(traced[witness])) == 1
        out[point] = traced[witness[0]] if settled else traced[lead]
    return out


@pytest.mark.parametrize("light", [models.SUN, models.LAMP, models.SPOT], ids=["sun", "lamp", "spot"])
@pytest.mark.parametrize("spacing", [2, 4])
@pytest.mark.parametrize("shared_rays", [False, True], ids=["own rays", "shared rays"])
def test_shadows_on_a_lattice_equal_the_reference(light: Light, spacing: int, shared_rays: bool) -> None:
    model = models.full()
    options = replace(LATTICE, lattice_px=spacing, shared_rays=shared_rays)
    relighter = large(model).with_options(options)
    shadows = relighter._engine.shadows
    shadows.start_frame(1)
    got = shadows.seen(light.translated(-model.mesh.center)) == FULL
    wanted = lattice_reference(relighter, anchors_of(relighter, spacing, shared_rays), light)
    np.testing.assert_array_equal(got, wanted)
    assert 0.05 < wanted.mean() < 0.95


def test_a_coarser_lattice_and_shared_rays_save_rays() -> None:
    model = models.full()
    settings = [RelightOptions(), RelightOptions(shadows="adaptive"), LATTICE, replace(LATTICE, shared_rays=True)]
    rays = [large(model).with_options(o).render([models.SUN]).stats.rays["shadow"] for o in settings]
    assert rays[0] > rays[1] > rays[2] > rays[3] > 0
    assert rays[3] < 0.5 * rays[0]


# ----------------------------------------------------------------------------------------------- frames


@pytest.mark.parametrize("preset", ["fast", "balanced"])
def test_a_preset_is_close_to_the_exact_frame(preset: str) -> None:
    model = replace(models.full(), indirect=None, residual=None)  # noise at every vertex and pixel, as no scene has
    ours, exact = (large(model).with_options(PRESETS[p]).render(models.LIGHTS["several"]) for p in (preset, "exact"))
    off = np.clip(ours.radiance * model.exposure, 0, 1) - np.clip(exact.radiance * model.exposure, 0, 1)
    assert -10 * np.log10(np.mean(off[exact.is_hit] ** 2)) > 30.0
    assert ours.stats.rays["shadow"] < 0.6 * exact.stats.rays["shadow"]


@pytest.mark.parametrize("threads", ["1", "3"])
def test_presets_do_not_hang_on_threads(threads: str, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = large(models.full()).with_options(PRESETS["fast"]).render(models.LIGHTS["several"]).radiance
    monkeypatch.setenv("RELIGHT3D_THREADS", threads)
    monkeypatch.setattr("relight3d.relight.tiles.MIN_TILE", 64)
    got = large(models.full()).with_options(PRESETS["fast"]).render(models.LIGHTS["several"]).radiance
    np.testing.assert_array_equal(got, wanted)


def test_a_new_colour_casts_no_ray_on_a_lattice() -> None:
    relighter = Relighter(models.full(), preset="fast")
    relighter.render(models.LIGHTS["several"])
    assert relighter.render([light.scaled(0.5) for light in models.LIGHTS["several"]]).stats.num_rays == 0


def test_the_work_of_a_preset_is_counted() -> None:
    relighter = large(models.full())
    works = {}
    for name, options in PRESETS.items():
        other = relighter.with_options(options)
        works[name] = work_of(other, [other.render([models.SUN]).stats])
    assert works["baked"]["shadow rays"] == 0
    for kind in ("shadow rays", "modes"):
        assert works["fast"][kind] <= works["balanced"][kind] < works["exact"][kind], kind
    assert works["fast"]["site functions"] <= works["exact"]["site functions"]
    assert works["fast"]["readings"] < 0.8 * works["exact"]["readings"]


@pytest.mark.parametrize("field", ["shading", "precision", "shared_rays", "lattice_px"])
def test_bad_settings_are_refused(field: str) -> None:
    options = RelightOptions()
    object.__setattr__(options, field, 7)  # past the tests' own check of types
    with pytest.raises(InputError, match=f"{field}.*one of") as error:
        options.__post_init__()
    assert "\n" not in str(error.value)

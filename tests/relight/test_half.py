"""Light at half resolution: what its lattice reads, and frames against the readable reference."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.camera import Camera, look_at
from relight3d.lights import Light
from relight3d.records import RelightModel
from relight3d.relight import half_engine
from relight3d.relight.half_lattice import SPACING
from relight3d.relight.options import PRESETS, RelightOptions
from relight3d.relight.relighter import Relighter
from relight3d.relight.work import work_of
from tests.relight import models
from tests.relight.half_reference import HalfReference
from tests.relight.test_engine import RELATIVE, worst_difference

HALF = RelightOptions(shading="half", precision="float32")


def half(model: RelightModel, captured: bool = True, size: tuple[int, int] = (161, 120), **changes) -> Relighter:
    camera = model.camera if captured else models.other_camera(model).resized(*size)
    return Relighter(model, camera, replace(HALF, **changes))


def bright(model: RelightModel) -> RelightModel:
    """Indirect light that is nowhere clamped at 0."""
    assert model.indirect is not None
    return replace(model, indirect=replace(model.indirect, ambient=model.indirect.ambient + 40.0))


# ----------------------------------------------------------------------------------------------- lattice


@pytest.mark.parametrize("size", [(161, 120), (160, 121), (3, 50)], ids=str)
def test_every_point_is_in_one_item_of_its_pixel_and_surface(size: tuple[int, int]) -> None:
    relighter = half(models.full(), False, size)
    lattice, view, order = relighter._engine.lattice, relighter.view, relighter._engine.buffers.order
    kind = view.points.pixel[order] * 100 + (view.surface * 2 + view.is_mirrored)[order]
    first = np.full(lattice.num_items, -1)
    first[lattice.item] = kind
    np.testing.assert_array_equal(first[lattice.item], kind)
    np.testing.assert_array_equal(np.diff(lattice.row_start) % half_engine.LANES, 0)


def test_no_reading_leaves_its_surface() -> None:
    relighter = half(models.full(), False)
    reference = HalfReference(relighter)
    label = relighter.view.surface * 2.0 + relighter.view.is_mirrored
    read = reference.read(np.where(reference.is_there, label[reference.at], 1e6))
    np.testing.assert_allclose(read[reference.lattice.item], label[reference.order], atol=1e-5)
    np.testing.assert_allclose(reference.share[reference.lattice.item].sum(axis=1), 1.0, rtol=1e-5)


def test_whole_pixels_read_a_bilinear_patch() -> None:
    """The image's own coordinates come back at every item that is not loose."""
    relighter = half(models.plain(), False)
    reference, width = HalfReference(relighter), relighter.camera.width
    lattice = reference.lattice
    place = np.stack(np.divmod(relighter.view.points.pixel, width)[::-1], axis=1).astype(float)
    is_loose = np.isin(lattice.item, lattice.place_of_loose())
    inner = ~is_loose & (place[reference.order] < np.array((width - 1, relighter.camera.height - 1))).all(axis=1)
    read = reference.read(place[reference.at])[lattice.item[inner]]
    np.testing.assert_allclose(read, place[reference.order][inner], atol=1e-4)
    assert inner.mean() > 0.5


def test_light_is_evaluated_at_few_points() -> None:
    relighter = half(models.full(), False)
    assert len(relighter._engine.lattice.point) < 0.6 * len(relighter.view.points)
    work = work_of(relighter, [relighter.render([models.SUN]).stats])
    exact = relighter.with_options(RelightOptions())
    assert work["points"] == len(relighter._engine.lattice.point)
    assert work["shadow rays"] < 0.5 * work_of(exact, [exact.render([models.SUN]).stats])["shadow rays"]


# ----------------------------------------------------------------------------------------------- frames


@pytest.fixture
def no_threshold(monkeypatch: pytest.MonkeyPatch) -> None:
    """Faint highlights stay, as in the reference."""
    monkeypatch.setattr(half_engine, "FAINT", 0.0)


@pytest.mark.usefixtures("no_threshold")
@pytest.mark.parametrize("captured", [True, False], ids=["captured", "elsewhere"])
@pytest.mark.parametrize("lights", models.LIGHTS.values(), ids=models.LIGHTS)
def test_a_frame_equals_its_reference(lights: list[Light], captured: bool) -> None:
    """Detail, an anisotropic lobe, a mirror that throws light, indirect light, a residual; outlines cut."""
    model = bright(models.full())
    relighter = half(model, captured)
    got, wanted = relighter.render(lights).radiance, HalfReference(relighter).render(lights)
    assert worst_difference(got, wanted, 1 / model.exposure) < RELATIVE
    if lights:
        exact = relighter.with_options(RelightOptions()).render(lights).radiance
        assert worst_difference(exact, wanted, 1 / model.exposure) > 10 * RELATIVE  # it does read slots


@pytest.mark.usefixtures("no_threshold")
@pytest.mark.parametrize(
    "changes",
    [
        {"borders": False},
        {"shadows": "off"},
        {"edge_samples": 1},
        {"residual": False},
        {"max_lobes": 0},
        {"indirect": False},
    ],
    ids=str,
)
def test_options_change_it_alike(changes: dict) -> None:
    model = bright(models.full())
    relighter = half(model, False, **changes)
    lights: list[Light] = [models.SUN, models.LAMP]
    got, wanted = relighter.render(lights).radiance, HalfReference(relighter).render(lights)
    assert worst_difference(got, wanted, 1 / model.exposure) < RELATIVE


@pytest.mark.parametrize(("precision", "at_most"), [("int16", 0.01), ("int8", 0.15)])
def test_steps_of_planes_are_small(precision: str, at_most: float) -> None:
    """The residual of this model is noise, which eight bits hold least well."""
    model = models.full()
    fine, coarse = (half(model, precision=p).render([models.SUN]).radiance for p in ("float32", precision))
    assert 0 < worst_difference(coarse, fine, 1 / model.exposure) < at_most


def test_it_is_near_the_exact_frame() -> None:
    model = models.full()
    relighter = half(model, False)
    ours, exact = (r.render([models.SUN]).radiance for r in (relighter, relighter.with_options(RelightOptions())))
    assert np.median(np.abs(ours - exact)) * model.exposure < 0.01


def test_another_colour_casts_no_ray() -> None:
    relighter = half(models.full())
    first = relighter.render([models.SUN, models.LAMP])
    again = relighter.render([light.scaled((0.5, 2.0, 1.0)) for light in (models.SUN, models.LAMP)])
    assert first.stats.num_rays > 0 and again.stats.num_rays == 0
    fresh = half(models.full()).render([light.scaled((0.5, 2.0, 1.0)) for light in (models.SUN, models.LAMP)])
    np.testing.assert_array_equal(again.radiance, fresh.radiance)


@pytest.mark.parametrize("lights", [[models.SUN], [models.LAMP, models.RED]], ids=["far", "near"])
def test_single_rays_give_the_same(monkeypatch: pytest.MonkeyPatch, lights: list[Light]) -> None:
    """Without Embree's packets, as where its library is not found."""
    from relight3d.relight import relighter as module

    model = models.full()
    packets = half(model).render(lights)
    monkeypatch.setenv("RELIGHT3D_SINGLE_RAYS", "1")
    monkeypatch.setattr(module, "_scenes", {})
    single = half(model).render(lights)
    assert single.stats.rays == packets.stats.rays
    assert worst_difference(single.radiance, packets.radiance, 1 / model.exposure) < RELATIVE


@pytest.mark.parametrize("shadows", ["exact", "table"])
def test_a_view_of_nothing_is_black(shadows: str) -> None:
    model = models.plain()
    up = look_at(model.mesh.center + [0.0, 0.0, 5.0], model.mesh.center + [0.0, 0.1, 9.0])
    relighter = Relighter(model, Camera.from_transform(up, model.camera), replace(HALF, shadows=shadows))
    frame = relighter.render([models.SUN, models.LAMP])
    assert not frame.is_hit.any() and not frame.radiance.any()
    assert relighter.bake_shadows() == 1.0


def test_the_fast_preset_is_half_resolution() -> None:
    assert PRESETS["fast"].shading == "half" and SPACING == 2
    assert PRESETS["baked"] == replace(PRESETS["fast"], shadows="table", table_directions=256)  # tests/conftest.py

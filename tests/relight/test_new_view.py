"""A view from compiled loops against views.build_view, and what it must not do."""

import gc
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from relight3d.relight.captured import captured_of
from relight3d.relight.engine import Engine
from relight3d.relight.fast_view import build_fast_view
from relight3d.relight.options import RelightOptions
from relight3d.relight.relighter import Relighter
from relight3d.relight.view_arrays import CELL_SURFACE, NUM_CELL_COLUMNS
from relight3d.shading import ray_scene
from relight3d.views import View, ViewOptions, build_view
from tests.relight import models

OF_POINTS = ("surface", "albedo", "normal", "lobe_gain", "throughput", "is_mirrored", "share", "step")
OF_HITS = ("pixel", "face", "barycentric", "position", "geometric_normal", "normal", "to_viewer", "depth")


def in_order(view: View) -> np.ndarray:
    """Points by pixel, and those of one pixel by the way they are seen."""
    x, y, z = view.points.to_viewer.T
    return np.lexsort((x + 0.5 * y + 0.25 * z, view.points.pixel))


@pytest.mark.parametrize("options", [ViewOptions(), ViewOptions(1, 2), ViewOptions(9, 0), ViewOptions(4, 1)], ids=str)
@pytest.mark.parametrize("size", [(64, 48), (61, 47)], ids=str)
@pytest.mark.parametrize("beside", ["object", "black"])
def test_all_it_tells_is_the_reference(options: ViewOptions, size: tuple[int, int], beside: str) -> None:
    model = replace(models.full(), outlines_end=beside)
    camera, scene = models.other_camera(model).resized(*size), ray_scene(model.mesh)
    got, wanted = build_fast_view(scene, model, camera, options), build_view(scene, model, camera, options)
    ours, theirs = in_order(got), in_order(wanted)
    assert len(ours) == len(theirs)
    # The reference does not count the mirrors that it followed in pixels that it then cut.
    assert got.num_rays == wanted.num_rays if options.edge_samples == 1 else got.num_rays >= wanted.num_rays
    assert wanted.is_mirrored.any() == (options.max_bounces > 0)
    # float32 and another order of sums: 1e-5 was measured, of values about 1; a mistake is off by far more.
    for name in OF_HITS:
        # A grazed face is met elsewhere for a ray's last digit: there 1e-4 of its corners was measured.
        room = 5e-4 if name == "barycentric" else 1e-5
        values = getattr(got.points, name)[ours], getattr(wanted.points, name)[theirs]
        np.testing.assert_allclose(*values, rtol=1e-4, atol=room, err_msg=name)
    for name in OF_POINTS:
        values = getattr(got, name)[ours], getattr(wanted, name)[theirs]
        np.testing.assert_allclose(*values, rtol=1e-4, atol=2e-5, err_msg=name)
    used = wanted.share[theirs] > 1e-6
    np.testing.assert_array_equal(got.source[ours][used], wanted.source[theirs][used])
    # A neighbour is a place in the list, which has another order: compared by what stands there.
    place, its_place = np.append(np.argsort(ours), -1), np.append(np.argsort(theirs), -1)
    np.testing.assert_array_equal(place[got.neighbour[ours]], its_place[wanted.neighbour[theirs]])
    np.testing.assert_array_equal(got.is_hit, wanted.is_hit)
    by_pixel = [np.lexsort((each.miss_throughput, each.miss_pixel)) for each in (got, wanted)]
    np.testing.assert_array_equal(got.miss_pixel[by_pixel[0]], wanted.miss_pixel[by_pixel[1]])
    np.testing.assert_allclose(got.miss_throughput[by_pixel[0]], wanted.miss_throughput[by_pixel[1]])


def test_frames_ask_for_nothing_that_is_made_on_demand() -> None:
    model = models.full()
    relighter = Relighter(model, models.other_camera(model))
    relighter.render(models.LIGHTS["several"])
    assert not {"points", "albedo", "throughput", "source", "step"} & set(vars(relighter.view))


def test_buffers_are_what_was_written() -> None:
    model = models.full()
    relighter = Relighter(model, models.other_camera(model))
    buffers, packed = relighter._engine.buffers, relighter.view.packed
    for ours, written in ((buffers.position, packed.position), (buffers.modes.source, packed.source)):
        assert ours is written


def test_what_is_made_on_demand_leaves_frames_as_they_are() -> None:
    model = models.full()
    relighter = Relighter(model, models.other_camera(model))
    before = relighter.render([models.SUN]).radiance
    assert relighter.view.take(np.arange(5)).points.pixel.shape == (5,)
    np.testing.assert_array_equal(relighter.render([models.SUN]).radiance, before)


def test_what_a_view_was_not_made_for_is_packed_from_it() -> None:
    """Options may switch on what the view's own model had off."""
    model = models.full()
    camera = models.other_camera(model)
    plain = Relighter(model, camera, RelightOptions(residual=False, indirect=False))
    got = plain.with_options(RelightOptions()).render([models.SUN]).radiance
    wanted = Relighter(model, camera).render([models.SUN]).radiance
    np.testing.assert_allclose(got, wanted, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("turn_rad", [0.15, 0.9])
def test_what_four_captured_pixels_have_in_common_only_saves_work(
    turn_rad: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From farther around, a surface shows places that another part of it hid from the capture."""
    model = models.full()
    camera, scene = models.other_camera(model, turn_rad), ray_scene(model.mesh)
    cells = captured_of(model).cell.reshape(-1, NUM_CELL_COLUMNS)
    assert (cells[:, CELL_SURFACE] >= 0).mean() > 0.2  # else nothing is saved
    wanted = build_fast_view(scene, model, camera, ViewOptions()).packed
    none = np.full_like(cells, -1.0).reshape(-1)
    monkeypatch.setattr("relight3d.relight.fast_view.captured_of", lambda m: captured_of(m)._replace(cell=none))
    got = build_fast_view(scene, model, camera, ViewOptions()).packed
    for name in ("normal", "diffuse", "gloss", "source_share"):
        np.testing.assert_allclose(getattr(got, name), getattr(wanted, name), atol=2e-6, err_msg=name)


@pytest.mark.parametrize("shading", ["exact", "adaptive"])
def test_the_residual_of_captured_pixels_is_made_where_points_read_it(
    shading: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What nobody made is NaN here: a frame that read any of it would show it."""
    model, made = models.full(), []
    as_it_is = Engine._residual

    def of_nothing(engine: Engine, weights: tuple) -> tuple:
        given = as_it_is(engine, weights)
        given[2][:] = np.nan
        made.append(given[3])
        return given

    def frame(turn_rad: float) -> np.ndarray:
        relighter = Relighter(model, models.other_camera(model, turn_rad), RelightOptions(shading=shading))
        return relighter.render(models.LIGHTS["several"]).radiance

    wanted = [frame(turn_rad) for turn_rad in (0.15, 0.45, 0.9)]
    monkeypatch.setattr(Engine, "_residual", of_nothing)
    for turn_rad, without in zip((0.15, 0.45, 0.9), wanted, strict=True):
        np.testing.assert_array_equal(frame(turn_rad), without)
    near, aside, far = (float(blocks.mean()) for blocks in made)
    assert 1 > near > aside > far == 0.0  # 30 degrees around nothing of it holds


@pytest.mark.parametrize("threads", ["1", "3"])
def test_any_tiles_give_the_same_view(threads: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model = models.full()
    camera = models.other_camera(model)
    wanted = Relighter(model, camera).render(models.LIGHTS["several"]).radiance
    monkeypatch.setenv("RELIGHT3D_THREADS", threads)
    monkeypatch.setattr("relight3d.relight.tiles.MIN_TILE", 64)
    got = Relighter(model, camera).render(models.LIGHTS["several"]).radiance
    np.testing.assert_array_equal(got, wanted)


def test_no_mirror_no_room_for_what_mirrors_turn() -> None:
    model = models.plain()
    view = Relighter(model, models.other_camera(model)).view
    assert len(model.mirrors) == 0 and len(view.looked.rays.turned) == 0


def test_a_moving_camera_holds_no_more_memory() -> None:
    model = models.full()
    model = replace(model, mesh=replace(model.mesh))
    relighter = Relighter(model, models.other_camera(model))
    held = []
    tracemalloc.start()
    for k in range(12):
        relighter.set_camera(models.other_camera(model, 0.01 * (k % 3 + 1)))
        relighter.render([models.SUN])
        gc.collect()
        held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    view = sum(part.nbytes for part in relighter.view.packed)
    assert held[-1] < held[5] + view  # views that are not let go would be six

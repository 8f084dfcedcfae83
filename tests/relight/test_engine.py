"""The compiled frame against the readable reference, and the rays that a frame may cast."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.errors import InputError
from relight3d.lights import DirectionalLight, PointLight, RectangleLight, SphereLight
from relight3d.relight.options import PRESETS, RelightOptions
from relight3d.relight.relighter import Relighter
from tests.relight import models

# float32 sums in another order: 1e-5 of a value's own size was measured; an error of one part in a thousand fails.
RELATIVE = 1e-4
NUMPY = RelightOptions(backend="numpy")


def worst_difference(got: np.ndarray, wanted: np.ndarray, white: float) -> float:
    """The largest difference relative to the wanted value, or to a twentieth of white where it is darker."""
    return float((np.abs(got - wanted) / np.maximum(np.abs(wanted), white / 20)).max())


def assert_equal_frames(model, lights, camera=None, **changes) -> None:
    ours = Relighter(model, camera, RelightOptions(backend="numba", **changes)).render(lights)
    reference = Relighter(model, camera, RelightOptions(backend="numpy", **changes)).render(lights)
    assert worst_difference(ours.radiance, reference.radiance, 1 / model.exposure) < RELATIVE
    for effect, num in reference.stats.rays.items():
        assert ours.stats.rays[effect] == num, effect


@pytest.mark.parametrize("name", models.LIGHTS)
@pytest.mark.parametrize("captured", [True, False], ids=["captured", "elsewhere"])
def test_equals_reference(name: str, captured: bool) -> None:
    model = models.full()
    assert_equal_frames(model, models.LIGHTS[name], None if captured else models.other_camera(model))


def test_elsewhere_through_a_lens() -> None:
    model = models.full()
    camera = replace(models.other_camera(model), k1=0.08, k2=-0.02, p1=0.004, p2=-0.003)
    assert_equal_frames(model, [models.SUN], camera)


@pytest.mark.parametrize("size", [(61, 47), (3, 50), (130, 97)], ids=str)
def test_elsewhere_in_pictures_of_any_size(size: tuple[int, int]) -> None:
    """Blocks of 4 x 4 stick out of them."""
    model = models.full()
    assert_equal_frames(model, [models.SUN], models.other_camera(model).resized(*size))


@pytest.mark.parametrize("captured", [True, False], ids=["captured", "elsewhere"])
def test_single_rays_show_what_packets_show(captured: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where Embree's own library cannot be had; a ray scene is kept by mesh, so the mesh is another."""
    model = models.full()
    camera = None if captured else models.other_camera(model)
    wanted = Relighter(model, camera).render(models.LIGHTS["several"])
    monkeypatch.setenv("RELIGHT3D_SINGLE_RAYS", "1")
    single = Relighter(replace(model, mesh=replace(model.mesh)), camera)
    assert single._scene.packets is None
    got = single.render(models.LIGHTS["several"])
    assert worst_difference(got.radiance, wanted.radiance, 1 / model.exposure) < RELATIVE
    assert got.stats.rays == wanted.stats.rays


@pytest.mark.parametrize("basis", ["constant", "linear", "angles2", "cosines2", "sh3", "hsh2", "hsh3"])
def test_every_basis(basis: str) -> None:
    assert_equal_frames(models.full(basis), models.LIGHTS["several"])


@pytest.mark.parametrize("site", ["face", "pixel"])
@pytest.mark.parametrize("captured", [True, False], ids=["captured", "elsewhere"])
def test_every_site(site: str, captured: bool) -> None:
    model = models.full("linear", site)
    assert_equal_frames(model, models.LIGHTS["several"], None if captured else models.other_camera(model))


@pytest.mark.parametrize(
    "changes",
    [
        {"shadows": "off"},
        {"borders": False},
        {"edge_samples": 1},
        {"edge_samples": 16},
        {"max_bounces": 0},
        {"max_bounces": 1},
        {"thrown": False},
        {"indirect": False},
        {"max_lobes": 0},
        {"detail": False},
        {"residual": False},
        {"max_modes": 2},
    ],
    ids=str,
)
def test_every_option(changes: dict) -> None:
    assert_equal_frames(models.full(), models.LIGHTS["several"], **changes)


@pytest.mark.parametrize("state", ["lit", "dark"])
@pytest.mark.parametrize("precision", ["float32", "int16"])
def test_a_residual_of_one_state_only(state: str, precision: str) -> None:
    """A state that gained nothing has no modes."""
    model = models.full()
    assert model.residual is not None
    modes, weights = getattr(model.residual, f"{state}_modes"), getattr(model.residual, f"{state}_weights")
    none = {f"{state}_modes": modes[:, :0], f"{state}_weights": weights[:0]}
    model = replace(model, residual=replace(model.residual, **none))
    assert_equal_frames(model, models.LIGHTS["several"], precision=precision)


def test_a_wrong_frame_is_told_apart() -> None:
    model = models.full()
    frame = Relighter(model).render([models.SUN]).radiance
    assert worst_difference(frame * 1.001, frame, 1 / model.exposure) > RELATIVE


def test_terms_add_up() -> None:
    frame = Relighter(models.full()).render(models.LIGHTS["several"])
    terms = frame.terms
    parts = [terms.direct, terms.specular, terms.indirect, terms.mirror]
    assert all(part is not None for part in parts)
    np.testing.assert_allclose(np.maximum(sum(parts), 0.0), frame.radiance, rtol=1e-3, atol=1e-5)


def test_absent_terms_are_none() -> None:
    model = replace(models.plain(), indirect=None)
    terms = Relighter(model).render([models.SUN]).terms
    assert terms.direct is not None
    assert terms.specular is None and terms.indirect is None and terms.mirror is None


# ----------------------------------------------------------------------------------------------- rays


def test_only_pixels_that_face_the_light_cast_a_ray() -> None:
    relighter = Relighter(models.plain(), options=RelightOptions(borders=False))
    light = np.asarray(models.SUN.to_light)
    points, normal = relighter.view.points, relighter.view.normal
    facing = (points.geometric_normal @ light > 0) & (normal @ light > 0)
    assert relighter.render([models.SUN]).stats.rays["shadow"] == facing.sum()


@pytest.mark.parametrize("light", [DirectionalLight((0.1, 0.1, -1.0), 3.0), DirectionalLight((0.5, 0.3, -0.6), 3.0)])
def test_a_light_below_the_horizon_casts_no_ray(light: DirectionalLight) -> None:
    assert Relighter(models.full()).render([light]).stats.num_rays == 0


def test_a_light_without_power_casts_no_ray() -> None:
    assert Relighter(models.full()).render([DirectionalLight((0, 0, 1), 0.0)]).stats.num_rays == 0


def test_outside_the_cone_no_ray() -> None:
    away = models.SPOT.moved(direction=(0.0, 0.0, 1.0))
    assert Relighter(models.full()).render([away]).stats.num_rays == 0


def test_a_new_colour_casts_no_ray() -> None:
    relighter = Relighter(models.full())
    relighter.render(models.LIGHTS["several"])
    again = relighter.render([light.scaled((0.5, 2.0, 1.0)) for light in models.LIGHTS["several"]])
    assert again.stats.num_rays == 0
    fresh = Relighter(models.full()).render([light.scaled((0.5, 2.0, 1.0)) for light in models.LIGHTS["several"]])
    np.testing.assert_array_equal(again.radiance, fresh.radiance)


def test_a_light_that_stands_still_casts_no_ray() -> None:
    relighter = Relighter(models.full())
    alone = relighter.render([models.RED]).stats.num_rays
    relighter.render([models.SUN])
    assert relighter.render([models.SUN, models.RED]).stats.num_rays == 0
    assert alone > 0


def test_many_lights_of_one_frame_are_all_kept() -> None:
    relighter = Relighter(models.plain(), options=RelightOptions(keep_lights=1))
    lights = [DirectionalLight((0.1 * k, 0.2, 1.0), 1.0) for k in range(12)]
    relighter.render(lights)
    assert relighter.render(lights).stats.num_rays == 0


def test_an_absent_effect_takes_no_ray_and_no_array() -> None:
    relighter = Relighter(models.plain())
    frame = relighter.render([models.SUN])
    assert frame.stats.rays["thrown"] == 0
    assert relighter._engine.buffers.modes is None
    assert len(relighter._engine.buffers.lobes) == 0


# ----------------------------------------------------------------------------------------------- soft light


def test_a_panel_thrown_by_a_mirror_equals_the_reference() -> None:
    """The virtual panel faces the other way: with the real one's normal nothing would be thrown."""
    model = models.full()
    mirror = next(mirror for mirror in model.mirrors if mirror.throws_light)
    place = mirror.point + model.mesh.center + 0.8 * mirror.normal + np.array([0.0, 0.0, 0.5])
    across = np.cross(mirror.normal, [0.0, 0.0, 1.0])  # across x up points at the mirror
    panel = RectangleLight(tuple(place), 3.0, tuple(0.2 * across), (0.0, 0.0, 0.2))
    lights = panel.samples(4)
    assert Relighter(model).render(lights).stats.rays["thrown"] > 0
    assert_equal_frames(model, lights)
    dark = replace(model, mirrors=tuple(replace(each, throws_light=False) for each in model.mirrors))
    gain = Relighter(model).render(lights).radiance - Relighter(dark).render(lights).radiance
    assert gain.max() > 0.01 / model.exposure


def test_lobes_shine_in_the_light_that_a_mirror_throws() -> None:
    """A black table with lobes: all that the mirror adds to it is their highlight."""
    model = replace(models.full(), indirect=None, residual=None)
    black = replace(model.pixels, albedo=np.zeros_like(model.pixels.albedo))
    model = replace(model, pixels=black, surface_albedo=np.zeros_like(model.surface_albedo))
    light = [DirectionalLight((0.0, -0.7, 0.5), (3.0, 3.0, 3.0))]
    assert_equal_frames(model, light)
    full, none = (
        Relighter(each).render(light).radiance.max(axis=2)
        for each in (model, replace(model, mirrors=tuple(replace(m, throws_light=False) for m in model.mirrors)))
    )
    assert (full - none).max() > 0.2 * none.max()


@pytest.mark.parametrize(
    "light",
    [SphereLight((0.4, -0.3, 1.2), 2.0, 0.2), RectangleLight((0.4, -0.3, 1.2), 2.0, (0.3, 0, 0), (0, -0.3, 0))],
    ids=["sphere", "rectangle"],
)
def test_an_extended_light_is_its_samples(light) -> None:
    relighter = Relighter(models.plain(), options=RelightOptions(light_samples=9))
    soft = relighter.render([light])
    assert soft.stats.rays["soft"] > 0 and soft.stats.rays["shadow"] == 0
    again = Relighter(models.plain()).render(light.samples(9))
    np.testing.assert_allclose(soft.radiance, again.radiance, rtol=1e-5, atol=1e-6)


def test_a_small_far_sphere_is_a_point() -> None:
    sphere, point = SphereLight((0.0, 0.0, 50.0), 2500.0, 1e-3), PointLight((0.0, 0.0, 50.0), 2500.0)
    relighter = Relighter(models.plain())
    np.testing.assert_allclose(
        relighter.render([sphere]).radiance, relighter.render([point]).radiance, rtol=1e-3, atol=1e-4
    )


def test_soft_costs_nothing_unless_asked_for() -> None:
    assert "soft" not in Relighter(models.plain()).render([models.LAMP]).stats.rays


# ----------------------------------------------------------------------------------------------- numbers


@pytest.mark.parametrize("threads", ["1", "3"])
def test_any_number_of_threads_gives_the_same_frame(threads: str, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = Relighter(models.full()).render(models.LIGHTS["several"]).radiance
    monkeypatch.setenv("RELIGHT3D_THREADS", threads)
    monkeypatch.setattr("relight3d.relight.tiles.MIN_TILE", 64)
    got = Relighter(models.full()).render(models.LIGHTS["several"]).radiance
    np.testing.assert_array_equal(got, wanted)


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (0.0, 0.0, 1e-12), (1e15, 0.0, 1e15), (0.45, -0.15, 0.6)])
@pytest.mark.parametrize("intensity", [1e-30, 1e20])
def test_nasty_lamps_give_finite_frames(place: tuple, intensity: float) -> None:
    assert np.isfinite(Relighter(models.full()).render([PointLight(place, intensity)]).radiance).all()


@pytest.mark.parametrize("exponent", [1e-3, 1.0, 77.0, 1e4])
def test_lobes_of_any_exponent(exponent: float) -> None:
    model = models.full()
    lobes = tuple(replace(lobe, exponent=exponent) for lobe in model.lobes[2])
    model = replace(model, lobes=(*model.lobes[:2], lobes, *model.lobes[3:]))
    ours = Relighter(model).render(models.LIGHTS["several"]).radiance
    wanted = Relighter(model, options=NUMPY).render(models.LIGHTS["several"]).radiance
    # A base's last digit (6e-8) is raised with it.
    assert worst_difference(ours, wanted, 1 / model.exposure) < max(RELATIVE, 3e-7 * exponent)


def test_whole_modes_are_packed_without_loss() -> None:
    model = models.full()
    exact = Relighter(model, options=RelightOptions(precision="float32")).render(models.LIGHTS["several"]).radiance
    packed = Relighter(model, options=RelightOptions(precision="int16")).render(models.LIGHTS["several"]).radiance
    np.testing.assert_allclose(packed, exact, atol=1e-6 / model.exposure)


def test_other_modes_are_off_by_what_nobody_sees() -> None:
    """As a file of an earlier version holds them."""
    model = models.full()
    assert model.residual is not None
    halves = {
        f"{state}_modes": getattr(model.residual, f"{state}_modes") + np.float32(0.3) for state in ("lit", "dark")
    }
    model = replace(model, residual=replace(model.residual, **halves))
    exact = Relighter(model, options=RelightOptions(precision="float32")).render(models.LIGHTS["several"]).radiance
    packed = Relighter(model, options=RelightOptions(precision="int16")).render(models.LIGHTS["several"]).radiance
    # 1e-6 of white for each of ten modes and four lights, some of them brighter than the capture's.
    assert 0 < np.abs(packed - exact).max() < 4e-5 / model.exposure


def test_strong_modes_get_a_second_row_and_empty_ones_none() -> None:
    model = models.full()
    assert model.residual is not None
    modes = model.residual.lit_modes // 32  # one byte holds them
    modes[:, 0], modes[:, 4] = 128, 0
    modes[::7, 0] = -129
    residual = replace(model.residual, lit_modes=modes)
    rows = Relighter(replace(model, residual=residual))._engine.buffers.modes.lit
    num_blocks = len(rows.start) - 1
    np.testing.assert_array_equal(np.bincount(rows.mode, minlength=5), np.array([2, 1, 1, 1, 0]) * num_blocks)
    assert set(rows.step) == {1, 256}


def test_an_empty_view() -> None:
    model = models.full()
    away = models.other_camera(model)
    pose = away.world_from_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ np.diag([-1.0, 1.0, -1.0])  # turn around
    camera = type(away).from_transform(pose, away)
    frame = Relighter(model, camera).render(models.LIGHTS["several"])
    assert not frame.is_hit.any() and not frame.radiance.any()


# ----------------------------------------------------------------------------------------------- approximations


def lit_difference(options: RelightOptions) -> tuple[float, int]:
    """The mean absolute error of direct light relative to its mean, and the rays cast."""
    model = models.plain()
    exact = Relighter(model, options=RelightOptions(borders=False)).render([models.SUN]).radiance
    frame = Relighter(model, options=options).render([models.SUN])
    return float(np.abs(frame.radiance - exact).mean() / exact.mean()), frame.stats.rays["shadow"]


def test_adaptive_shadows_save_rays_and_hardly_differ() -> None:
    _, all_rays = lit_difference(RelightOptions(borders=False))
    error, rays = lit_difference(RelightOptions(shadows="adaptive", borders=False))
    assert rays < 0.9 * all_rays  # at 64 x 48 much is outline; on the desk it is 0.4
    assert error < 0.01


def test_presets_render() -> None:
    for name in PRESETS:
        assert np.isfinite(Relighter(models.full(), preset=name).render(models.LIGHTS["several"]).radiance).all()


@pytest.mark.parametrize(
    "arguments",
    [{"options": NUMPY, "preset": "fast"}, {"preset": "best"}, {"budget_ms": -1.0}, {"budget_ms": float("nan")}],
    ids=str,
)
def test_bad_settings_are_refused(arguments: dict) -> None:
    with pytest.raises(InputError):
        Relighter(models.plain(), **arguments)


@pytest.mark.parametrize("arguments", [{"lattice_px": 3}, {"max_lobes": -1}, {"light_samples": 0}, {"edge_samples": 5}])
def test_bad_options_are_refused(arguments: dict) -> None:
    with pytest.raises(InputError):
        RelightOptions(**arguments)


def test_a_view_that_stays_gets_the_same_indirect_light() -> None:
    """From its second frame on the sites stand in planes."""
    relighter = Relighter(models.full())
    first, second = (relighter.render([models.SUN, models.RED]).radiance for _ in range(2))
    assert worst_difference(second, first, 1 / relighter.model.exposure) < RELATIVE
    fresh = Relighter(models.full()).render([models.LAMP, models.SUN]).radiance
    np.testing.assert_array_equal(relighter.render([models.LAMP, models.SUN]).radiance, fresh)

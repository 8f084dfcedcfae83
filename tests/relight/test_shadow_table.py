"""Shadows looked up by the light's direction, beside the same shadows cast."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.errors import InputError
from relight3d.lights import DirectionalLight, Light
from relight3d.records import RelightModel
from relight3d.relight.options import RelightOptions
from relight3d.relight.relighter import Relighter
from relight3d.relight.table_kernels import PER_PIXEL
from tests.relight import models

CAST = RelightOptions(shading="half", precision="float32")
TABLE = replace(CAST, shadows="table", table_directions=2304)
WAYS = [DirectionalLight((x, y, 0.8), 2.0) for x, y in ((0.31, -0.42), (-0.5, 0.2), (0.07, 0.6), (-0.3, -0.5))]


def relighters(model: RelightModel, **changes) -> tuple[Relighter, Relighter]:
    """At the captured viewpoint, with shadows cast and looked up."""
    cast = Relighter(model, model.camera.resized(241, 180), CAST)
    return cast, cast.with_options(replace(TABLE, **changes))


def tables(relighter: Relighter) -> dict:
    return relighter._engine.shadows._tables


def distances(relighter: Relighter, light: Light) -> np.ndarray:
    relighter.render([light])
    shadows = relighter._engine.shadows
    return shadows.distance(light.translated(-relighter.model.mesh.center))


def wrong(ours: np.ndarray, theirs: np.ndarray) -> float:
    """The mean difference of how much of a slot is lit."""
    lit, wanted = (np.clip(each + 0.5, 0, 1) for each in (ours, theirs))
    return float(np.abs(lit - wanted).mean())


def own_direction(relighter: Relighter) -> DirectionalLight:
    """One of those that the table casts."""
    table = tables(relighter)[-1]
    k = np.argmin(np.linalg.norm(table._ways - np.array([0.3, -0.4, 0.86]), axis=1))
    return DirectionalLight(tuple(table._ways[k]), 2.0)


def test_a_table_s_own_direction_is_what_was_cast() -> None:
    """But for a step of a byte; slots beside the grid only say lit or not."""
    cast, looked_up = relighters(models.full())
    light = own_direction(looked_up)
    ours, theirs = distances(looked_up, light), distances(cast, light)
    grid = cast._engine.lattice.num_grid
    way = np.asarray(light.to_light, np.float32)
    near = (np.abs(theirs[:grid]) < 1.9) & (way @ looked_up._engine.slots.geometric[:, :grid] > 0)
    np.testing.assert_allclose(ours[:grid][near], theirs[:grid][near], atol=0.51 / PER_PIXEL)
    is_clear = np.abs(theirs) > 0.1
    np.testing.assert_array_equal((ours > 0)[is_clear], (theirs > 0)[is_clear])


def test_between_directions_more_of_them_are_closer() -> None:
    errors = []
    for num in (256, 1024, 4096):
        cast, looked_up = relighters(models.plain(), table_directions=num)
        errors.append(np.mean([wrong(distances(looked_up, way), distances(cast, way)) for way in WAYS]))
    assert errors[2] < 0.6 * errors[1] < 0.36 * errors[0]
    assert errors[2] < 0.008


def test_edges_between_directions_stay_sharp() -> None:
    """Three shadows one over the other would have three faint edges: half-lit slots are as few as in cast shadows."""
    cast, looked_up = relighters(models.plain())
    for way in WAYS:
        ours, theirs = ((np.abs(distances(each, way)) < 0.4).mean() for each in (looked_up, cast))
        assert ours < 1.6 * theirs + 0.002


def test_baked_frames_cast_no_ray_and_do_not_know_what_came_before() -> None:
    _, looked_up = relighters(models.full())
    frames = [looked_up.render([way]) for way in WAYS]
    assert all(frame.stats.num_rays == 0 for frame in frames)
    again = relighters(models.full())[1]
    for way, frame in zip(reversed(WAYS), reversed(frames)):
        np.testing.assert_array_equal(frame.radiance, again.render([way]).radiance)


def test_with_little_room_high_lights_are_baked_of_all_tables(caplog: pytest.LogCaptureFixture) -> None:
    cast, looked_up = relighters(models.full(), table_mb=2)
    directions = looked_up._engine.shadows.directions
    assert "table_mb" in caplog.text and directions.is_full
    for via, table in tables(looked_up).items():
        known = [k for of, k in directions._entries if of == via]
        assert known and table.heights()[known].min() > 0.5
    assert 1.5e6 < directions.num_bytes <= 2e6
    assert directions.num_bytes <= looked_up._engine.num_bytes - looked_up._engine.buffers.num_bytes
    low, high = DirectionalLight((0.9, 0.1, 0.2), 2.0), DirectionalLight((0.05, -0.03, 1.0), 2.0)
    assert looked_up.render([high]).stats.num_rays == 0
    np.testing.assert_array_equal(looked_up.render([low]).radiance, cast.render([low]).radiance)


def test_another_view_is_cast_until_it_is_baked() -> None:
    model = models.full()
    _, looked_up = relighters(model)
    camera = models.other_camera(model)
    looked_up.set_camera(camera)
    ours, theirs = looked_up.render([WAYS[0]]), Relighter(model, camera, CAST).render([WAYS[0]])
    np.testing.assert_array_equal(ours.radiance, theirs.radiance)
    assert ours.stats.rays == theirs.stats.rays
    parts: list[float] = []
    assert looked_up.bake_shadows(parts.append) == 1.0
    assert parts[-1] == 1.0 and parts == sorted(parts)
    baked = looked_up.render([WAYS[0]])  # the answer that was cast is not kept
    assert baked.stats.num_rays == 0 and not np.array_equal(baked.radiance, ours.radiance)


def test_only_half_resolution_is_baked() -> None:
    relighter = Relighter(models.plain(), options=replace(CAST, table_directions=256))
    assert relighter.bake_shadows() == 1.0 and relighter.render([WAYS[0]]).stats.num_rays == 0
    directions = relighter._engine.shadows.directions
    assert relighter.bake_shadows() == 1.0 and relighter._engine.shadows.directions is directions  # once is enough
    unshadowed = relighter.with_options(replace(CAST, shadows="off"))
    wanted = unshadowed.render([WAYS[0]]).radiance
    assert unshadowed.bake_shadows() == 1.0
    np.testing.assert_array_equal(unshadowed.render([WAYS[0]]).radiance, wanted)
    for options in (RelightOptions(), RelightOptions(backend="numpy")):
        relighter = Relighter(models.plain(), options=options)
        assert relighter.bake_shadows() == 1.0 and relighter.render([WAYS[0]]).stats.num_rays > 0


@pytest.mark.parametrize("height_deg", [0.05, 0.2, 0.8, 2.0, 5.0])
def test_low_lights_are_no_darker(height_deg: float) -> None:
    """No light comes from along the ground itself: the table's directions there stand for what is just above."""
    cast, looked_up = relighters(models.full())
    azimuth, height = np.deg2rad([10.0, 80.0, 200.0, 305.0]), np.deg2rad(height_deg)
    lights = [
        DirectionalLight((np.cos(a) * np.cos(height), np.sin(a) * np.cos(height), np.sin(height)), 2.0) for a in azimuth
    ]
    theirs, ours = (np.stack([each.render([light]).radiance for light in lights]) for each in (cast, looked_up))
    assert np.abs(ours - theirs).mean() < 0.05 * theirs.mean()


def test_thrown_light_is_looked_up() -> None:
    """The patch that the mirror throws: near the cast one, and nowhere where the light is behind the mirror."""
    model = models.full()
    cast, looked_up = relighters(model)
    mirror = model.mirrors[0].normal
    light = DirectionalLight(tuple(mirror + np.array([0.2, 0.1, 0.6])), 2.0)
    pair = [each.render([light]).radiance for each in (cast, looked_up)]
    without = cast.with_options(replace(CAST, thrown=False)).render([light]).radiance  # nothing else differs
    thrown, lost = np.abs(without - pair[0]).mean(), np.abs(pair[1] - pair[0]).mean()
    assert thrown > 0 and lost < 0.25 * thrown
    behind = DirectionalLight(tuple(np.array([0.2, 0.1, 0.6]) - mirror), 2.0)
    assert looked_up.render([behind]).stats.rays["thrown"] == 0


def test_lamps_and_lights_from_below_are_cast() -> None:
    cast, looked_up = relighters(models.full())
    for light in (models.LAMP, models.SPOT, DirectionalLight((0.2, 0.3, -0.5), 2.0)):
        ours, theirs = (each.render([light]) for each in (looked_up, cast))
        if light.kind == "directional":  # of a light from below, what a mirror throws is looked up
            without = [each.with_options(replace(each.options, thrown=False)) for each in (cast, looked_up)]
            np.testing.assert_array_equal(*(each.render([light]).radiance for each in without))
        else:
            np.testing.assert_array_equal(ours.radiance, theirs.radiance)
            assert ours.stats.rays == theirs.stats.rays


def test_a_table_needs_half_resolution() -> None:
    with pytest.raises(InputError, match="half"):
        RelightOptions(shadows="table")
    with pytest.raises(InputError, match="table_directions"):
        RelightOptions(shadows="table", shading="half", table_directions=100)
    with pytest.raises(InputError, match="table_mb"):
        RelightOptions(shadows="table", shading="half", table_mb=0)

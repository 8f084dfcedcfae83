"""Normals tilted from shading: what the photographs say, wherever the points are cut into parts."""

from dataclasses import replace

import numpy as np
import pytest

from relight3d.maths.lafortune import tangent_frame
from relight3d.records import Lobe
from relight3d.recover import detail
from relight3d.shading import lobe_brdf

LOBES = (Lobe(np.full(3, 0.3), np.array([-1.0, -1.0, 1.0]), 8.0),)


def bumpy(
    num: int = 400, num_photos: int = 9, lobes: tuple[Lobe, ...] = LOBES, gains: tuple[float, ...] = (1.0,)
) -> tuple[detail.DetailData, np.ndarray]:
    """A flat surface with tilted normals, its points in turn of inks of these gains, without noise; and those normals."""
    rng = np.random.default_rng(5)
    flat = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (num, 1))
    tangent, bitangent = tangent_frame(flat)
    tilted = detail._tilted(flat, tangent, bitangent, rng.normal(0, 0.05, (num, 2)).astype(np.float32))
    ways = rng.normal(size=(num_photos, 1, 3)) + [0.0, 0.0, 2.0]
    ways = (ways / np.linalg.norm(ways, axis=-1, keepdims=True)).astype(np.float32)
    viewer = np.tile(np.array([0.0, -0.6, 0.8], np.float32), (num, 1))
    albedo, is_lit = np.full((num, 3), 0.5, np.float32), rng.random((num_photos, num, 1)) > 0.2
    falloff = (2.0 * is_lit).astype(np.float32)
    measured, gain = np.empty((num_photos, num, 3), np.float32), np.resize(np.float32(gains), num)
    for k, way in enumerate(ways):
        to_light = np.broadcast_to(way, flat.shape)
        form = falloff[k] * np.maximum(tilted @ way[0], 0)[:, None]
        measured[k] = (albedo / np.pi + gain[:, None] * lobe_brdf(lobes, tilted, to_light, viewer)) * form
    weight = np.ones((num_photos, num), np.float32)
    data = detail.DetailData(ways, falloff, measured, np.zeros_like(measured), weight, albedo, flat, viewer)
    return data, tilted


def test_tilts_are_found() -> None:
    data, tilted = bumpy()
    found = detail.perturb_normals(data, LOBES, 1.0, detail.DetailOptions(damping=1e-4))
    before, after = (
        np.degrees(np.arccos(np.clip((each * tilted).sum(axis=1), -1, 1))) for each in (data.normal, found)
    )
    assert np.median(after) < 0.1 * np.median(before)
    choice = detail.choose_detail(data, LOBES, 1.0, detail.DetailOptions())
    assert choice.mode == "normal" and choice.gain_db > 10


@pytest.mark.parametrize("num", [1, 37, 400])
def test_parts_of_points_give_the_same(monkeypatch: pytest.MonkeyPatch, num: int) -> None:
    data, _ = bumpy()
    whole = detail.perturb_normals(data, LOBES, 1.0, detail.DetailOptions())
    monkeypatch.setattr(detail, "POINTS", num)
    np.testing.assert_allclose(detail.perturb_normals(data, LOBES, 1.0, detail.DetailOptions()), whole, atol=1e-6)


def test_without_highlights_there_is_no_gain_to_choose() -> None:
    data, _ = bumpy()
    assert detail.choose_detail(data, (), 1.0, detail.DetailOptions(mode="lobe")) == ("off", 0.02, 0.0, np.inf)
    assert detail.choose_detail(data, (), 1.0, detail.DetailOptions()).mode == "normal"


def test_a_lobe_is_told_from_the_relief_that_widens_it() -> None:
    narrow = (replace(LOBES[0], color=np.full(3, 1.5), exponent=60.0),)
    data, _ = bumpy(num_photos=16, lobes=narrow)
    wide = (replace(LOBES[0], color=np.full(3, 1.0), exponent=40.0),)
    options = detail.DetailOptions(damping=0.02)
    (found,) = detail.lobes_beside_tilts(data, wide, 1.0, options)
    assert found.exponent == pytest.approx(60.0, rel=0.15)
    np.testing.assert_allclose(found.color, narrow[0].color, rtol=0.15)
    before, after = (detail.choose_detail(data, lobes, 1.0, options).error for lobes in (wide, (found,)))
    assert after < 0.25 * before


@pytest.mark.parametrize("exponent, axis", [(1e4, 0.5), (1e4, 1.5), (0.5, 1e-3)])
def test_extreme_lobes_stay_finite(exponent: float, axis: float) -> None:
    data, _ = bumpy(num=50)
    lobes = (replace(LOBES[0], axes=np.array([-1.0, -1.0, axis]), exponent=exponent),)
    (found,) = detail.lobes_beside_tilts(data, lobes, 1.0, detail.DetailOptions())
    assert np.isfinite(found.color).all() and 0 < found.exponent <= 1e4
    for side in (-1, 1):  # the ends of what the fit may try
        tried = detail._reshaped(lobes[0], 0.8, side * np.log(4.0), side * np.log(16.0))
        assert np.isfinite(tried.color).all() and 0 < tried.exponent <= 1e4


GAINS = (0.2, 1.0, 2.5)


def inked(gains: tuple[float, ...] = GAINS) -> tuple[detail.DetailData, np.ndarray]:
    data, tilted = bumpy(600, 12, gains=gains)
    return replace(data, ink=np.resize(np.arange(len(gains), dtype=np.int32), 600)), tilted


def test_inks_and_tilts_are_told_together() -> None:
    data, tilted = inked()
    found = detail.perturb_normals(data, LOBES, 1.0, detail.DetailOptions(damping=1e-4, num_steps=15))
    np.testing.assert_allclose(found, tilted, atol=2e-3)
    np.testing.assert_allclose(detail.ink_gains(data, LOBES, 1.0, found)[:3], GAINS, rtol=0.02)
    choice = detail.choose_detail(data, LOBES, 1.0, detail.DetailOptions())
    blind = detail.choose_detail(replace(data, ink=None), LOBES, 1.0, detail.DetailOptions())
    assert choice.error < 0.25 * blind.error


def test_left_out_photographs_say_whether_inks_shine_unlike() -> None:
    inks_only = detail.DetailOptions(mode="ink")
    assert detail.choose_detail(inked()[0], LOBES, 1.0, inks_only).gain_db > -10 * np.log10(0.5)
    assert detail.choose_detail(inked((1.0, 1.0, 1.0))[0], LOBES, 1.0, inks_only).gain_db < -10 * np.log10(0.95)
    few = inked()[0]
    few = replace(
        few, **{name: getattr(few, name)[:3] for name in ("to_light", "falloff", "measured", "other", "weight")}
    )
    nothing = detail.Choice("off", 0.02, 0.0, np.inf)
    assert detail.choose_detail(few, LOBES, 1.0, inks_only) == nothing
    assert detail.choose_detail(replace(inked()[0], ink=None), LOBES, 1.0, inks_only) == nothing


def test_an_ink_that_no_highlight_tells_of_has_the_lobes_own_strength() -> None:
    data, _ = inked()
    weight = data.weight.copy()
    weight[:, data.ink == 2] = 0
    np.testing.assert_array_equal(detail.ink_gains(replace(data, weight=weight), LOBES, 1.0, data.normal)[2::3], 1.0)


def test_points_of_an_ink_lean_on_it() -> None:
    """Where a point's own photographs show no highlight, its gain is its ink's."""
    data, tilted = inked()
    weight = data.weight.copy()
    weight[:, :3] = 0
    gain = detail.lobe_gains(replace(data, weight=weight, normal=tilted), LOBES, 1.0, detail.DetailOptions())
    np.testing.assert_allclose(gain[:3], GAINS, rtol=0.02)
    np.testing.assert_allclose(gain[3:], np.resize(GAINS, 597), rtol=0.1)

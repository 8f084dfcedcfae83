"""Nasty fits: lobes at their bounds, eq. (2) without a scale, perturbations without a gradient."""

import numpy as np

from relight3d.evaluate.scenes import plastic
from relight3d.maths.lafortune import lobe_base, power
from relight3d.maths.least_squares import Status
from relight3d.records import Lobe
from relight3d.recover.detail import DetailData, DetailOptions, lobe_gains, perturb_normals
from relight3d.recover.specular import Frames, LobeSamples, SpecularOptions, fit_lobes, glossy_excess
from relight3d.recover.texture import reciprocal_texture
from relight3d.shading import lobe_brdf
from tests.stability.harness import (
    Outcome,
    case,
    checked,
    good_capture,
    good_error,
    held_out_error,
    outcome,
)

TANGENT = np.array([1.0, 0.0, 0.0])


def lobe_samples(lobes: tuple[Lobe, ...], num: int = 6000, spread: float = 0.9, noise: float = 0.0) -> LobeSamples:
    """A flat surface of albedo 0.4 with lobes, lit from ten directions and seen from many, half near the highlight."""
    rng = np.random.default_rng(0)
    normal = np.tile([0.0, 0.0, 1.0], (num, 1))
    viewer = _unit(np.column_stack([rng.uniform(-spread, spread, (num, 2)), np.ones(num)]))
    mirrored = viewer * [-1, -1, 1]
    width = np.where(np.arange(num) % 2 == 0, 0.02, 0.6)[:, None]
    light = _unit(mirrored + width * rng.standard_normal((num, 3)))
    light[:, 2] = np.abs(light[:, 2])
    form = light[:, 2:] * np.pi
    explained = np.repeat(0.4 / np.pi * form, 3, axis=1)
    measured = explained + lobe_brdf(lobes, normal, light, viewer) * form
    measured = measured + noise * rng.standard_normal(measured.shape)
    photo, here = rng.integers(0, 10, num), np.zeros((num, 3))
    return LobeSamples(photo, normal, light[:, None], viewer, form[:, None], measured, explained, np.ones(num), here)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _explained_share(samples: LobeSamples, lobes: tuple[Lobe, ...]) -> float:
    """How much of the highlight's power, on the compressed scale that the fit sees, the lobes account for."""
    brdf = lobe_brdf(lobes, samples.normal, samples.to_light[:, 0], samples.to_viewer)
    got = samples.explained + brdf * samples.form[:, 0]
    wanted, none = np.arcsinh(samples.measured), np.arcsinh(samples.explained)
    return 1.0 - float(np.sum((np.arcsinh(got) - wanted) ** 2) / np.sum((none - wanted) ** 2))


@case("fits", "exponents to 1e4", "x^n that overflows, a lobe narrower than the samples")
def sharp_lobes() -> Outcome:
    worst, found = 1.0, []
    for exponent in (3.0, 100.0, 3000.0, 1e4):
        # Energy 2 pi color / (n + 2) of 0.3: from a sheen to a peak of 500 times white.
        samples = lobe_samples((plastic(0.3 * (exponent + 2) / (2 * np.pi), exponent),))
        lobes, fit, gain = fit_lobes(samples, 1.0, Frames(TANGENT), SpecularOptions())
        assert lobes and fit is not None and np.isfinite(gain)
        assert all(1 <= lobe.exponent <= 1e4 * (1 + 1e-9) and np.isfinite(lobe.color).all() for lobe in lobes)
        found.append(max(lobe.exponent for lobe in lobes))
        worst = min(worst, _explained_share(samples, lobes))
    # 3 % of the compressed power is left by 15 evaluations of the fit at the sharpest.
    assert worst > 0.9, (worst, found)
    return Outcome("ok", 1 - worst, 0.0, fit.condition, "exponents found " + ", ".join(f"{n:.0f}" for n in found))


@case("fits", "base at zero", "0^n, log 0, an infinite slope")
def base_at_zero() -> Outcome:
    base = np.array([-1.0, -1e-30, -0.0, 0.0, 1e-38, 1e-30, 1e-10, 0.5, 1.0, 1.0 + 1e-7], np.float32)
    for dtype in (np.float32, np.float64):
        for exponent in (0.5, 1.0, 30.0, 1e4):
            value = power(base.astype(dtype), exponent)
            assert np.isfinite(value).all() and (value >= 0).all() and (value <= 1).all()
            assert not value[base <= 0].any() and value[-2] == 1.0
            step = (power(base.astype(dtype) + dtype(1e-3), exponent) - value) / 1e-3
            assert np.isfinite(step).all()
    # A light in the plane, a viewer in the plane, both: the base itself is finite.
    normal = np.array([[0.0, 0.0, 1.0]])
    flat = np.array([[1.0, 0.0, 0.0]])
    assert lobe_base(normal, flat, flat, np.array([-1.0, -1.0, 1.0]))[0] == -1.0
    return Outcome("ok", note="0 below, 1 at 1, finite slopes between")


@case("fits", "exactly diffuse data", "a tiny lobe in place of none")
def exactly_diffuse() -> Outcome:
    samples = lobe_samples(())
    excess, _ = glossy_excess(samples, 1.0)
    assert excess < SpecularOptions().excess_sigmas
    lobes, fit, gain = fit_lobes(samples, 1.0, Frames(TANGENT), SpecularOptions())
    assert lobes == () and fit is None and gain == 0.0
    lobes, _, _ = fit_lobes(lobe_samples((), noise=0.01), 1.0, Frames(TANGENT), SpecularOptions())
    assert lobes == ()
    model = checked(good_capture())
    assert not any(model.lobes)
    return outcome(model, held_out_error(model, good_capture()), "no lobe")


@case("fits", "pure mirror data", "a peak that no exponent is high enough for")
def pure_mirror() -> Outcome:
    # Bright only within 0.3 degrees of the mirror direction, a hundred times white.
    samples = lobe_samples(())
    along = np.einsum("si,si->s", samples.to_light[:, 0], samples.to_viewer * [-1, -1, 1])
    samples.measured[along > np.cos(np.radians(0.3))] += 100.0
    lobes, fit, _ = fit_lobes(samples, 1.0, Frames(TANGENT), SpecularOptions())
    assert all(1 <= lobe.exponent <= 1e4 * (1 + 1e-9) and np.isfinite(lobe.color).all() for lobe in lobes)
    status = "none" if fit is None else Status(fit.status).name.lower()
    # All energy stays within what arrives, so that no frame can outshine the lamp's own mirror image.
    return Outcome(status, condition=None if fit is None else fit.condition, note=f"{len(lobes)} lobes, within bounds")


@case("fits", "equal texels in eq. (2)", "two unknowns with one equation")
def equal_texels() -> Outcome:
    direct = np.linspace(0.5, 2.0, 4)[:, None] * np.linspace(0.8, 1.2, 6)[None]
    albedo = np.full(6, 0.3)
    answer = reciprocal_texture((albedo / np.pi * (direct + 0.4))[None], direct[None])
    # Condition about 10: float64 leaves 1e-12 of it.
    np.testing.assert_allclose(answer.value[0, :, 0], 0.3, rtol=1e-9)
    assert (answer.status == Status.OK).all()
    return Outcome("ok", float(np.abs(answer.value / 0.3 - 1).max()), 0.0, float(answer.condition[0]))


@case("fits", "right side of eq. (2) exactly zero", "a scale that nothing fixes, condition 1e16")
def flat_face_distant_light() -> Outcome:
    albedo = np.array([0.2, 0.5, 0.8, 0.35])
    direct = np.repeat(np.array([0.7, 1.1, 2.0])[:, None], 4, axis=1)
    answer = reciprocal_texture((albedo / np.pi * (direct + 0.3))[None], direct[None])
    got = answer.value[0, :, 0]
    assert (answer.status == Status.RANK_DEFICIENT).all() and (answer.rank == 3).all()
    # The ratios are right, and only they: 1e-9 for a null vector found beside singular values of about 1.
    np.testing.assert_allclose(got / got[0], albedo / albedo[0], rtol=1e-9)
    assert np.isinf(answer.condition).all() and np.isfinite(got).all()
    return Outcome("rank_deficient", float(np.abs(got / got[0] / (albedo / albedo[0]) - 1).max()), 0.0, None, "ratios")


@case("fits", "eq. (2) with black, NaN and one texel", "1 / 0")
def broken_texels() -> Outcome:
    direct = np.ones((3, 4))
    for radiance in (np.zeros((3, 4)), np.full((3, 4), np.nan)):
        answer = reciprocal_texture(radiance[None], direct[None])
        assert (answer.status == Status.NO_DATA).all() and not answer.value.any()
    assert (reciprocal_texture(np.ones((1, 3, 1)), np.ones((1, 3, 1))).status == Status.NO_DATA).all()
    partly = reciprocal_texture(np.array([[[0.1, 0.0], [0.2, 0.0]]]), np.array([[[1.0, 1.2], [2.0, 2.1]]]))
    assert np.isfinite(partly.value).all() and (partly.value >= 0).all()
    return Outcome("no_data", note="albedo 0")


def _detail(form: float) -> DetailData:
    rng = np.random.default_rng(0)
    up = np.tile(np.array([[0, 0, 1]], np.float32), (40, 1))
    return DetailData(
        to_light=np.tile(np.array([[[0, 0, 1]]], np.float32), (5, 1, 1)),
        falloff=np.full((5, 40, 1), form, np.float32),
        measured=rng.uniform(0.1, 1, (5, 40, 3)).astype(np.float32),
        other=np.zeros((5, 40, 3), np.float32),
        weight=np.ones((5, 40), np.float32),
        albedo=np.full((40, 3), 0.5, np.float32),
        normal=up,
        to_viewer=up,
    )


@case("fits", "perturbation with zero gradient", "a step of 0 / 0")
def zero_gradient() -> Outcome:
    # No light: nothing depends on the normal. Light along the normal: the cosine's slope is 0 there.
    dark = perturb_normals(_detail(0.0), (), 1.0, DetailOptions())
    np.testing.assert_array_equal(dark, _detail(0.0).normal)
    assert (lobe_gains(_detail(0.0), (plastic(1.0, 50.0),), 1.0, DetailOptions()) == 1.0).all()
    for lobes in ((), (plastic(1.0, 1e4),)):
        along = perturb_normals(_detail(1.0), lobes, 1.0, DetailOptions())
        assert np.isfinite(along).all()
        # A perturbation is bounded: tangent 0.5, so the cosine to the mesh's normal is at least 0.894.
        assert (along[:, 2] >= 0.894 - 1e-3).all()
    return Outcome("ok", note="no tilt in the dark, at most 27 degrees elsewhere")


@case("fits", "a glossy sphere among matte things", "gloss that leaks into albedo")
def glossy_desk() -> Outcome:
    capture = good_capture(glossy=True)
    model = checked(capture)
    error = held_out_error(model, capture)
    # A highlight of a few pixels, a tenth of the ten photographs' radiance in its place.
    assert error < good_error() + 0.04, error
    return outcome(model, error, f"lobes per surface {[len(lobes) for lobes in model.lobes]}")

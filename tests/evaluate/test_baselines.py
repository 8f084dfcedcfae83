"""The interpolators: exact where they must be, finite where they are weak, and linear in the light."""

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from relight3d.errors import InputError
from relight3d.evaluate.baselines import BASELINES, Baseline, fit_baseline
from relight3d.evaluate.scenes import hemisphere_lights
from relight3d.lights import DirectionalLight, PointLight, SpotLight

CENTRE = np.array([0.3, -0.2, 0.1])
Z = np.array([0.0, 0.0, 1.0])


def directions(lights: list) -> np.ndarray:
    return np.array([each[0].to_light for each in lights])


def response(omega: np.ndarray, kind: str) -> np.ndarray:
    """Radiance (light pixel 3) per irradiance of a few pixels, as functions of the light's direction."""
    x, y, z = omega.T
    if kind == "quadratic":  # in PTM's span while the hemisphere's axis is z
        pixels = [1 + 0.2 * x, 0.5 + 0.1 * x * y - 0.2 * y, 0.8 - 0.3 * x * x + 0.1 * y * y]
    else:  # in the span of the hemispherical harmonics of order 2
        pixels = [1 + 0.3 * z, 0.5 + 0.2 * z * z, 0.6 + 0.2 * np.sqrt(z / (1 + z)) * x]
    return np.stack(pixels, axis=1)[:, :, None] * np.array([1.0, 0.8, 0.6])


def about_z(num: int) -> list:
    """Lights in opposite pairs about z, so that their mean direction is z and the hemisphere's frame the world's."""
    half = hemisphere_lights(num // 2, seed=3)
    turned = [(DirectionalLight((-x, -y, z), (np.pi,) * 3),) for x, y, z in directions(half)]
    return half + turned


def photographs(lights: list, kind: str) -> np.ndarray:
    return (np.pi * response(directions(lights), kind)).astype(np.float32)


def lambertian(lights: list, normal: np.ndarray) -> np.ndarray:
    return np.broadcast_to(np.maximum(0.0, directions(lights) @ normal)[:, None, None], (len(lights), 2, 3))


@pytest.mark.parametrize(("name", "kind"), [("ptm", "quadratic"), ("hsh2", "hemispherical"), ("hsh3", "hemispherical")])
def test_exact_on_what_the_basis_spans(name: str, kind: str):
    train, test = about_z(40), hemisphere_lights(7, seed=4)
    baseline = fit_baseline(name, train, photographs(train, kind), CENTRE, ridge=0.0)
    wanted = photographs(test, kind)
    for light, want in zip(test, wanted):
        # float32 photographs, and a condition of about 100.
        np.testing.assert_allclose(baseline.predict(light), want, rtol=3e-5)
    wrong = fit_baseline(name, train, photographs(train, kind) ** 2, CENTRE, ridge=0.0)
    assert np.abs(wrong.predict(test[0]) - wanted[0]).max() > 0.1


def test_a_lambertian_pixel_is_near_the_harmonics_but_not_in_ptm():
    """n.l holds the height of the light, sqrt(1 - x^2 - y^2), which a polynomial in x and y only approximates."""
    train, test = about_z(60), hemisphere_lights(20, 35.0, 75.0, seed=5)
    radiance = lambertian(train, Z).astype(np.float32) * np.float32(np.pi)
    error = {}
    for name in ("ptm", "hsh2"):
        baseline = fit_baseline(name, train, radiance, CENTRE, ridge=0.0)
        got = np.array([baseline.predict(light)[0, 0] for light in test])
        error[name] = np.abs(got / np.pi - directions(test) @ Z).max()
    assert error["hsh2"] < 1e-5 < 1e-2 < error["ptm"] < 0.1


def test_rbf_is_scipys_and_passes_through_its_photographs():
    train, test = hemisphere_lights(15, seed=6), hemisphere_lights(5, seed=7)
    values = np.random.default_rng(0).uniform(1, 2, (15, 4, 3)).astype(np.float32)
    baseline = fit_baseline("rbf", train, values, CENTRE)
    for light, value in zip(train, values):
        np.testing.assert_allclose(baseline.predict(light), value, rtol=1e-5)
    wanted = RBFInterpolator(directions(train), values.reshape(15, -1), kernel="linear")(directions(test))
    got = np.array([baseline.predict(light).ravel() for light in test])
    np.testing.assert_allclose(got, wanted, rtol=1e-5)


@pytest.mark.parametrize("name", BASELINES)
@pytest.mark.parametrize("num", [1, 2, 3, 5, 8])
def test_few_lights_give_a_finite_answer_and_say_so(name: str, num: int):
    train = hemisphere_lights(num, seed=8)
    baseline = fit_baseline(name, train, photographs(train, "quadratic"), CENTRE)
    num_functions = {"ptm": 6, "hsh2": 9, "hsh3": 16, "rbf": num + 1}[name]
    assert (baseline.rank == min(num_functions, num + (name == "rbf"))).all()
    assert np.isinf(baseline.condition).all() == (num < num_functions and name != "rbf")
    for light in hemisphere_lights(6, seed=9) + [(DirectionalLight((0.0, 0.0, -1.0), (1.0,) * 3),)]:
        got = baseline.predict(light)
        assert np.isfinite(got).all() and (got >= 0).all()
        assert got.max() < 10 * np.pi


def test_minimum_norm_without_ridge():
    train = hemisphere_lights(4, seed=8)
    weak, pulled = (fit_baseline("hsh2", train, photographs(train, "quadratic"), CENTRE, ridge=r) for r in (0.0, 1e-9))
    # A vanishing ridge leads to the minimum-norm answer, which passes through the photographs.
    np.testing.assert_allclose(weak.operator, pulled.operator, atol=1e-6)
    np.testing.assert_allclose(weak.predict(train[2]), photographs(train, "quadratic")[2], rtol=1e-5)


@pytest.mark.parametrize("name", BASELINES)
def test_the_same_light_twice_is_averaged(name: str):
    train = hemisphere_lights(12, seed=1)
    values = photographs(train, "quadratic")
    plain = fit_baseline(name, train, values, CENTRE)
    twice = fit_baseline(name, train + train[:1], np.concatenate([values, values[:1]]), CENTRE)
    test = hemisphere_lights(1, seed=2)[0]
    # Equal for the interpolator; a doubled weight moves a fit a little.
    np.testing.assert_allclose(twice.predict(test), plain.predict(test), rtol=1e-5 if name == "rbf" else 2e-2)


@pytest.mark.parametrize("name", BASELINES)
def test_several_lights_add_up_and_ambient_counts_once(name: str):
    train = [*hemisphere_lights(14, seed=1), ()]
    ambient = np.array([0.2, 0.3, 0.4], np.float32)
    values = np.concatenate([photographs(train[:-1], "quadratic"), np.zeros((1, 3, 3), np.float32)]) + ambient
    baseline = fit_baseline(name, train, values, CENTRE)
    np.testing.assert_allclose(baseline.predict([]), np.broadcast_to(ambient, (3, 3)), rtol=1e-6)
    (one,), (two,) = hemisphere_lights(2, seed=5)
    parts = baseline.predict([one]) + baseline.predict([two]) - ambient
    np.testing.assert_allclose(baseline.predict([one, two]), parts, rtol=1e-5)
    np.testing.assert_allclose(
        baseline.predict([one.scaled(2.0)]) - ambient, 2 * (baseline.predict([one]) - ambient), rtol=1e-4
    )


@pytest.mark.parametrize("name", BASELINES)
def test_intensities_and_colours_are_divided_out(name: str):
    train = hemisphere_lights(14, seed=1)
    factors = np.random.default_rng(0).uniform(0.2, 5.0, (14, 3))
    colored = [(light[0].scaled(tuple(factor)),) for light, factor in zip(train, factors)]
    values = photographs(train, "quadratic")
    plain = fit_baseline(name, train, values, CENTRE)
    other = fit_baseline(name, colored, (values * factors[:, None]).astype(np.float32), CENTRE)
    test = hemisphere_lights(1, seed=2)[0]
    np.testing.assert_allclose(other.predict(test), plain.predict(test), rtol=1e-4)


@pytest.mark.parametrize("name", BASELINES)
def test_photographs_under_several_lights_are_taken_apart(name: str):
    single, test = about_z(24), hemisphere_lights(1, seed=2)[0]
    values = photographs(single, "quadratic")
    pairs = [(a[0], b[0].scaled(0.5)) for a, b in zip(single, single[1:] + single[:1])]
    of_pairs = values + 0.5 * np.roll(values, -1, axis=0)
    plain = fit_baseline(name, single, values, CENTRE, ridge=0.0).predict(test)
    got = fit_baseline(name, pairs, of_pairs.astype(np.float32), CENTRE, ridge=0.0).predict(test)
    # PTM spans the data and has it exactly; the others come near, and a wrong division by 1.5 would not.
    np.testing.assert_allclose(got, plain, rtol=1e-4 if name == "ptm" else 0.05)


@pytest.mark.parametrize("name", BASELINES)
def test_point_lights_far_away_are_directional(name: str):
    train, test = hemisphere_lights(16, seed=1), hemisphere_lights(1, seed=2)[0]
    values = photographs(train, "quadratic")

    def as_point(light: DirectionalLight) -> PointLight:
        place = CENTRE + 1e3 * np.array(light.to_light)
        return PointLight(tuple(place), tuple(light.power * 1e6))

    far = fit_baseline(name, [(as_point(each[0]),) for each in train], values, CENTRE)
    plain = fit_baseline(name, train, values, CENTRE)
    np.testing.assert_allclose(far.predict([as_point(test[0])]), plain.predict(test), rtol=1e-4)


def test_turning_the_world_changes_nothing():
    train, test = hemisphere_lights(16, seed=1), hemisphere_lights(1, seed=2)[0]
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    values = photographs(train, "quadratic")

    def turned(light: DirectionalLight) -> DirectionalLight:
        return DirectionalLight(tuple(turn @ light.to_light), light.irradiance)

    for name in ("ptm", "hsh2", "rbf"):
        plain = fit_baseline(name, train, values, CENTRE)
        other = fit_baseline(name, [(turned(each[0]),) for each in train], values, CENTRE)
        # The frame's x axis follows the world's y, and the ridge is not blind to it.
        np.testing.assert_allclose(other.predict([turned(test[0])]), plain.predict(test), rtol=5e-3)


def test_a_light_that_misses_the_centre_and_one_channel_only():
    train = hemisphere_lights(10, seed=1)
    aside = SpotLight((0.0, 0.0, 3.0), (1.0, 0.0, 0.1), 5.0, 0.1, 0.2)
    red = train[0][0].scaled((1.0, 0.0, 0.0))
    values = photographs(train, "quadratic")
    values = np.concatenate([values, np.zeros((1, 3, 3), np.float32), values[:1] * [1, 0, 0]]).astype(np.float32)
    for name in BASELINES:
        baseline = fit_baseline(name, [*train, (aside,), (red,)], values, CENTRE)
        got = baseline.predict(train[3])
        assert np.isfinite(got).all()
        np.testing.assert_allclose(got, values[3], rtol=0.2)


def test_a_missing_value_takes_the_mean_of_the_others():
    train = hemisphere_lights(10, seed=1)
    values = np.full((10, 2, 3), 2.0, np.float32)
    values[4, 1] = np.nan
    got = fit_baseline("rbf", train, values, CENTRE).predict(train[4])
    np.testing.assert_allclose(got, 2.0, rtol=1e-5)


def test_bad_input_is_named():
    train = hemisphere_lights(3)
    values = photographs(train, "quadratic")
    with pytest.raises(InputError, match="baseline: got splines"):
        fit_baseline("splines", train, values, CENTRE)
    with pytest.raises(InputError, match="one each"):
        fit_baseline("ptm", train[:2], values, CENTRE)
    with pytest.raises(InputError, match="none with a light"):
        fit_baseline("ptm", [(), (), ()], values, CENTRE)


def test_a_baseline_is_a_weighted_sum_of_photographs():
    train, test = hemisphere_lights(9, seed=1), hemisphere_lights(1, seed=2)[0]
    values = photographs(train, "quadratic")
    baseline = fit_baseline("rbf", train, values, CENTRE)
    assert isinstance(baseline, Baseline)
    by_hand = np.einsum("cp,pnc->nc", baseline.weights(test), values / np.pi)
    np.testing.assert_allclose(baseline.predict(test), by_hand, rtol=1e-4)
    np.testing.assert_allclose(baseline.weights(test).sum(axis=1), np.pi, rtol=1e-9)  # a constant stays one

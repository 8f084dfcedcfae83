"""Indirect light as functions of the light: the left-out error by hand, the choice of functions, ambient light."""

import numpy as np
import pytest
import scipy.sparse as sp

from relight3d.evaluate.scenes import hemisphere_lights
from relight3d.lights import DirectionalLight, Light
from relight3d.maths.least_squares import Status
from relight3d.maths.light_basis import evaluate_basis
from relight3d.records import Observations
from relight3d.recover import indirect
from relight3d.recover.indirect import IndirectOptions, LightDesign, SiteSums

EXACT = IndirectOptions(damping=0.0)
NOWHERE = np.zeros((1, 3), np.float32)
NUM_SITES = 5


def observations(lights: list[tuple[Light, ...]]) -> Observations:
    """Photographs of which nothing but the lights and their scale matters."""
    num = len(lights)
    scale = np.array([sum((light.power for light in each), np.zeros(3)) for each in lights])
    scale[scale[:, 0] == 0] = scale[scale[:, 0] > 0].mean(axis=0)
    one, flag = np.ones((num, 1), np.float32), np.ones((num, 1), bool)
    radiance = np.ones((num, 1, 3), np.float32)
    return Observations(radiance, one, scale, tuple(lights), one[..., None], None, flag, flag, flag, flag, flag[0])


def sums_of(irradiance: np.ndarray, rng: np.random.Generator) -> SiteSums:
    """Sites that hear some photographs well, some faintly, and each misses one."""
    weight = rng.uniform(0.1, 2.0, irradiance.shape)
    weight[np.arange(len(weight)), rng.integers(0, irradiance.shape[1], len(weight))] = 0.0
    return SiteSums(weight, weight * irradiance)


def anchors_of(observed: Observations) -> np.ndarray:
    return indirect.light_anchors(observed)


@pytest.mark.parametrize("is_shared", [True, False])
def test_the_left_out_error_is_that_of_fits_without_each_photograph(is_shared: bool) -> None:
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(1 if is_shared else NUM_SITES, 12, 1, 4))
    irradiance = rng.normal(size=(NUM_SITES, 12, 3))
    sums = sums_of(irradiance, rng)
    squared = 0.0
    for site in range(NUM_SITES):
        functions = rows[0 if is_shared else site, :, 0]
        for color in range(3):
            weight = sums.weight[site, :, color]
            for photo in np.flatnonzero(weight):
                others = np.arange(12) != photo
                root = np.sqrt(weight[others])
                system, side = functions[others] * root[:, None], irradiance[site, others, color] * root
                coefficients = np.linalg.lstsq(system, side, rcond=None)[0]
                squared += weight[photo] * (irradiance[site, photo, color] - functions[photo] @ coefficients) ** 2
    found = indirect.left_out_error(sums, LightDesign("linear", rows, np.zeros(4), False))
    assert found == pytest.approx(squared / sums.weight.sum(), rel=1e-6)  # a ridge of 1e-9 keeps gaps solvable


@pytest.mark.parametrize("colors", [1, 3])
def test_rows_shared_by_sites_and_rows_of_each_are_solved_alike(colors: int) -> None:
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(1, 10, colors, 4))
    value = rng.normal(size=(NUM_SITES, 3, 4))
    irradiance = np.einsum("ncu,lcu->nlc", value, np.broadcast_to(rows[0], (10, 3, 4)))
    sums = sums_of(irradiance, rng)
    for each in (rows, np.repeat(rows, NUM_SITES, axis=0)):
        lit = LightDesign("linear", each, np.zeros(4), False)
        solution = indirect.solve_sites(sums, lit)
        assert (solution.status == Status.OK).all()
        np.testing.assert_allclose(solution.value[:, :, 0].reshape(NUM_SITES, 3, 4), value, atol=1e-9)
        np.testing.assert_allclose(indirect.predict(solution, lit), irradiance, atol=1e-5)  # float32


@pytest.mark.parametrize("name", ["constant", "linear", "sh2"])
def test_the_functions_chosen_are_those_that_foretell(name: str) -> None:
    assert chosen(name, num_lights=20) == name


def test_more_functions_than_photographs_or_than_allowed_are_not_chosen() -> None:
    assert chosen("sh2", num_lights=20, most=4) == "linear"
    assert chosen("sh2", num_lights=9) == "linear"  # nine functions fit nine photographs whatever they show
    assert chosen("sh2", num_lights=4) == "constant"


def chosen(name: str, num_lights: int, most: int = 9) -> str:
    """The basis chosen for irradiance in the functions of the named one, with a little noise."""
    rng = np.random.default_rng(2)
    observed = observations(hemisphere_lights(num_lights, 5.0, 85.0, seed=4))
    anchors = anchors_of(observed)
    functions = evaluate_basis(name, anchors)
    irradiance = np.einsum("lu,nuc->nlc", functions, 1.0 + rng.random((NUM_SITES, functions.shape[1], 3)))
    sums = sums_of(irradiance + 0.1 * rng.normal(size=irradiance.shape), rng)
    return indirect.choose_design(sums, observed, NOWHERE, anchors, 1e-6, EXACT, most)[0].basis


def lamps(powers: np.ndarray) -> list[tuple[Light, ...]]:
    directions = [each[0].to_light for each in hemisphere_lights(len(powers), 20.0, 80.0, seed=5)]
    return [(DirectionalLight(way, float(power)),) for way, power in zip(directions, powers)]


def ambient_fit(lights: list[tuple[Light, ...]], ambient: float) -> tuple[LightDesign, SiteSums, Observations]:
    """Indirect light of 0.3 of the lamps' whatever their direction, and ambient light beside it."""
    observed = observations(lights)
    is_on = ~observed.is_dark
    irradiance = 0.3 * is_on[:, None] + ambient / observed.scale
    sums = sums_of(np.broadcast_to(irradiance, (NUM_SITES, *irradiance.shape)), np.random.default_rng(6))
    return indirect.design("linear", observed, NOWHERE, anchors_of(observed), 1e-6, EXACT), sums, observed


@pytest.mark.parametrize("lights", [lamps(np.geomspace(1, 30, 12)), [*lamps(np.full(11, 2.0)), ()]])
def test_ambient_light_is_told_apart_by_intensities_or_a_photograph_without_lamps(lights) -> None:
    lit, sums, observed = ambient_fit(lights, ambient=0.7)
    assert lit.has_ambient and indirect.ambient_gain_db(sums, lit) > 20.0
    anchors = anchors_of(observed)
    record, health = indirect.indirect_of(indirect.solve_sites(sums, lit), lit, observed, "vertex", anchors, 1e-6)
    np.testing.assert_allclose(record.ambient, 0.7, rtol=1e-5)  # in irradiance, whatever the lamps' powers
    np.testing.assert_allclose(record.coefficients[:, 0], 0.3, rtol=1e-5)
    np.testing.assert_allclose(record.coefficients[:, 1:], 0.0, atol=1e-5)
    assert (health.status == Status.OK).all() and (health.rank == 5).all()


def test_equal_lamps_do_not_tell_ambient_light_and_none_is_claimed() -> None:
    lit, sums, _ = ambient_fit(lamps(np.full(12, 2.0)), ambient=0.7)
    assert not lit.has_ambient and indirect.ambient_gain_db(sums, lit) == 0.0
    assert lit.rows.shape[-1] == len(lit.damping) == 4


def test_what_is_known_is_taken_off_and_the_rest_is_unexplained() -> None:
    rng = np.random.default_rng(7)
    known, rest = rng.random((2, NUM_SITES, 12, 3))
    sums = sums_of(known + rest, rng)
    left = indirect.without(sums, known)
    wanted = (sums.weight * rest**2).sum() / sums.weight.sum()
    assert indirect.unexplained(left) == pytest.approx(wanted)


@pytest.mark.parametrize("num_photos", [1, 6, 7])
def test_photographs_are_summed_to_sites_block_by_block(num_photos: int) -> None:
    """Weights w a^2 and moments w a (pi L - a E) of each site's points, whatever the number that is summed at once."""
    rng = np.random.default_rng(8)
    binding = sp.random(4, 9, density=0.5, format="csr", dtype=np.float32, random_state=0)
    weight, albedo = rng.random((num_photos, 9), np.float32), rng.random((9, 3), np.float32)
    target, direct = rng.random((2, num_photos, 9, 3), np.float32)
    sums = indirect.gather(binding, weight, albedo, target, direct)
    dense = binding.toarray().astype(np.float64)
    np.testing.assert_allclose(sums.weight, np.einsum("sp,lp,pc->slc", dense, weight, albedo**2), rtol=1e-5)
    missing = np.pi * target - albedo * direct
    np.testing.assert_allclose(sums.moment, np.einsum("sp,lp,pc,lpc->slc", dense, weight, albedo, missing), atol=1e-5)


def noisy_room(share: float, powers: np.ndarray) -> tuple[SiteSums, Observations, np.ndarray]:
    """Sites of unequal brightness that get `share` times as much ambient light as a lamp of power 1 sends indirectly."""
    rng = np.random.default_rng(9)
    observed = observations(lamps(powers))
    level = rng.uniform(0.1, 0.5, (60, 1, 1))
    irradiance = level * (1.0 + share / observed.scale)
    weight = np.ones(irradiance.shape)
    noisy = irradiance * (1.0 + 0.1 * rng.normal(size=irradiance.shape))
    return SiteSums(weight, weight * noisy), observed, level[:, 0]


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_ambient_light_is_a_share_of_all_where_each_site_tells_too_little(share: float) -> None:
    """Of lamps between half and twice as strong as each other, in noise: no site tells ambient light by itself."""
    sums, observed, level = noisy_room(share, np.linspace(0.6, 1.6, 8))
    anchors = anchors_of(observed)
    lit, _ = indirect.choose_design(sums, observed, NOWHERE, anchors, 1e-6, IndirectOptions())
    assert lit.shared_ambient is not None and not lit.has_ambient and lit.tells_ambient
    assert indirect.ambient_gain_db(sums, lit) > 0.3
    record, _ = indirect.indirect_of(indirect.solve_sites(sums, lit), lit, observed, "vertex", anchors, 1e-6)
    assert record.ambient_is_separate
    np.testing.assert_allclose(np.median(record.ambient / (share * level), axis=0), 1.0, rtol=0.3)
    # Two lamps of power 1 at once add up to twice the indirect light, and to the ambient light once.
    both = record.ambient + 2 * record.coefficients[:, 0]
    np.testing.assert_allclose(np.median(both / level, axis=0), 2.0 + share, rtol=0.1)


def test_without_the_shared_ambient_light_the_functions_are_as_before() -> None:
    sums, observed, _ = noisy_room(1.0, np.linspace(0.6, 1.6, 8))
    anchors = anchors_of(observed)
    plain = indirect.design("constant", observed, NOWHERE, anchors, 1e-6, IndirectOptions())
    back = indirect.without_ambient(indirect.with_shared_ambient(plain, observed, 0.5))
    np.testing.assert_allclose(back.rows, indirect.without_ambient(plain).rows)
    assert not back.tells_ambient and indirect.ambient_gain_db(sums, back) == 0.0


def test_no_share_of_ambient_light_is_claimed_of_equal_lamps_or_in_the_dark() -> None:
    equal, observed, _ = noisy_room(1.0, np.full(8, 1.0))
    anchors = anchors_of(observed)
    assert not indirect.choose_design(equal, observed, NOWHERE, anchors, 1e-6, IndirectOptions())[0].tells_ambient
    dark, observed, _ = noisy_room(0.0, np.linspace(0.6, 1.6, 8))
    lit, _ = indirect.choose_design(dark, observed, NOWHERE, anchors_of(observed), 1e-6, IndirectOptions())
    assert indirect.ambient_gain_db(dark, lit) < 0.1  # SCENE_NOISE_DB: what does not exceed it is switched off

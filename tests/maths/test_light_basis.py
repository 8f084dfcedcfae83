"""The functions of the light at the edges of what they are asked, and the directions that they are sampled at."""

import numpy as np
import pytest

from relight3d.maths.light_basis import BASES, embedding, evaluate_basis, spread_directions, within_reach

ROUNDED = np.array([[0.0, 0.0, 1.0 + 2e-16], [0.0, 0.0, -1.0 - 2e-16]])  # what a division by the length may leave


@pytest.mark.parametrize("num", [1, 2, 7, 400])
def test_directions_are_spread_evenly_from_pole_to_pole(num: int) -> None:
    found = spread_directions(num)
    assert found.shape == (num, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(found[:, 2], 1 - (2 * np.arange(num) + 1) / num, atol=1e-12)  # rings of equal area
    if num == 400:
        # The second moments of an even sphere are a third, the rest is 0; a spiral of 400 is even to a thousandth.
        np.testing.assert_allclose(found.T @ found / num, np.eye(3) / 3, atol=1e-3)
        nearest = np.arccos(np.clip(np.sort(found @ found.T, axis=1)[:, -2], -1, 1))
        assert nearest.min() > 0.7 * np.sqrt(4 * np.pi / num)


@pytest.mark.parametrize("name", BASES)
def test_a_direction_rounded_beyond_unit_length_is_that_of_the_pole(name: str) -> None:
    poles = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    np.testing.assert_allclose(evaluate_basis(name, ROUNDED), evaluate_basis(name, poles), atol=1e-12)


def test_reach_is_measured_of_rounded_directions_too() -> None:
    moved, excess = within_reach(ROUNDED, np.array([[0.0, 0.0, 1.0 + 2e-16]]), 0.2)
    np.testing.assert_array_equal(moved[0], ROUNDED[0])
    assert excess == pytest.approx([0.0, np.pi - 0.2])
    assert np.isfinite(moved).all()


@pytest.mark.parametrize(
    ("name", "into"), [("constant", "linear"), ("linear", "sh2"), ("cosines2", "sh2"), ("sh2", "sh3")]
)
def test_a_wider_basis_holds_the_functions_of_a_narrow_one(name: str, into: str) -> None:
    omega = np.random.default_rng(1).normal(size=(50, 3))
    omega /= np.linalg.norm(omega, axis=1, keepdims=True)
    rows = embedding(name, into)
    np.testing.assert_allclose(evaluate_basis(into, omega) @ rows.T, evaluate_basis(name, omega), atol=1e-9)


def test_a_basis_that_cannot_hold_the_other_is_refused() -> None:
    with pytest.raises(ValueError, match="basis linear does not hold the functions of sh2"):
        embedding("sh2", "linear")

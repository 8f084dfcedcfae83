"""The octahedron laid flat: its directions, and the three about any one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from relight3d.maths.octahedral import directions_about, octahedral_directions


def on_octahedron(ways: np.ndarray) -> np.ndarray:
    return ways / np.abs(ways).sum(axis=-1, keepdims=True)


@pytest.mark.parametrize("side", [2, 8, 96])
def test_three_directions_make_up_any(side: int) -> None:
    """On the octahedron itself shares are exact, poles, equator and seams included."""
    ways = np.random.default_rng(side).normal(size=(500, 3))
    ways = np.concatenate([ways, np.eye(3), -np.eye(3), [[1, 1, 0], [-1, 1, 0], [1, -1, 0], [-1, -1, -1e-9]]])
    corners = on_octahedron(octahedral_directions(side))
    for way in ways:
        at, shares = directions_about(way, side)
        assert min(shares) >= -1e-12 and sum(shares) == pytest.approx(1.0)
        np.testing.assert_allclose(np.array(shares) @ corners[list(at)], on_octahedron(way), atol=1e-12)


def test_directions_are_unit_and_nearly_even() -> None:
    ways = octahedral_directions(32)
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1.0)
    unique = np.unique(ways.round(9), axis=0)
    cosine = unique @ unique.T - 2 * np.eye(len(unique))
    steps = np.arccos(np.clip(cosine.max(axis=1), -1, 1))
    assert steps.max() < 3 * steps.min()


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda way: np.linalg.norm(way) > 1e-3))
def test_a_direction_is_near_its_three(way: tuple[float, float, float]) -> None:
    at, _ = directions_about(np.array(way), 64)
    about = octahedral_directions(64)[list(at)]
    assert (about @ (np.array(way) / np.linalg.norm(way))).min() > np.cos(3 * np.sqrt(4 * np.pi) / 64)

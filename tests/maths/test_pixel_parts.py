"""Pixels cut by a known edge: the area found from rays between neighbours, beside the area itself."""

from collections.abc import Callable

import numpy as np
import pytest

from relight3d.maths.pixel_parts import FULL, HALVINGS, PLACES, own_part
from tests.borders import FOUR_RAYS

SIDE = 16
Y, X = np.divmod(np.arange(SIDE * SIDE), SIDE)
INNER = (X > 0) & (X < SIDE - 1) & (Y > 0) & (Y < SIDE - 1)
WAYS = ((1, 0), (-1, 0), (0, 1), (0, -1))
Edge = Callable[..., np.ndarray]  # (x, y) -> whether lit


def edges_of(is_lit: Edge) -> np.ndarray:
    """The edges of each pixel, placed by halving between it and its neighbours."""
    lit, edges = is_lit(X, Y), np.zeros((SIDE * SIDE, 4), np.uint8)
    for way, (dx, dy) in enumerate(WAYS):
        inside = (X + dx >= 0) & (X + dx < SIDE) & (Y + dy >= 0) & (Y + dy < SIDE)
        for p in np.flatnonzero(inside & lit):
            other = p + dx + SIDE * dy
            if lit[other]:
                continue
            place = 0
            for k in range(HALVINGS):
                part = (place + (PLACES >> (k + 1))) / PLACES
                place += (PLACES >> (k + 1)) * bool(is_lit(X[p] + part * dx, Y[p] + part * dy))
            edges[p, way], edges[other, way ^ 1] = place + 1, PLACES - place
    return edges


def lit_part(is_lit: Edge) -> np.ndarray:
    own = own_part(edges_of(is_lit)) / FULL
    return np.where(is_lit(X, Y), own, 1 - own)


def mean_over(is_lit: Edge, places: np.ndarray) -> np.ndarray:
    return np.mean([is_lit(X + dx, Y + dy) for dx, dy in places], axis=0)


def area(is_lit: Edge) -> np.ndarray:
    steps = (np.arange(32) + 0.5) / 32 - 0.5
    return mean_over(is_lit, np.array([(dx, dy) for dx in steps for dy in steps]))


def straight(angle_deg: float, offset_px: float) -> tuple[Edge, np.ndarray, np.ndarray]:
    """A border across the middle, the direction across it and a point of it."""
    across = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    middle = SIDE / 2 + offset_px * across
    return lambda x, y: (x - middle[0]) * across[0] + (y - middle[1]) * across[1] > 0, across, middle


@pytest.mark.parametrize("angle_deg", [0.0, 10.0, 27.0, 45.0, 63.0, 90.0])
@pytest.mark.parametrize("offset_px", [-0.45, -0.2, 0.0, 0.1, 0.35])
def test_a_straight_edge_is_covered(angle_deg: float, offset_px: float) -> None:
    is_lit, _, _ = straight(angle_deg, offset_px)
    error = np.abs(lit_part(is_lit) - area(is_lit))[INNER]
    hard = np.abs(is_lit(X, Y) - area(is_lit))[INNER]
    assert error.max() < 0.13  # a corner that no ray between centres meets
    assert error.mean() <= 0.25 * hard.mean() + 0.002


def test_an_edge_is_placed_more_finely_than_by_four_rays() -> None:
    """The mean over many edges, of the pixels that have one."""
    error, by_four = [], []
    for angle_deg in np.arange(0, 360, 13.0):
        for offset_px in (-0.37, -0.11, 0.23, 0.41):
            is_lit, _, _ = straight(angle_deg, offset_px)
            there = INNER & edges_of(is_lit).any(axis=1)
            error.append(np.abs(lit_part(is_lit) - area(is_lit))[there])
            by_four.append(np.abs(mean_over(is_lit, FOUR_RAYS) - area(is_lit))[there])
    assert np.concatenate(error).mean() < 0.35 * np.concatenate(by_four).mean()


@pytest.mark.parametrize("width_px", [0.6, 0.9, 1.4])
@pytest.mark.parametrize("is_shadow", [True, False], ids=["thin shadow", "thin light"])
def test_thin_shadows_are_cut_on_both_sides(width_px: float, is_shadow: bool) -> None:
    for axis in (0, 1):
        for at in (7.0, 7.1, 6.85):
            is_lit = lambda *xy, axis=axis, at=at: (np.abs(xy[axis] - at) < width_px / 2) != is_shadow  # noqa: E731
            error = np.abs(lit_part(is_lit) - area(is_lit))[INNER]
            assert error.max() < 1.1 / PLACES
    # Not along an axis: where a border was found, better than four rays.
    error, by_four = [], []
    for angle_deg in (12.0, 33.0, 45.0):
        _, across, middle = straight(angle_deg, 0.1)
        is_lit = lambda x, y, across=across, middle=middle: (  # noqa: E731
            np.abs((x - middle[0]) * across[0] + (y - middle[1]) * across[1]) < width_px / 2
        ) != is_shadow
        there = INNER & edges_of(is_lit).any(axis=1)
        error.append(np.abs(lit_part(is_lit) - area(is_lit))[there])
        by_four.append(np.abs(mean_over(is_lit, FOUR_RAYS) - area(is_lit))[there])
    assert np.concatenate(error).mean() < 0.7 * np.concatenate(by_four).mean()


def test_corners_are_better_than_by_four_rays() -> None:
    """The mean over corners of shadows turned and shifted."""
    error, by_four = [], []
    for turn_deg in np.arange(0.0, 90.0, 15.0):
        for shift in np.linspace(-0.5, 0.5, 9):
            first, _, _ = straight(turn_deg, shift)
            second, _, _ = straight(turn_deg + 90, 0.7 * shift)
            is_lit = lambda x, y, first=first, second=second: first(x, y) & second(x, y)  # noqa: E731
            there = INNER & edges_of(is_lit).any(axis=1) & (np.hypot(X - SIDE / 2, Y - SIDE / 2) < 2)
            error.append(np.abs(lit_part(is_lit) - area(is_lit))[there])
            by_four.append(np.abs(mean_over(is_lit, FOUR_RAYS) - area(is_lit))[there])
    assert np.concatenate(error).mean() < 0.75 * np.concatenate(by_four).mean()


def test_a_pixel_without_edges_is_its_own() -> None:
    assert own_part(np.zeros((1, 4), np.uint8)).tolist() == [FULL]

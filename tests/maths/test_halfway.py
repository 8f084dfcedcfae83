"""Brushed highlights: their energy, their frame, and the rigid motion that a surface is brushed along."""

import numpy as np
import pytest

from relight3d.maths.halfway import halfway_base, halfway_energy, rigid_field, round_halfway_base

UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("axes", "exponent"), [((4.0, 4.0, 1.0), 2.0), ((100.0, 4.0, 1.0), 2.5), ((4.0, 8.0, 1.0), 20.0)]
)
def test_energy_is_the_integral_over_the_hemisphere(axes: tuple, exponent: float) -> None:
    i = (np.arange(1200) + 0.5) / 1200
    azimuth, height = np.meshgrid(2 * np.pi * i, i)
    ring = np.sqrt(1 - height**2)
    light = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), height], axis=-1)
    up = np.broadcast_to(UP, light.shape)
    base = halfway_base(up, light, up, np.array(axes), np.array([1.0, 0.0, 0.0]))
    wanted = 2 * np.pi * float((base**exponent * height).mean())
    assert halfway_energy(np.array(axes), exponent) == pytest.approx(wanted, rel=0.05)  # it is largest head-on


def test_the_base_is_one_at_the_mirror_direction_and_falls_faster_across_the_wider_axis() -> None:
    viewer, along = np.array([0.6, 0.0, 0.8]), np.array([2.0, 0.0, 5.0])
    lights = np.array([[-0.6, 0.0, 0.8], [-0.4, 0.0, 0.84**0.5], [-0.6, 0.2, 0.6**0.5]])
    base = halfway_base(np.tile(UP, (3, 1)), lights, np.tile(viewer, (3, 1)), np.array([100.0, 4.0, 1.0]), along)
    assert base[0] == pytest.approx(1.0)
    assert base[1] < base[2] < 1.0
    swapped = halfway_base(UP[None], viewer[None], lights[1:2], np.array([100.0, 4.0, 1.0]), along)
    assert swapped[0] == pytest.approx(base[1])  # reciprocal


def test_a_round_one_needs_no_tangent() -> None:
    rng = np.random.default_rng(3)
    normal, light, viewer = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in rng.normal(size=(3, 200, 3)))
    axes = np.array([300.0, 300.0, 1.0])
    wanted = halfway_base(normal, light, viewer, axes, rng.normal(size=(200, 3)))
    np.testing.assert_allclose(round_halfway_base(normal, light, viewer, axes), wanted, rtol=1e-9)
    # At the mirror direction the whole's square less the normal's part would leave nothing but rounding.
    up, sharp = UP[None].astype(np.float32), np.array([1e5, 1e5, 1.0], np.float32)
    ways = [np.array([[x, 0.0, np.sqrt(1 - x * x)]], np.float32) for x in (0.6, -0.601)]
    exact = halfway_base(*(each.astype(float) for each in (up, *ways)), sharp.astype(float), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(round_halfway_base(up, *ways, sharp), exact, rtol=1e-4)


def test_circles_and_straight_lines_are_found() -> None:
    rng = np.random.default_rng(0)
    axis, middle = np.array([0.0, 0.6, 0.8]), np.array([3.0, -1.0, 2.0])
    places = middle + rng.normal(size=(200, 3))
    around = np.cross(axis, places - middle)
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    outward = np.cross(around, axis)
    straight = np.tile(axis, (200, 1))
    for tangents, normals in ((around, outward), (straight, outward), (around, np.tile(axis, (200, 1)))):
        start, turn = rigid_field(places, tangents, normals)
        found = start + np.cross(turn, places)
        found /= np.linalg.norm(found, axis=1, keepdims=True)
        # The motion along the normals is no brushing: what counts is the part in the surface.
        found -= normals * np.einsum("pi,pi->p", found, normals)[:, None]
        cosine = np.abs(np.einsum("pi,pi->p", found, tangents)) / np.linalg.norm(found, axis=1)
        assert np.median(cosine) > 0.999

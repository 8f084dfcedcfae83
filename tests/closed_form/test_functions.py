"""Lobes and bases of the light against their integrals."""

import numpy as np
import pytest

from relight3d.maths.lafortune import lobe_base, lobe_energy, power, tangent_frame
from relight3d.maths.light_basis import BASES, degree_of, evaluate_basis, within_reach

UP = np.array([[0.0, 0.0, 1.0]])
PHONG = np.array([-1.0, -1.0, 1.0])


def sphere_rule(num=24, upper=False):
    """Directions and weights that integrate polynomials to degree 2 num - 1 over the sphere, or its upper half."""
    z, weight = np.polynomial.legendre.leggauss(num)
    if upper:
        z, weight = (z + 1) / 2, weight / 2
    azimuth = 2 * np.pi * (np.arange(2 * num) + 0.5) / (2 * num)
    ring = np.sqrt(1 - z**2)
    omega = np.stack(
        [ring[:, None] * np.cos(azimuth), ring[:, None] * np.sin(azimuth), np.repeat(z[:, None], 2 * num, 1)], -1
    )
    return omega.reshape(-1, 3), np.repeat(weight, 2 * num) * np.pi / num


def random_rotation(seed=0):
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def test_a_lobe_peaks_at_one_in_the_mirror_direction():
    viewer = np.array([[0.6, 0.0, 0.8]])
    mirrored = viewer * [-1, -1, 1]
    assert power(lobe_base(UP, mirrored, viewer, PHONG), 500.0)[0] == pytest.approx(1.0, abs=1e-12)
    rng = np.random.default_rng(0)
    light = rng.standard_normal((5000, 3))
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    values = power(lobe_base(np.tile(UP, (5000, 1)), light, np.tile(viewer, (5000, 1)), PHONG), 500.0)
    assert values.max() <= 1.0


@pytest.mark.parametrize("exponent", [1.0, 10.0, 100.0, 1e3, 1e4])
def test_energy_of_a_phong_lobe_seen_from_above(exponent):
    # Viewer at the normal: base is u_z, so the integral of u_z^n u_z over the hemisphere is 2 pi / (n + 2). That is the
    # largest over viewers for sharp lobes; a broad one seen from the side can have no more.
    # 64 strata: their error is largest, 1 %, where the weight u_z still varies over the lobe.
    assert lobe_energy(PHONG, exponent) == pytest.approx(2 * np.pi / (exponent + 2), rel=0.01)


def test_energy_of_a_turned_anisotropic_lobe_is_found_from_either_side():
    # c_y is the strong axis: a viewer along x would see a lobe of half the length only.
    assert lobe_energy(np.array([-0.2, -1.0, 0.3]), 8.0) == pytest.approx(
        lobe_energy(np.array([-1.0, -0.2, 0.3]), 8.0), rel=1e-9
    )


def test_anisotropic_axes_take_their_directions_from_the_tangent():
    along = np.array([0.0, 1.0, 0.0])
    axes = np.array([-1.0, -0.2, 0.8])
    light, viewer = np.array([[0.0, -0.6, 0.8]]), np.array([[0.0, 0.6, 0.8]])
    # Both lie along the tangent: c_x counts, with u_t v_t = -0.36 and u_n v_n = 0.64.
    assert lobe_base(UP, light, viewer, axes, along)[0] == pytest.approx(0.36 + 0.8 * 0.64)


def test_tangent_frames_are_orthonormal_everywhere():
    omega, _ = sphere_rule()
    omega = np.concatenate([omega, [[0, 0, 1.0], [0, 0, -1.0], [1.0, 0, 0]]])
    for along in (None, np.array([0.0, 0.0, 1.0])):
        tangent, bitangent = tangent_frame(omega, along)
        frame = np.stack([tangent, bitangent, omega], axis=1)
        np.testing.assert_allclose(frame @ frame.transpose(0, 2, 1), np.broadcast_to(np.eye(3), frame.shape), atol=1e-9)


@pytest.mark.parametrize("name", ["sh2", "sh3"])
def test_spherical_harmonics_are_orthonormal(name):
    omega, weight = sphere_rule()
    functions = evaluate_basis(name, omega)
    gram = (functions * weight[:, None]).T @ functions / (4 * np.pi)
    np.testing.assert_allclose(gram, np.eye(BASES[name]), atol=1e-12)


@pytest.mark.parametrize("name", ["hsh2", "hsh3"])
def test_hemispherical_harmonics_are_orthonormal_over_the_hemisphere(name):
    omega, weight = sphere_rule(64, upper=True)
    functions = evaluate_basis(name, omega)
    gram = (functions * weight[:, None]).T @ functions / (2 * np.pi)
    # Not polynomials in z: the rule of 64 points is exact to about 1e-6 for their square roots at the rim.
    np.testing.assert_allclose(gram, np.eye(BASES[name]), atol=1e-4)


@pytest.mark.parametrize("name", ["constant", "linear", "cosines2", "sh2", "sh3"])
def test_a_turned_function_is_one_of_the_same_basis(name):
    omega, _ = sphere_rule()
    here, turned = evaluate_basis(name, omega), evaluate_basis(name, omega @ random_rotation().T)
    mix, *_ = np.linalg.lstsq(here, turned, rcond=None)
    np.testing.assert_allclose(here @ mix, turned, atol=1e-10)


def test_the_papers_angles_are_not_closed_under_rotation():
    omega, _ = sphere_rule()
    here, turned = evaluate_basis("angles2", omega), evaluate_basis("angles2", omega @ random_rotation().T)
    mix, *_ = np.linalg.lstsq(here, turned, rcond=None)
    assert np.abs(here @ mix - turned).max() > 0.1  # why it is not the default (trap 5)


def test_every_basis_begins_with_one_and_has_its_degrees():
    omega, _ = sphere_rule()
    for name, count in BASES.items():
        functions = evaluate_basis(name, omega)
        assert functions.shape == (len(omega), count) and len(degree_of(name)) == count
        np.testing.assert_array_equal(functions[:, 0], 1.0)


def test_reach_moves_along_the_great_circle_and_not_at_all_within():
    anchors = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    reach = np.radians(10)
    angles = np.radians([0.0, 5.0, 10.0, 30.0, 44.0])
    omega = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1)
    moved, excess = within_reach(omega, anchors, reach)
    np.testing.assert_allclose(np.degrees(excess), [0, 0, 0, 20, 34], atol=1e-6)
    np.testing.assert_array_equal(moved[:2], omega[:2])
    np.testing.assert_allclose(np.degrees(np.arccos(moved[:, 2])), [0, 5, 10, 10, 10], atol=1e-6)


def test_a_light_opposite_to_all_anchors_is_still_a_direction():
    moved, excess = within_reach(np.array([[0.0, 0.0, -1.0]]), np.array([[0.0, 0.0, 1.0]]), np.radians(10))
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 1.0)
    assert moved[0, 2] >= np.cos(np.radians(10)) - 1e-12 and np.degrees(excess[0]) == pytest.approx(170)

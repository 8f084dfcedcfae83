"""The lobe's energy against its integral, and the tangent frame where it is nearly singular."""

import numpy as np
import pytest

from relight3d.maths.lafortune import lobe_base, lobe_energy, power, tangent_frame

MIRROR = np.array([-1.0, -1.0, 1.0])


@pytest.mark.parametrize("exponent", [1.0, 10.0, 1e2, 1e4])
def test_a_mirror_lobes_energy_is_its_integral_seen_from_above(exponent: float) -> None:
    """f cos = cos^(n + 1) about the normal, whose integral is 2 pi / (n + 2); from the side the horizon cuts it."""
    assert lobe_energy(MIRROR, exponent) == pytest.approx(2 * np.pi / (exponent + 2), rel=0.01)  # as it promises


@pytest.mark.parametrize("axes", [(-1.0, -1.0, 0.3), (-1.0, -0.4, 0.5), (-0.4, -1.0, 0.5), (0.7, 0.7, 0.7)])
def test_other_lobes_energy_is_the_sum_over_a_fine_hemisphere(axes: tuple[float, float, float]) -> None:
    """Off the mirror, anisotropic and retro-reflective: the largest over the same viewers, summed the plain way."""
    height, turn = np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(400) + 0.5) / 400 * 2 * np.pi)
    ring = np.sqrt(1 - height**2)
    to_light = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=-1)
    up, along = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    sums = []
    for v_z in (1.0, 0.8, 0.5, 0.25, 0.1):
        for angle in (0.0, np.pi / 4, np.pi / 2):
            side = np.sqrt(1 - v_z * v_z)
            viewer = np.broadcast_to([side * np.cos(angle), side * np.sin(angle), v_z], to_light.shape)
            base = lobe_base(np.broadcast_to(up, to_light.shape), to_light, viewer, np.array(axes), along)
            sums.append(2 * np.pi * float((power(base, 4.0) * height).mean()))
    assert lobe_energy(np.array(axes), 4.0) == pytest.approx(max(sums), rel=0.01)


def test_a_lobe_of_nothing_has_no_energy() -> None:
    assert lobe_energy(np.zeros(3), 4.0) == 0.0


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_tangents_are_a_right_handed_frame_next_to_the_poles_too(kind: type) -> None:
    rng = np.random.default_rng(0)
    normal = np.concatenate([rng.normal(size=(200, 3)), rng.normal(size=(200, 3)) * 1e-5 + (0, 0, 1)])
    normal = np.concatenate([normal, -normal, np.eye(3), -np.eye(3)])
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(kind)
    tangent, bitangent = tangent_frame(normal)
    frames = np.stack([tangent, bitangent, normal], axis=1)
    # Duff et al. (2017): as exact as the normals themselves.
    np.testing.assert_allclose(
        frames @ frames.swapaxes(1, 2), np.broadcast_to(np.eye(3), frames.shape), atol=8 * np.finfo(kind).eps
    )
    assert np.linalg.det(frames.astype(np.float64)) == pytest.approx(1.0, abs=1e-5)


def test_the_tangent_lies_along_what_is_asked_where_it_can() -> None:
    normal, along = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0]]), np.array([2.0, 0.0, 0.0])
    tangent, bitangent = tangent_frame(normal, along)
    np.testing.assert_allclose(tangent[0], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(bitangent[0], [0.0, 0.8, -0.6], atol=1e-12)
    assert np.abs(tangent[1] @ normal[1]) < 1e-12 and np.linalg.norm(tangent[1]) == pytest.approx(1.0)

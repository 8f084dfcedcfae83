"""The albedo of what no photograph shows: paint goes on behind things, a print does not."""

import numpy as np
import pytest

from relight3d.camera import Camera, look_at
from relight3d.evaluate.shapes import plane
from relight3d.maths.light_basis import GOLDEN_ANGLE
from relight3d.records import PatchMesh, ShadingPoints
from relight3d.recover.mesh import MeshOptions, prepare_mesh
from relight3d.recover.unseen import albedo_of_vertices, correlation
from relight3d.shading import points_seen, ray_scene

MEAN = np.array([[0.4, 0.4, 0.4]])


@pytest.fixture(scope="module")
def wall() -> tuple[PatchMesh, ShadingPoints, np.ndarray]:
    """A wall, its points in a picture, and which of them stand clear of a disc in its middle that hides the rest."""
    mesh = prepare_mesh(plane(2.0, 2.0, 40, 40), MeshOptions())
    pose = look_at(np.array([0.0, -0.01, 3.0]), np.zeros(3))
    camera = Camera(120, 120, 150.0, 150.0, 60.0, 60.0, world_from_camera=pose)
    points = points_seen(ray_scene(mesh), mesh, camera)
    return mesh, points, np.linalg.norm(points.position[:, :2], axis=1) > 0.45


def filled(wall, albedo: np.ndarray, is_known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the hidden vertices are, and what they are taken to be."""
    mesh, points, _ = wall
    owner, surface = np.zeros(len(mesh.faces), np.int32), np.zeros(len(points), np.int32)
    out = albedo_of_vertices(mesh, owner, owner, MEAN, points, surface, albedo.astype(np.float32), is_known)
    hidden = np.linalg.norm(mesh.centered_vertices[:, :2], axis=1) < 0.4
    return mesh.centered_vertices[hidden], out[hidden]


def test_paint_goes_on_where_it_is_hidden(wall) -> None:
    mesh, points, is_known = wall
    of = lambda place: np.where(place[:, :1] > 0.25, [[0.7, 0.6, 0.5]], [[0.1, 0.3, 0.35]])  # noqa: E731
    place, found = filled(wall, of(points.position), is_known)
    # Off the paint's edge: how that runs on behind the disc nobody knows to the pixel.
    clear = np.abs(place[:, 0] - 0.25) > 0.15
    assert clear.sum() > 100
    off = np.abs(found - of(place))[clear]
    assert np.median(off) < 0.03 and np.quantile(off, 0.9) < 0.15
    assert np.abs(MEAN - of(place))[clear].mean() > 3 * off.mean()


def test_what_does_not_resemble_itself_is_not_continued(wall) -> None:
    """Of grains the best guess is the mean; and no value leaves the range of what is seen."""
    _, points, is_known = wall
    grains = np.random.default_rng(0).uniform(0.1, 0.7, (len(points), 3))
    _, found = filled(wall, grains, is_known)
    np.testing.assert_allclose(found, np.broadcast_to(MEAN, found.shape), atol=0.08)


def test_another_panel_says_nothing(wall) -> None:
    """What is hidden is a lid of its own in the wall: the wall's paint is not its, it has the surface's mean."""
    mesh, points, _ = wall
    on_lid = (np.linalg.norm(mesh.centered_vertices[mesh.faces][:, :, :2], axis=2) < 0.5).any(axis=1)
    is_known = np.linalg.norm(points.position[:, :2], axis=1) > 0.65  # off the vertices that the lid shares
    paint = np.where(points.position[:, :1] > 0.25, [[0.7, 0.6, 0.5]], [[0.1, 0.3, 0.35]]).astype(np.float32)
    owner, surface = np.zeros(len(mesh.faces), np.int32), np.zeros(len(points), np.int32)
    found = albedo_of_vertices(mesh, owner, on_lid.astype(np.int32), MEAN, points, surface, paint, is_known)
    inside = np.linalg.norm(mesh.centered_vertices[:, :2], axis=1) < 0.4
    np.testing.assert_allclose(found[inside], np.broadcast_to(MEAN, found[inside].shape), rtol=1e-5)


def test_one_albedo_stays_one(wall) -> None:
    _, points, is_known = wall
    one = np.broadcast_to(MEAN, (len(points), 3))
    _, found = filled(wall, one, is_known)
    np.testing.assert_allclose(found, np.broadcast_to(MEAN, found.shape), rtol=1e-6)


def test_nothing_seen_is_the_surfaces_own(wall) -> None:
    _, points, _ = wall
    _, found = filled(wall, np.full((len(points), 3), 0.9), np.zeros(len(points), bool))
    np.testing.assert_allclose(found, np.broadcast_to(MEAN, found.shape), rtol=1e-6)


@pytest.mark.parametrize("length", [0.05, 0.2])
def test_the_length_of_waves_is_found(length: float) -> None:
    """The correlation of an isotropic sum of waves of one length is a Bessel function: 1 / e at 1.75 over its number."""
    rng = np.random.default_rng(1)
    place = rng.uniform(-1, 1, (4000, 2))
    turn = GOLDEN_ANGLE * np.arange(64)
    waves = np.cos(place @ np.stack([np.cos(turn), np.sin(turn)]) / length + rng.uniform(0, 2 * np.pi, 64))
    away = np.repeat(waves.sum(axis=1)[:, None], 3, axis=1)
    shared, found = correlation(place, away)
    assert shared > 0.8 and found == pytest.approx(1.75 * length, rel=0.3)
    assert correlation(10 * place, away)[1] == pytest.approx(10 * found, rel=0.01)  # whatever the unit
    noise = rng.normal(size=(4000, 3)) * away.std()
    assert correlation(place, noise) == correlation(place, np.zeros((4000, 3))) == (0.0, 0.0)
    shared, found = correlation(place, away + noise)
    assert shared == pytest.approx(0.5, abs=0.1) and found == pytest.approx(1.75 * length, rel=0.3)
    twice = correlation(np.concatenate([place, place]), np.concatenate([away, away]))
    assert twice[0] > 0.8 and twice[1] == pytest.approx(1.75 * length, rel=0.3)
    assert correlation(np.zeros((40, 2)), away[:40]) == (0.0, 0.0)

"""Who stands in for sites that no photograph tells of."""

import numpy as np
import pytest

from relight3d.evaluate.shapes import plane
from relight3d.maths.least_squares import Status
from relight3d.records import Health, Indirect, PatchMesh
from relight3d.recover import sites
from relight3d.recover.mesh import MeshOptions, prepare_mesh

MISSING = 40


def strip() -> PatchMesh:
    """A plane of many vertices."""
    return prepare_mesh(plane(1.0, 1.0, 8, 8), MeshOptions(target_faces=200))


def told(mesh: PatchMesh, light: np.ndarray) -> tuple[Indirect, Health]:
    """Constant indirect and ambient light at every vertex but one."""
    num = len(mesh.vertices)
    status = np.full(num, Status.OK, np.int8)
    status[MISSING] = Status.NO_DATA
    values = np.repeat(light[:, None].astype(np.float32), 3, axis=1)
    record = Indirect("constant", "vertex", values[:, None], values, np.array([[0.0, 0.0, 1.0]]), 0.1, 1e-6, True)
    ones = np.ones(num, np.float32)
    return record, Health("vertex", status, np.ones(num, np.int32), ones, ones)


def test_a_near_black_surface_lends_no_light() -> None:
    """What is told of its light is divided by next to nothing: it means something there alone."""
    mesh = strip()
    near = np.linalg.norm(mesh.centered_vertices - mesh.centered_vertices[MISSING], axis=1)
    is_black = near < np.sort(near)[12]
    record, health = told(mesh, np.where(is_black, 30.0, 0.5))
    albedo = np.where(is_black, 0.009, 0.4)
    filled, after = sites.fill_unseen(mesh, record, health, albedo=albedo)
    np.testing.assert_allclose(filled.coefficients[MISSING], 0.5, rtol=1e-5)
    np.testing.assert_allclose(filled.ambient[MISSING], 0.5, rtol=1e-5)
    assert after.status[MISSING] == Status.FALLBACK and (after.status[is_black] != Status.NO_DATA).all()
    # Where all is as dark, all of it tells.
    filled, _ = sites.fill_unseen(mesh, record, health, albedo=np.full(len(near), 0.009))
    assert filled.ambient[MISSING].max() > 1.0


def test_darker_surfaces_lend_less() -> None:
    """Errors in what is told of light go with one over the albedo: as far away, half the albedo counts a quarter."""
    mesh = strip()
    offset = mesh.centered_vertices - mesh.centered_vertices[MISSING]
    is_dark = offset @ np.array([0.6, 0.8, 0.0]) > 0
    record, health = told(mesh, np.where(is_dark, 2.0, 1.0))
    filled, _ = sites.fill_unseen(mesh, record, health)
    even = filled.ambient[MISSING, 0] - 1
    filled, _ = sites.fill_unseen(mesh, record, health, albedo=np.where(is_dark, 0.3, 0.6))
    assert 0.2 < even < 0.8
    assert filled.ambient[MISSING, 0] - 1 == pytest.approx(even / (even + 4 * (1 - even)), rel=1e-4)


@pytest.mark.parametrize(("own", "theirs", "wanted"), [(0.2, 0.8, 0.25), (0.8, 0.02, 1.5), (0.6, 0.5, 1.2)])
def test_light_goes_by_openness_and_is_not_scaled_up_much(own: float, theirs: float, wanted: float) -> None:
    mesh = strip()
    record, health = told(mesh, np.ones(len(mesh.vertices)))
    openness = np.full(len(mesh.vertices), theirs)
    openness[MISSING] = own
    filled, _ = sites.fill_unseen(mesh, record, health, openness)
    np.testing.assert_allclose(filled.ambient[MISSING], wanted, rtol=1e-5)


@pytest.mark.parametrize("site", ["vertex", "face", "pixel"])
def test_a_number_of_each_face_at_the_sites(site: str) -> None:
    mesh = strip()
    values = np.linspace(0.0, 1.0, len(mesh.faces))
    found = sites.of_faces(mesh, values, site)
    if site == "pixel":
        assert found is None
    elif site == "face":
        assert found is values
    else:
        at = np.array([values[(mesh.faces == v).any(axis=1)] for v in range(len(mesh.vertices))], dtype=object)
        assert all(value in of_faces for value, of_faces in zip(found, at))

"""Polygons against their areas: no cut may overlap, turn over or leave the outline."""

import numpy as np
import pytest

from relight3d.maths.polygons import triangulate


def areas_of(points, triangles):
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return np.cross(b - a, c - a)[:, 2] / 2


def in_plane(outline):
    return np.column_stack([np.array(outline, dtype=np.float64), np.zeros(len(outline))])


OUTLINES = {
    "triangle": ([(0, 0), (1, 0), (0, 1)], 0.5),
    "square": ([(0, 0), (1, 0), (1, 1), (0, 1)], 1.0),
    "arrowhead, dent first": ([(0.2, 0.2), (0, 1), (0, 0), (1, 0)], 0.2),
    "arrowhead, dent second": ([(1, 0), (0.2, 0.2), (0, 1), (0, 0)], 0.2),
    "square with a vertex on a side": ([(0, 0), (0.5, 0), (1, 0), (1, 1), (0, 1)], 1.0),
    "L": ([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 3.0),
    "comb": ([(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)], 8.0),
}


@pytest.mark.parametrize("name", OUTLINES)
@pytest.mark.parametrize("turn", [(0, 1, 2), (1, 2, 0), (2, 0, 1)], ids=["xy", "yz", "zx"])
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_triangles_cover_the_outline_once(name, turn, unit):
    outline, area = OUTLINES[name]
    points = unit * in_plane(outline)
    triangles, polygon = triangulate(points[:, turn], np.array([len(points)]))
    assert len(triangles) == len(points) - 2 and (polygon == 0).all()
    parts = areas_of(points, triangles)
    assert (parts > 0).all() and parts.sum() == pytest.approx(area * unit**2, rel=1e-12)


def test_clockwise_outlines_stay_clockwise():
    points = in_plane(OUTLINES["comb"][0][::-1])
    parts = areas_of(points, triangulate(points, np.array([len(points)]))[0])
    assert (parts < 0).all() and parts.sum() == pytest.approx(-8.0)


def test_polygons_of_mixed_size_keep_their_order():
    outlines = [OUTLINES[name][0] for name in ("square", "triangle", "L", "triangle")]
    points = np.concatenate([in_plane(outline) for outline in outlines])
    triangles, polygon = triangulate(points, np.array([4, 3, 6, 3]))
    assert polygon.tolist() == [0, 0, 1, 2, 2, 2, 2, 3]
    assert triangles[2].tolist() == [4, 5, 6]


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_hopeless_outlines_become_fans(bad):
    points = in_plane([(0, 0), (1, 1), (1, 0), (0, 1), (bad, 2)])
    triangles, _ = triangulate(points, np.array([5]))
    assert len(triangles) == 3 and set(triangles.ravel()) == {0, 1, 2, 3, 4}


def test_points_and_lines_have_no_triangles():
    triangles, polygon = triangulate(np.zeros((3, 3)), np.array([1, 2]))
    assert len(triangles) == 0 and len(polygon) == 0

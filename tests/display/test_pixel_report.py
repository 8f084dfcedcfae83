"""A looked-at pixel: what the photographs measured against what the model says."""

import numpy as np
import pytest

from relight3d.display.pixel_figure import chart_height, chart_of, pixels_of
from relight3d.display.pixel_report import inspect_pixel, inspect_subject
from relight3d.display.subject import Subject
from relight3d.errors import InputError
from relight3d.records import Capture, RelightModel
from tests.display.conftest import NUM_LIGHTS
from tests.scenes import HEIGHT, WIDTH


def pixel_of(model: RelightModel, surface: str) -> tuple[int, int]:
    """Column and row of a pixel well within a surface."""
    mine = model.pixels.points.pixel[model.pixels.surface == model.surfaces.names.index(surface)]
    rows, columns = np.divmod(mine, WIDTH)
    middle = np.argmin(np.hypot(rows - np.median(rows), columns - np.median(columns)))
    return int(columns[middle]), int(rows[middle])


def test_the_true_model_predicts_what_was_measured(subject: Subject):
    report = inspect_subject(subject, *pixel_of(subject.model, "sphere"))
    assert report.surface == "sphere" and len(report.photographs) == NUM_LIGHTS == len(report.measured)
    np.testing.assert_allclose(report.predicted, report.measured, rtol=2e-2, atol=1e-3)
    assert report.rms_error < 1e-2
    total = sum(report.terms.values())
    np.testing.assert_allclose(total, report.predicted, atol=1e-4)
    assert (np.diff(report.predicted[report.order].sum(axis=1)) < 0.05).all()  # a curve that falls


def test_a_photograph_whose_light_does_not_come_shows_no_direct_light(subject: Subject):
    report = inspect_subject(subject, *pixel_of(subject.model, "box"))
    assert not report.is_lit.all()
    assert (report.terms["direct"][~report.is_lit] == 0).all()
    assert (report.terms["direct"][report.is_lit] > 0).all()


def test_parameters_are_those_of_the_surface(subject: Subject):
    lines = dict(inspect_subject(subject, *pixel_of(subject.model, "sphere")).parameters)
    assert lines["surface"].startswith("sphere (diffuse, glossy)")
    assert lines["lobe 1"].startswith("n 30") and lines["albedo"] == "0.200 0.350 0.500"
    assert "fit: indirect" in lines and "fit: lobes" in lines
    assert "edge score" in dict(inspect_subject(subject, *pixel_of(subject.model, "mirror")).parameters)["mirror"]


def test_without_a_capture_the_model_speaks_alone(model: RelightModel):
    report = inspect_pixel(model, None, *pixel_of(model, "table"))
    assert np.isnan(report.measured).all() and np.isnan(report.rms_error)
    assert np.isfinite(report.predicted).all()


@pytest.mark.parametrize("pixel", [(-1, 0), (WIDTH, 0), (0, HEIGHT), (0, 0)])
def test_a_pixel_off_the_mesh_or_the_picture_is_refused(model: RelightModel, capture: Capture, pixel: tuple[int, int]):
    with pytest.raises(InputError, match="pixel"):
        inspect_pixel(model, capture, *pixel)


def test_it_draws_itself(subject: Subject):
    report = inspect_subject(subject, *pixel_of(subject.model, "sphere"))
    assert pixels_of(report.figure()).shape[1] > 800
    chart = chart_of(report, 320)
    assert chart.shape == (chart_height(320), 320, 3) and chart.std() > 5

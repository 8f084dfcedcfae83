"""Frames under pytest-benchmark (`make bench`), and the benchmark script with its gate; plain tests run them once."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from relight3d.relight.options import PRESETS
from relight3d.relight.relighter import Relighter
from tests.relight import models

PIPELINES = Path(__file__).parents[2] / "pipelines"
BASELINE = Path(__file__).with_name("baseline.json")


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(PIPELINES))
    import bench.cases
    import bench.measure
    import bench.report

    yield bench
    for name in [name for name in sys.modules if name.partition(".")[0] == "bench"]:
        del sys.modules[name]


@pytest.mark.parametrize("preset", PRESETS)
def test_frame(benchmark, bench, preset: str) -> None:
    relighter, count = Relighter(models.full(), options=PRESETS[preset]), iter(range(10**9))
    frame = benchmark(lambda: relighter.render([bench.measure.moving_light(next(count))]))
    assert frame.is_hit.any()


def test_new_viewpoint(benchmark) -> None:
    model = models.full()
    relighter, count = Relighter(model), iter(range(10**9))
    benchmark(lambda: relighter.set_camera(models.other_camera(model, 0.01 * (next(count) % 20 + 1))))
    assert relighter.view.is_hit.any()


def test_a_case_has_every_ratio(bench) -> None:
    model = models.full()
    case = bench.cases.run_case(model, 4000, (64, 48), 1, None)
    assert case["faces"] >= 4000
    assert all(entry["wall"] > 0 and entry["cores"] > 0 for entry in case["ratios"].values())
    assert "frame, exact" in bench.report.table(case)


def test_more_faces_show_the_same(bench) -> None:
    from bench.enlarge import with_faces

    # Without indirect light: where it is clamped at 0, a clamp at more vertices is another function.
    model = replace(models.full(), indirect=None)
    finer = with_faces(model, 2 * len(model.mesh.faces))
    before, after = (Relighter(m).render([models.SUN]).radiance for m in (model, finer))
    # Shared edges may go to the other face: a pixel or two on borders.
    assert (abs(before - after).max(axis=-1) > 1e-3 / model.exposure).mean() < 0.01


def test_the_gate_fails_what_is_slower(bench) -> None:
    baseline = json.loads(BASELINE.read_text())
    assert bench.report.gate(baseline, baseline) == []
    slower = json.loads(json.dumps(baseline))
    name = next(iter(slower[0]["ratios"]))
    slower[0]["ratios"][name]["cores"] *= 1.4
    assert len(bench.report.gate(slower, baseline)) == 1

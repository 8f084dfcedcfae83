"""Surfaces whose edges make them likely mirrors, and what the first fit says of them."""

import numpy as np
import pytest

from relight3d.records import Mirror
from relight3d.recover.mesh import MeshOptions
from relight3d.recover.mirror import EdgeTest, MirrorOptions, doubtful
from relight3d.recover.run import RecoverOptions, recover
from relight3d.shading import ray_scene
from relight3d.views import build_view
from tests.plan.models import rich_model
from tests.scenes import desk_capture

QUICK = RecoverOptions(mesh=MeshOptions(target_faces=1200), num_rounds=1, num_alternations=2, prices=False)


def kinds_of(options: RecoverOptions) -> dict[str, tuple[str, ...]]:
    model = recover(desk_capture(8, mirror=True), options, quiet=True)
    return dict(zip(model.surfaces.names, model.surfaces.kinds, strict=True))


def test_what_is_tried_and_reflects_nothing_is_no_mirror(monkeypatch: pytest.MonkeyPatch) -> None:
    """The table is as flat as the mirror, and is tried with it."""
    tried = []
    monkeypatch.setattr(EdgeTest, "passes", lambda test, _: not tried.append(test.surface))
    monkeypatch.setattr(EdgeTest, "is_sure", lambda *_: False)
    kinds = kinds_of(QUICK)
    assert len(tried) >= 2
    assert [name for name, kind in kinds.items() if "mirror" in kind] == ["mirror"]


def test_sure_edges_need_no_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(EdgeTest, "passes", lambda *_: True)
    monkeypatch.setattr(EdgeTest, "is_sure", lambda *_: True)
    assert sum("mirror" in kind for kind in kinds_of(QUICK).values()) >= 2


@pytest.mark.parametrize(
    ("score", "chance", "is_tried", "is_sure"),
    [
        (0.1, 0.0, False, False),  # hardly any of its edges
        (0.2, 0.18, False, False),  # edges, but shifted ones fit as well
        (0.2, 0.05, True, False),  # ahead of chance by enough to be sure, of too few edges
        (0.5, 0.45, True, False),  # enough edges, of which chance finds nearly as many
        (0.5, 0.3, True, True),
    ],
)
def test_edges_tell_likely_mirrors_from_sure_ones(score: float, chance: float, is_tried: bool, is_sure: bool) -> None:
    test = EdgeTest(3, score, chance, np.zeros((2, 2), bool), np.zeros((2, 2), np.float32))
    options = MirrorOptions()
    assert (test.passes(options), test.is_sure(options)) == (is_tried, is_sure)
    mirrors = tuple(
        Mirror(s, np.zeros(3), np.array([0.0, 0.0, 1.0]), np.ones(3), True, 1.0, True, score) for s in (2, 3)
    )
    assert doubtful(mirrors, [test], options) == (set() if is_sure else {3})
    assert doubtful(mirrors[:1], [test], options) == set()


def test_the_surroundings_are_told_by_pixels_that_show_nothing_else() -> None:
    """A pixel on the border of what a mirror shows, or of the mirror, would light up other viewpoints' mirrors."""
    model = rich_model()
    view = build_view(ray_scene(model.mesh), model, model.camera)
    assert model.background is not None and len(model.background.pixel)
    assert np.isin(view.miss_pixel, view.points.pixel).any()
    assert not np.isin(model.background.pixel, view.points.pixel).any()

"""Surfaces whose edges make them likely mirrors, and what the first fit says of them."""

import pytest

from relight3d.recover.mesh import MeshOptions
from relight3d.recover.mirror import EdgeTest, MirrorOptions
from relight3d.recover.run import RecoverOptions, recover
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


def test_a_mirror_tells_likely_from_sure() -> None:
    options = MirrorOptions()
    assert options.min_score < options.sure_score and options.min_lead < options.sure_lead

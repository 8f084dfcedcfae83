"""Effects that no one could see are not kept, whatever left-out photographs say of the pixels that they were fitted to."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from relight3d.io.capture import load_capture
from relight3d.records import Lobe
from relight3d.recover.rounds.light import specular_layers
from relight3d.recover.rounds.state import Evidence
from relight3d.recover.run import Clock, FirstFit, RecoverOptions, begin
from relight3d.recover.visible import visible_gain_db, visible_step_db, without_unseen

TINY = Path(__file__).resolve().parents[2] / "data" / "desk_tiny"
TABLE = 0  # glossy in truth, and large


@cache
def first() -> FirstFit:
    return begin(load_capture(TINY), RecoverOptions(), Clock(None, 9)).first


def with_lobe(strength: float, gain_db: float):
    """The first fit with a lobe on the table that left-out photographs are said to gain by."""
    stage, observed, mirrors, fitted = first()
    lobe = Lobe(np.full(3, strength), np.array([-1.0, -1.0, 1.0]), 60.0, np.zeros(3))
    lobes = tuple((lobe,) if s == TABLE else () for s in range(stage.surfaces.num_surfaces))
    evidence = {("lobes", TABLE): Evidence(gain_db, 0.4, "said so")}
    fitted = replace(fitted, lobes=lobes, evidence=evidence)
    return replace(fitted, specular=specular_layers(stage, observed, mirrors, fitted))


@pytest.mark.parametrize(("strength", "is_kept"), [(1.0, True), (1e-4, False)])
def test_a_lobe_is_kept_for_what_it_does_to_the_photographs(strength: float, is_kept: bool) -> None:
    stage, observed, mirrors, _ = first()
    kept = without_unseen(stage, observed, mirrors, with_lobe(strength, gain_db=10.0))
    assert (len(kept.lobes[TABLE]) == 1) is is_kept
    gain = kept.evidence["lobes", TABLE].gain_db
    assert (0.4 < gain < 10.0) if is_kept else (abs(gain) < 0.01)
    assert (kept.specular is not None and bool(kept.specular.any())) is is_kept


def test_a_gain_that_no_display_shows_is_none() -> None:
    assert visible_gain_db(20.0, before=1e-9) == pytest.approx(0.0, abs=1e-3)
    assert visible_gain_db(20.0, before=1.0) == pytest.approx(20.0, abs=0.01)
    # From two steps of eight bits to one: (4 + 1) / (1 + 1), in squares.
    step = (1 / 255) ** 2
    assert visible_step_db(4 * step, step) == pytest.approx(10 * np.log10(5 / 2))

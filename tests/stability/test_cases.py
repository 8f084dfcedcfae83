"""Every stability case: finite, bounded, honest, and as physics has it."""

import numpy as np
import pytest

from tests.stability.cases import CASES, GROUPS, Case
from tests.stability.harness import good_capture, good_error, good_model, held_out_error


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.group}: {case.name}")
def test_case(case: Case):
    outcome = case.check()
    assert outcome.status
    for number in (outcome.error, outcome.wanted, outcome.condition):
        assert number is None or np.isfinite(number)


def test_every_case_has_a_name_of_its_own_and_a_known_group():
    assert len({case.name for case in CASES}) == len(CASES)
    assert {case.group for case in CASES} == set(GROUPS)


def test_the_well_posed_capture_is_well_solved():
    """What all others are held against: were it bad, their ratios to it would mean nothing."""
    # 4 %: outlines and shadow borders of a 48 x 36 picture; a constant frame of the right mean would be 50 % off.
    assert good_error() < 0.05
    mean = good_capture().split("test")[0].pixels.mean()
    blind = good_model().pixels.albedo * 0 + mean
    assert blind.size and held_out_error(good_model(), good_capture()) == good_error()

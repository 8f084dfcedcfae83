"""Weights that go with brightness do not go with noise."""

from functools import cache
from pathlib import Path

import numpy as np

from relight3d.evaluate.disturb import with_noise
from relight3d.io.capture import load_capture
from relight3d.recover.rounds.alternation import dark_weights
from relight3d.recover.rounds.light import calm_radiance
from relight3d.recover.run import Clock, FirstFit, RecoverOptions, begin

TINY = Path(__file__).resolve().parents[2] / "data" / "desk_tiny"


@cache
def first(noise: float) -> FirstFit:
    capture = load_capture(TINY)
    return begin(with_noise(capture, noise) if noise else capture, RecoverOptions(), Clock(None, 9)).first


def test_weights_do_not_follow_noise() -> None:
    clean, noisy = first(0.0).observed, first(0.1)
    stage, observed = noisy.stage, noisy.observed
    known = (clean.weight > 0) & (observed.weight > 0)
    noise = (observed.radiance.mean(axis=2) - clean.radiance.mean(axis=2))[known]
    gray, floor = np.maximum(observed.radiance.mean(axis=2), 0.0), 0.05 * stage.white
    raw = ((floor / (gray + floor)) ** 2)[known]
    calm = dark_weights(stage, observed)[known]
    assert np.corrcoef(raw, noise)[0, 1] < -0.3
    assert abs(np.corrcoef(calm, noise)[0, 1]) < 0.1
    # Noise without a mean has none where weights are heard either.
    assert abs(np.average(noise, weights=calm)) < 0.3 * abs(np.average(noise, weights=raw))


def test_photographs_without_noise_are_taken_as_they_are() -> None:
    one = first(0.0)
    np.testing.assert_array_equal(calm_radiance(one.stage, one.observed), np.maximum(one.observed.radiance, 0.0))

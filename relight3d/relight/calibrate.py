"""How long a frame takes here: the measure behind prices and budgets."""

import time
from collections.abc import Iterable
from dataclasses import replace
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from relight3d.lights import DirectionalLight, Light
from relight3d.records import Frame
from relight3d.relight.work import clocks_of

if TYPE_CHECKING:
    from relight3d.relight.relighter import Relighter

NUM_FRAMES = 7  # of a calibration at least: their median counts
CALIBRATION_S = 0.2  # cheap frames are timed for so long: a burst of other work is over by then
NUM_WARM = 3  # frames that come first, which compile, and touch their memory for the first time
NUDGE = 1e-4  # of the scene, or of a direction: no shadow moves far, and none that was kept answers
_steps = cycle(range(1, 50))  # no two calibrations in a row meet each other's kept shadows


def nudged(lights: Iterable[Light], radius: float, steps: int = 1) -> list[Light]:
    """The lights a hair aside: the same picture, but no shadow kept from an earlier frame."""
    shift = NUDGE * steps * np.ones(3)
    return [
        replace(light, to_light=tuple(np.asarray(light.to_light) + shift))
        if isinstance(light, DirectionalLight)
        else light.translated(radius * shift)
        for light in lights
    ]


def frame_clocks(relighter: "Relighter") -> dict[str, float]:
    """Milliseconds of a frame by what they were spent on (work.KINDS_OF_CLOCK): of the frame of median time.

    As a user sees it whose light moves: under the model's own lights, shadows cast in every frame.
    """
    return _median_clocks(_moving_frames(relighter, NUM_FRAMES, NUM_WARM, CALIBRATION_S))


def clocks_beside(relighter: "Relighter", standard: "Relighter", standard_ms: float) -> dict[str, float]:
    """The same, brought to the minute in which the standard's frame took `standard_ms`: both are rendered in turn, so
    that what else the machine does falls on both, and the median of their ratios counts.
    """
    for each in (standard, relighter):
        _moving_frames(each, NUM_WARM, 0)
    frames, ratios = [], []
    begin = time.perf_counter()
    while len(frames) < NUM_FRAMES or time.perf_counter() - begin < CALIBRATION_S:
        ((_, beside),) = _moving_frames(standard, 1, 0)
        frames += _moving_frames(relighter, 1, 0)
        ratios.append(frames[-1][1] / beside)
    clocks = _median_clocks(frames)
    scale = float(np.median(ratios)) * standard_ms / max(sum(clocks.values()), 1e-9)
    return {name: scale * ms for name, ms in clocks.items()}


def _median_clocks(frames: list[tuple[Frame, float]]) -> dict[str, float]:
    frame, took_ms = sorted(frames, key=lambda each: each[1])[len(frames) // 2]
    clocks = clocks_of(frame.stats)
    # What no clock of the frame's own sees is as small as it is there for every setting.
    clocks["shade"] += took_ms - sum(clocks.values())
    return clocks


def frame_pair_ms(one: "Relighter", other: "Relighter", num_pairs: int) -> tuple[float, float]:
    """The median times of two relighters' frames, rendered in turn: what else the machine does falls on both."""
    times = _pair_times(one, other, num_pairs)
    return float(np.median(times[:, 0])), float(np.median(times[:, 1]))


def _pair_times(one: "Relighter", other: "Relighter", num_pairs: int) -> Float64[np.ndarray, "pair 2"]:
    if one is other:
        return np.repeat(frame_times_ms(one, num_pairs)[:, None], 2, axis=1)
    return np.array([(frame_times_ms(one, 1)[0], frame_times_ms(other, 1)[0]) for _ in range(num_pairs)])


def frame_times_ms(relighter: "Relighter", num_frames: int = NUM_FRAMES) -> Float64[np.ndarray, " frame"]:
    """Milliseconds of each frame, its light moved from the one before."""
    return np.array([took_ms for _, took_ms in _moving_frames(relighter, num_frames)])


def _moving_frames(
    relighter: "Relighter", num_frames: int, num_warm: int = 1, seconds: float = 0.0
) -> list[tuple[Frame, float]]:
    """So many frames and their milliseconds, and more until the seconds are over; those that warm up are not counted."""
    model = relighter.given_model
    lights = [each for each in model.lights if each] or [(DirectionalLight((0.3, 0.2, 1.0), 1.0),)]
    frames: list[tuple[Frame, float]] = []
    begin = time.perf_counter()
    while len(frames) < num_warm + num_frames or time.perf_counter() - begin < seconds:
        moved = nudged(lights[len(frames) % len(lights)], model.mesh.radius, next(_steps))
        start = time.perf_counter()
        frame = relighter.render(moved)
        frames.append((frame, 1e3 * (time.perf_counter() - start)))
    return frames[num_warm:]

"""How long a frame takes here: the measure behind prices and budgets."""

import time
from collections.abc import Iterable
from dataclasses import replace
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from relight3d.lights import DirectionalLight, Light

if TYPE_CHECKING:
    from relight3d.relight.relighter import Relighter

NUM_FRAMES = 5  # of a calibration: their median counts
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


def frame_ms(relighter: "Relighter", num_frames: int = NUM_FRAMES) -> float:
    """The median time of frames under the model's own lights, as a user sees it whose light moves: shadows are cast in
    every frame. The first frame, which may compile, is not counted.
    """
    return float(np.median(frame_times_ms(relighter, num_frames)))


def frame_pair_ms(one: "Relighter", other: "Relighter", num_pairs: int) -> tuple[float, float]:
    """The median times of two relighters' frames, rendered in turn: what else the machine does falls on both."""
    times = _pair_times(one, other, num_pairs)
    return float(np.median(times[:, 0])), float(np.median(times[:, 1]))


def fastest_pair_ms(one: "Relighter", other: "Relighter", num_pairs: int) -> tuple[float, float]:
    """The same, of the fastest frames: what each takes when nothing else runs."""
    times = _pair_times(one, other, num_pairs)
    return float(times[:, 0].min()), float(times[:, 1].min())


def _pair_times(one: "Relighter", other: "Relighter", num_pairs: int) -> Float64[np.ndarray, "pair 2"]:
    if one is other:
        return np.repeat(frame_times_ms(one, num_pairs)[:, None], 2, axis=1)
    return np.array([(frame_times_ms(one, 1)[0], frame_times_ms(other, 1)[0]) for _ in range(num_pairs)])


def frame_times_ms(relighter: "Relighter", num_frames: int = NUM_FRAMES) -> Float64[np.ndarray, " frame"]:
    """Milliseconds of each frame."""
    model = relighter.given_model
    lights = [each for each in model.lights if each] or [(DirectionalLight((0.3, 0.2, 1.0), 1.0),)]
    took = []
    for k in range(num_frames + 1):
        moved = nudged(lights[k % len(lights)], model.mesh.radius, next(_steps))
        start = time.perf_counter()
        relighter.render(moved)
        took.append(1e3 * (time.perf_counter() - start))
    return np.array(took[1:])

"""How cost grows: time against pixels, lights, lobes, faces and photographs, and the exponent of each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from relight3d.evaluate.study_captures import resized
from relight3d.evaluate.study_measure import Point
from relight3d.evaluate.study_settings import RECOVERY
from relight3d.lights import Light
from relight3d.records import RelightModel
from relight3d.relight.calibrate import frame_pair_ms, nudged
from relight3d.relight.options import RelightOptions
from relight3d.relight.relighter import Relighter

NUM_PAIRS = 5


@dataclass(frozen=True)
class Growth:
    """Time against one size: `exponent` b and its standard error, of time = a * size ** b over the points."""

    what: str  # "frame" or "recovery"
    against: str
    sizes: tuple[float, ...]
    times: tuple[float, ...]  # of a frame, relative or milliseconds; processor seconds of a recovery
    exponent: float
    scatter: float  # standard error of the exponent; 0 with two points

    @property
    def is_at_most_linear(self) -> bool:
        """No faster than n log n: whose own exponent is up to 1.15 between 1,000 and a million."""
        return self.exponent - 2 * self.scatter <= 1.15


def growth_of(what: str, against: str, sizes: Sequence[float | int], times: Sequence[float | int]) -> Growth:
    """The exponent by least squares on a log-log scale. At least two different sizes."""
    x, y = np.log(np.asarray(sizes, float)), np.log(np.asarray(times, float))
    assert np.ptp(x) > 0, "one size says nothing of growth"
    slope, offset = np.polyfit(x, y, 1)
    left = y - (slope * x + offset)
    scatter = float(np.sqrt(left @ left / (len(x) - 2) / np.sum((x - x.mean()) ** 2))) if len(x) > 2 else 0.0
    return Growth(what, against, tuple(map(float, sizes)), tuple(map(float, times)), float(slope), scatter)


def frame_growth(model: RelightModel) -> list[Growth]:
    """Frame time against pixels, lights and lobes, each measured in turn with the default frame."""
    default = Relighter(model, options=RelightOptions())
    lights = [light for each in model.lights for light in each]
    found = []
    cameras = [resized(model.camera, r) for r in (0.5, 0.71, 1.0, 1.41, 2.0)]
    sizes, times = [], []
    for camera in cameras:
        sizes.append(camera.num_pixels)
        times.append(_relative_ms(default, Relighter(model, camera, options=RelightOptions())))
    found.append(growth_of("frame", "pixels", sizes, times))
    if lights:
        counts = (1, 2, 4, 8, 16)
        times = [_ms_of(default, (lights * 16)[:n]) for n in counts]
        found.append(growth_of("frame", "lights", counts, times))
    if any(model.lobes):
        counts = (1, 2, 4, 8)
        first = tuple(lobes[:1] for lobes in model.lobes)
        several = [replace(model, lobes=tuple(lobes * n for lobes in first)) for n in counts]
        times = [_relative_ms(default, Relighter(m, options=RelightOptions())) for m in several]
        found.append(growth_of("frame", "lobes", counts, times))
    return found


def recovery_growth(points: Sequence[Point]) -> list[Growth]:
    """Recovery and frame time against what the recovery settings of a study varied: photographs, faces, pixels."""
    own = [p for p in points if p.family == RECOVERY and p.recovery_s is not None and p.factor != "baseline"]
    found = []
    for against, factor in (("photographs", "photographs"), ("faces", "faces"), ("pixels", "pixels")):
        some = [p for p in own if p.factor in (factor, "default")]
        sizes = [float(getattr(p, f"num_{against}") or 0) for p in some]
        if len(set(sizes)) < 2:
            continue
        times = [p.recovery_cpu_s or p.recovery_s or 0.0 for p in some]
        found.append(growth_of("recovery", against, sizes, times))
        if against == "faces":
            found.append(growth_of("frame", against, sizes, [p.frame_ms or 0.0 for p in some]))
    return found


def _relative_ms(default: Relighter, relighter: Relighter) -> float:
    """The relighter's time by the default's beside it, times the default's own: other work drops out."""
    beside, ours = frame_pair_ms(default, relighter, NUM_PAIRS)
    return ours / beside


def _ms_of(default: Relighter, lights: list[Light]) -> float:
    """A frame under several lights, by the time of a frame under one beside it."""
    import time

    ratios = []
    for k in range(NUM_PAIRS + 1):
        took = []
        for some in (lights[:1], lights):
            moved = nudged(some, default.given_model.mesh.radius, 60 + k)
            start = time.perf_counter()
            default.render(moved)
            took.append(time.perf_counter() - start)
        ratios.append(took[1] / took[0])
    return float(np.median(ratios[1:]))

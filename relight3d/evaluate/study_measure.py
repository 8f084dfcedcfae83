"""What a study measures of one setting: held-out error, seconds, milliseconds, memory and rays."""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from relight3d.evaluate.baselines import BASELINES, fit_baseline
from relight3d.evaluate.metrics import FrameMetrics, Metrics, capture_exposure, measure_frame
from relight3d.evaluate.study_captures import brought_to, resized, with_photographs
from relight3d.evaluate.study_settings import Setting
from relight3d.io.capture import read_photograph
from relight3d.records import Capture, Photograph, RelightModel
from relight3d.relight.calibrate import frame_times_ms, nudged
from relight3d.relight.options import RelightOptions
from relight3d.relight.relighter import Relighter

NUM_REPEATS = 9  # frames of each of two settings that are timed in turn


@dataclass(frozen=True)
class Point:
    """A measured setting. Times of frames are given beside those of the default, rendered in turn with it."""

    family: str
    factor: str
    name: str
    psnr_db: float
    worst_psnr_db: float
    ssim: float
    flip: float
    relative_rmse: float
    num_frames: int
    recovery_s: float | None = None
    recovery_cpu_s: float | None = None  # of all threads: what else the machine does is not in it
    recovery_mb: float | None = None  # the most that the process grew by
    frame_ms: float | None = None
    frame_low_ms: float | None = None  # quartiles of the repeats
    frame_high_ms: float | None = None
    default_ms: float | None = None  # the default's median in the same minute
    buffers_mb: float | None = None
    rays: int | None = None
    num_faces: int | None = None
    num_photographs: int | None = None
    num_pixels: int | None = None
    note: str = ""


class Judge:
    """The held-out photographs of a capture at the captured viewpoint, read once, and their exposure."""

    def __init__(self, capture: Capture, split: str = "test") -> None:
        self.capture = capture
        self.photographs = [p for p in capture.split(split) if p.camera.same_as(capture.camera)]
        self._pictures = [read_photograph(capture, p) for p in self.photographs]
        self._exposure: float | None = None

    def score(self, frames: list[tuple[np.ndarray, Bool[np.ndarray, "height width"]]]) -> Metrics:
        """Figures of frames (radiance, where it hit the mesh), one for each photograph."""
        masks = [valid & is_hit for (_, valid), (_, is_hit) in zip(self._pictures, frames)]
        if self._exposure is None:
            self._exposure = capture_exposure([picture for picture, _ in self._pictures], masks)
        figures = [
            measure_frame(p.name, radiance, picture, mask, self._exposure, p.group)
            for p, (picture, _), mask, (radiance, _) in zip(self.photographs, self._pictures, masks, frames)
        ]
        return Metrics(tuple(figures))

    def score_relighter(self, relighter: Relighter) -> Metrics:
        """Figures of a relighter; frames of another resolution are brought to the photographs'."""
        full = np.zeros((self.capture.camera.height, self.capture.camera.width), bool)
        full.ravel()[relighter.given_model.pixels.points.pixel] = True
        frames = [relighter.render(list(photograph.lights)).radiance for photograph in self.photographs]
        return self.score([(brought_to(frame, full.shape), full) for frame in frames])


def point_of(setting: Setting, metrics: Metrics, **figures) -> Point:
    mean: FrameMetrics = metrics.mean
    return Point(
        family=setting.family,
        factor=setting.factor,
        name=setting.name,
        psnr_db=mean.psnr_db,
        worst_psnr_db=metrics.worst.psnr_db,
        ssim=mean.ssim,
        flip=mean.flip,
        relative_rmse=mean.relative_rmse,
        num_frames=mean.num_frames,
        **figures,
    )


def measure_render(setting: Setting, model: RelightModel, judge: Judge, default: Relighter) -> Point:
    """A render setting of one model, timed in turn with the default."""
    options = setting.relight_options(model)
    camera = resized(model.camera, setting.resolution)
    relighter = default if setting.is_default else Relighter(model, camera=camera, options=options)
    timed = time_in_turn(default, relighter)
    metrics = judge.score_relighter(relighter)
    lights = next((each for each in model.lights if each), ())
    rays = relighter.render(nudged(lights, model.mesh.radius, 60)).stats.num_rays
    size = None if relighter._engine is None else relighter._engine.num_bytes / 1e6
    return point_of(setting, metrics, **timed, rays=rays, buffers_mb=size, num_pixels=camera.num_pixels)


def time_in_turn(default: Relighter, relighter: Relighter) -> dict[str, float]:
    """Median and quartiles of frames, and the median of the default's frames between them."""
    pairs = np.array([(frame_times_ms(default, 1)[0], frame_times_ms(relighter, 1)[0]) for _ in range(NUM_REPEATS)])
    low, median, high = np.percentile(pairs[:, 1], (25, 50, 75))
    middle = float(np.median(pairs[:, 0])) if relighter is not default else float(median)
    return {"frame_ms": float(median), "frame_low_ms": float(low), "frame_high_ms": float(high), "default_ms": middle}


def measure_recovery(setting: Setting, capture: Capture, judge: Judge) -> tuple[Point, RelightModel]:
    """A recovery with the setting's options, judged by frames of the default ones."""
    from relight3d.recover.run import recover

    capture = with_photographs(capture, setting.photographs)
    with grown_memory() as grown:
        start, start_cpu = time.perf_counter(), time.process_time()
        model = recover(capture, setting.recover_options(), quiet=True)
        seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - start_cpu
    relighter = Relighter(model, options=RelightOptions())
    metrics = judge.score_relighter(relighter)
    times = frame_times_ms(relighter, NUM_REPEATS)
    point = point_of(
        setting,
        metrics,
        recovery_s=seconds,
        recovery_cpu_s=cpu_seconds,
        recovery_mb=grown[-1] if grown else None,
        frame_ms=float(np.median(times)),
        num_faces=len(model.mesh.faces),
        num_photographs=len(capture.split("train")),
        num_pixels=capture.camera.num_pixels,
    )
    return point, model


def measure_baselines(model: RelightModel, judge: Judge, family: str) -> list[Point]:
    """PTM, harmonics and radial functions, fitted on the judge's photographs, with their own times.

    They are compared at the pixels that the model has, at half resolution too.
    """
    capture = judge.capture
    training = capture.split("train")
    is_hit = np.zeros((model.camera.height, model.camera.width), bool)
    is_hit.ravel()[model.pixels.points.pixel] = True
    if is_hit.shape[0] > capture.camera.height:
        is_hit = is_hit[::2, ::2][: capture.camera.height, : capture.camera.width]
    start = time.perf_counter()
    radiance = np.stack([_known(capture, p)[is_hit] for p in training])
    reading = time.perf_counter() - start
    points = []
    for name in BASELINES:
        start = time.perf_counter()
        baseline = fit_baseline(name, [p.lights for p in training], radiance, model.mesh.center)
        seconds = reading + time.perf_counter() - start
        frames, took = [], []
        for photograph in judge.photographs:
            start = time.perf_counter()
            image = np.zeros((*is_hit.shape, 3), np.float32)
            image[is_hit] = baseline.predict(photograph.lights)
            took.append(1e3 * (time.perf_counter() - start))
            frames.append((image, is_hit))
        setting = Setting(family, "baseline", name)
        figures = {"recovery_s": seconds, "frame_ms": float(np.median(took)), "rays": 0}
        points.append(point_of(setting, judge.score(frames), **figures, num_pixels=capture.camera.num_pixels))
    return points


def _known(capture: Capture, photograph: Photograph) -> np.ndarray:
    radiance, is_valid = read_photograph(capture, photograph)
    return np.where(is_valid[..., None], radiance, np.float32(np.nan))


@contextmanager
def grown_memory(interval_s: float = 0.02) -> Iterator[list[float]]:
    """Fills the list with the most megabytes that the process grew by in the block; empty where that is not known."""
    found: list[float] = []
    before = _resident_mb()
    if before is None:
        yield found
        return
    most, done = [before], threading.Event()

    def watch() -> None:
        while not done.wait(interval_s):
            most.append(max(most.pop(), _resident_mb() or 0.0))

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield found
    finally:
        done.set()
        watcher.join()
        found.append(max(0.0, max(most[-1], _resident_mb() or 0.0) - before))


def _resident_mb() -> float | None:
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except OSError:  # not Linux
        return None

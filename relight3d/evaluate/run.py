"""A model against the photographs that it has not seen, beside what interpolation makes of the same captures."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float32

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.evaluate.baselines import BASELINES, fit_baseline
from relight3d.evaluate.metrics import (
    FrameMetrics,
    Metrics,
    capture_exposure,
    display_values,
    measure_frame,
    psnr_db,
)
from relight3d.io.capture import read_photograph
from relight3d.records import Capture, Photograph, RelightModel

if TYPE_CHECKING:
    from relight3d.relight.relighter import Relighter

OURS = "relight3d"
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SurfaceMetrics:
    """One surface's PSNR at the captured viewpoint: the mean over frames, and the worst."""

    name: str
    kinds: tuple[str, ...]
    num_pixels: int
    psnr_db: float
    worst_psnr_db: float


@dataclass(frozen=True)
class Row:
    """One line of the table: a method over some of the frames."""

    method: str
    frames: str
    mean: FrameMetrics
    worst: FrameMetrics


@dataclass(frozen=True)
class Evaluation:
    """Figures of a model and of the baselines, over the held-out frames of a capture."""

    split: str
    exposure: float
    model: Metrics
    baselines: Mapping[str, Metrics]  # over the frames at the captured viewpoint; they can do no others
    surfaces: tuple[SurfaceMetrics, ...]

    def to_dict(self) -> dict:
        """Plain numbers and text: what `--json` prints."""
        return {
            "split": self.split,
            "exposure": self.exposure,
            "model": self.model.to_dict(),
            "baselines": {name: metrics.to_dict() for name, metrics in self.baselines.items()},
            "surfaces": [asdict(surface) for surface in self.surfaces],
        }

    def rows(self) -> list[Row]:
        """The lines of a table: all frames, each group, then every method over the frames that all can do."""
        rows = [_row(OURS, "all", self.model)]
        groups = self.model.groups
        if len(groups) > 1:
            for group in groups:
                names = [frame.name for frame in self.model.frames if frame.group == group]
                rows.append(_row(OURS, group or "no group", self.model.only(names)))
        for name, metrics in self.baselines.items():
            shared = [frame.name for frame in metrics.frames]
            if name == next(iter(self.baselines)) and len(shared) < len(self.model.frames):
                rows.append(_row(OURS, "captured view", self.model.only(shared)))
            rows.append(_row(name, "captured view", metrics))
        return rows


@dataclass(frozen=True, eq=False)
class _Shot:
    """A held-out photograph, and what the model makes of its lights; `mask` says which pixels are compared."""

    photograph: Photograph
    is_captured_view: bool
    rendered: Float32[np.ndarray, "height width 3"]
    reference: Float32[np.ndarray, "height width 3"]
    mask: Bool[np.ndarray, "height width"]


def evaluate(
    model: RelightModel,
    capture: Capture,
    split: str = "test",
    relighter_options: object | None = None,
    baselines: bool = True,
) -> Evaluation:
    """Render every photograph of a split under its own lights, and compare where both have the mesh.

    The baselines are fitted on the capture's training photographs. Raises InputError for a split without
    photographs, and for values that are not finite.
    """
    started = time.perf_counter()
    photographs = capture.split(split)
    if not photographs:
        known = sorted({photograph.split for photograph in capture.photographs})
        raise InputError("split", split, f"one of {', '.join(known)}", "no photograph has that word")
    logger.info("evaluate: %d photographs of split %r", len(photographs), split)
    shots = _render_all(model, capture, photographs, relighter_options)
    exposure = capture_exposure([shot.reference for shot in shots], [shot.mask for shot in shots])
    ours = Metrics(tuple(_measure(shot, shot.rendered, exposure) for shot in shots))
    at_captured_view = [shot for shot in shots if shot.is_captured_view]
    others = _measure_baselines(model, capture, at_captured_view, exposure) if baselines else {}
    surfaces = _measure_surfaces(model, shots, exposure)
    seconds = time.perf_counter() - started
    logger.info("evaluate: %.1f s, %.2f dB, worst %.2f dB", seconds, ours.mean.psnr_db, ours.worst.psnr_db)
    return Evaluation(split, exposure, ours, others, surfaces)


def relighters(
    model: RelightModel, *known: "Relighter", options: object | None = None
) -> "Callable[[Camera], Relighter]":
    """The model's relighter of each viewpoint that is asked for, made once, or one of the `known`."""
    # Here and not above: `import relight3d` should not pay for the kernels of rendering.
    from relight3d.relight.relighter import Relighter

    extra: dict[str, Any] = {} if options is None else {"options": options}
    made = list(known)

    def at(camera: Camera) -> Relighter:
        found = next((relighter for relighter in made if relighter.camera.same_as(camera)), None)
        if found is None:
            found = Relighter(model, camera=camera, **extra)
            made.append(found)
        return found

    return at


def _render_all(
    model: RelightModel,
    capture: Capture,
    photographs: Sequence[Photograph],
    options: object | None,
) -> list[_Shot]:
    relighter_at, shots = relighters(model, options=options), []
    for photograph in photographs:
        camera = photograph.camera
        frame = relighter_at(camera).render(list(photograph.lights))
        reference, is_valid = read_photograph(capture, photograph)
        shots.append(
            _Shot(photograph, camera.same_as(capture.camera), frame.radiance, reference, is_valid & frame.is_hit)
        )
    return shots


def _measure(shot: _Shot, got: Float32[np.ndarray, "height width 3"], exposure: float) -> FrameMetrics:
    photograph = shot.photograph
    return measure_frame(photograph.name, got, shot.reference, shot.mask, exposure, photograph.group)


def _measure_baselines(
    model: RelightModel, capture: Capture, shots: Sequence[_Shot], exposure: float
) -> dict[str, Metrics]:
    """Fit each baseline on the training photographs' pixels that any of the shots compares."""
    training = capture.split("train")
    if not shots or not any(photograph.lights for photograph in training):
        return {}
    is_asked = np.any([shot.mask for shot in shots], axis=0)
    lights = [photograph.lights for photograph in training]
    radiance = np.stack([_pixels(capture, photograph, is_asked) for photograph in training])
    figures = {}
    for name in BASELINES:
        baseline = fit_baseline(name, lights, radiance, model.mesh.center)
        frames = []
        for shot in shots:
            image = np.zeros_like(shot.reference)
            image[is_asked] = baseline.predict(shot.photograph.lights)
            frames.append(_measure(shot, image, exposure))
        figures[name] = Metrics(tuple(frames))
    return figures


def _pixels(
    capture: Capture, photograph: Photograph, is_asked: Bool[np.ndarray, "height width"]
) -> Float32[np.ndarray, "pixel 3"]:
    """A photograph's values at some pixels, NaN where it has none."""
    radiance, is_valid = read_photograph(capture, photograph)
    return np.where(is_valid[..., None], radiance, np.float32(np.nan))[is_asked]


def _measure_surfaces(model: RelightModel, shots: Sequence[_Shot], exposure: float) -> tuple[SurfaceMetrics, ...]:
    """PSNR per surface over the frames that the model's own pixels show: those of the view it was recovered from.

    The capture may be another one, with its own captured view.
    """
    shots = [shot for shot in shots if shot.photograph.camera.same_as(model.camera)]
    surface_of_pixel = np.full(model.camera.num_pixels, -1)
    surface_of_pixel[model.pixels.points.pixel] = model.pixels.surface
    figures: list[list[float]] = [[] for _ in model.surfaces.names]
    for shot in shots:
        shown, wanted = (display_values(image[shot.mask], exposure) for image in (shot.rendered, shot.reference))
        surface = surface_of_pixel[shot.mask.ravel()]
        for index in np.unique(surface[surface >= 0]):
            figures[index].append(psnr_db(shown[surface == index], wanted[surface == index]))
    num_pixels = np.bincount(model.pixels.surface, minlength=len(model.surfaces.names))
    return tuple(
        SurfaceMetrics(name, tuple(kinds), int(num), float(np.mean(each)), min(each))
        for name, kinds, num, each in zip(model.surfaces.names, model.surfaces.kinds, num_pixels, figures)
        if each
    )


def _row(method: str, frames: str, metrics: Metrics) -> Row:
    return Row(method, frames, metrics.mean, metrics.worst)

"""The parts of a report, made ready for its template: plain records of text, numbers and embedded pictures."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight3d.display.embedded import chart_address, file_address, photo_address
from relight3d.display.layers import layer_names, paint_layer
from relight3d.display.light_dome import LightDome, knob_color
from relight3d.display.pictures import Layer, Swatch, category_color
from relight3d.display.pixel_report import TERMS
from relight3d.display.subject import Subject
from relight3d.display.surface_layers import describe_lobe
from relight3d.evaluate.metrics import display_values
from relight3d.evaluate.run import Evaluation, relighters
from relight3d.io.capture import read_photograph
from relight3d.lights import Light
from relight3d.maths.color import display_u8
from relight3d.maths.least_squares import Status
from relight3d.records import Photograph, RelightModel
from relight3d.relight.plan import plan_of
from relight3d.relight.plan_lines import PlanLine

DIFFERENCE_GAIN = 8  # differences of display values are shown so many times as large
LEFT_OUT = ("relit", "photographs", "surface_albedo", "faces")  # layers that the page shows otherwise, or need not


@dataclass(frozen=True)
class Dot:
    """A light on the little dome beside a frame, in percent of its width, with its colour."""

    x: float
    y: float
    color: str


@dataclass(frozen=True)
class FramePart:
    """One photograph against the frame relit with its lights."""

    name: str
    group: str
    relit: str
    photograph: str
    difference: str
    dots: tuple[Dot, ...]
    figures: tuple[tuple[str, str], ...]
    psnr_db: float
    aspect: float


@dataclass(frozen=True)
class SurfacePart:
    """One surface: what it is, what was recovered, and which effects it gets."""

    name: str
    kinds: str
    swatch: str
    color: str
    share: float
    psnr_db: float | None
    lobes: tuple[str, ...]
    effects: tuple[tuple[str, bool, str], ...]  # name, on or off, the evidence


@dataclass(frozen=True)
class HealthPart:
    """One family of fits: how many ended in each status (word, number, percent), and how they were posed."""

    name: str
    site: str
    counts: tuple[tuple[str, int, float], ...]
    condition: str
    fallback: str


@dataclass(frozen=True)
class LayerPart:
    """A layer with its legend as HTML can draw it."""

    name: str
    title: str
    caption: str
    note: str
    picture: str
    swatches: tuple[tuple[str, str], ...]
    scale: tuple[str, str, str, str] | None  # CSS gradient, low, high, label


def frame_parts(
    model: RelightModel, subject: Subject, photographs: Sequence[Photograph], evaluation: Evaluation | None
) -> list[FramePart]:
    """The photographs with the frames relit for them, in their order."""
    assert subject.capture is not None
    exposure = model.exposure if evaluation is None else evaluation.exposure
    measured = {} if evaluation is None else {frame.name: frame for frame in evaluation.model.frames}
    dome = LightDome.of(model)
    relighter_at, parts = relighters(model, subject.relighter), []
    for photograph in photographs:
        frame = relighter_at(photograph.camera).render(list(photograph.lights))
        radiance, is_valid = read_photograph(subject.capture, photograph)
        mask = (is_valid & frame.is_hit)[..., None]
        relit, wanted = (display_values(np.where(mask, image, 0), exposure) for image in (frame.radiance, radiance))
        difference = np.clip(DIFFERENCE_GAIN * np.abs(relit - wanted), 0.0, 1.0)
        figures = measured.get(photograph.name)
        parts.append(
            FramePart(
                name=photograph.name,
                group=photograph.group.replace("_", " "),
                relit=photo_address(_u8(relit)),
                photograph=photo_address(_u8(wanted)),
                difference=photo_address(_u8(difference), 480),
                dots=tuple(_dot(dome, light) for light in photograph.lights),
                figures=()
                if figures is None
                else (
                    ("PSNR", f"{figures.psnr_db:.1f} dB"),
                    ("SSIM", f"{figures.ssim:.3f}"),
                    ("FLIP", f"{figures.flip:.3f}"),
                ),
                psnr_db=0.0 if figures is None else figures.psnr_db,
                aspect=relit.shape[1] / relit.shape[0],
            )
        )
    return parts


def surface_parts(model: RelightModel, evaluation: Evaluation | None) -> list[SurfacePart]:
    """Every surface with its share of the picture, largest first."""
    measured = {} if evaluation is None else {surface.name: surface.psnr_db for surface in evaluation.surfaces}
    count = np.bincount(model.pixels.surface, minlength=model.surfaces.num_surfaces)
    parts, lines = [], plan_of(model).lines
    for index in np.argsort(-count, kind="stable"):
        name = model.surfaces.names[index]
        effects = effect_chips(lines, int(index))
        parts.append(
            SurfacePart(
                name=name,
                kinds=", ".join(model.surfaces.kinds[index]),
                swatch=_css(display_u8(model.surface_albedo[index])),
                color=_css(category_color(int(index))),
                share=100.0 * count[index] / max(count.sum(), 1),
                psnr_db=measured.get(name),
                lobes=tuple(describe_lobe(lobe) for lobe in model.lobes[index]),
                effects=effects,
            )
        )
    return parts


def effect_chips(lines: Sequence[PlanLine], surface: int) -> tuple[tuple[str, bool, str], ...]:
    """The plan's lines of one surface (-1: of the scene) as a name, on or off, and the evidence in words."""
    chips = []
    for line in lines:
        if line.surface == surface and not line.effect.startswith("lobe "):  # single lobes have a column of their own
            gain = "" if line.gain_db is None else f" ({line.gain_db:+.2f} dB, {line.confidence})"
            chips.append((line.effect, line.is_on, f"{line.reason}{gain}"))
    return tuple(chips)


def health_parts(model: RelightModel) -> list[HealthPart]:
    """Every family of fits that the model reports on."""
    parts = []
    for name, health in model.health.items():
        total = max(len(health.status), 1)
        counts = tuple(
            (
                s.name.replace("_", " ").lower(),
                int((health.status == s).sum()),
                100.0 * float((health.status == s).mean()),
            )
            for s in Status
            if (health.status == s).any()
        )
        finite = health.condition[np.isfinite(health.condition)]
        condition = f"median {np.median(finite):.3g}, worst {finite.max():.3g}" if finite.size else "none finite"
        if finite.size < total:
            condition += f", {total - finite.size:,} open"
        parts.append(HealthPart(name, health.site, counts, condition, health.fallback))
    return parts


def layer_parts(subject: Subject) -> list[LayerPart]:
    """The layers of the model under its default lights; empty ones (a term that the plan leaves out) are not shown."""
    parts = []
    for name in layer_names(subject.model, subject.capture is not None):
        if name in LEFT_OUT:
            continue
        layer = paint_layer(subject, name)
        if layer.name in TERMS and not np.any(layer.values):
            continue
        parts.append(_layer_part(layer))
    return parts


def study_plots(folder: Path | None) -> list[tuple[str, str]]:
    """The plots in a study's folder: their names in words, and themselves embedded."""
    if folder is None or not folder.is_dir():
        return []
    kinds = {".svg": "image/svg+xml", ".png": "image/png"}
    files = sorted(path for path in folder.rglob("*") if path.suffix in kinds)
    vector = {path.stem for path in files if path.suffix == ".svg"}
    chosen = [path for path in files if path.suffix == ".svg" or path.stem not in vector]
    return [(p.stem.replace("_", " "), file_address(p.read_bytes(), kinds[p.suffix])) for p in chosen]


def _layer_part(layer: Layer) -> LayerPart:
    scale = None
    if layer.scale is not None:
        from matplotlib import colormaps

        stops = colormaps[layer.scale.colormap](np.linspace(0, 1, 9))[:, :3] * 255
        gradient = ", ".join(_css(stop) for stop in stops)
        scale = (gradient, f"{layer.scale.low:g}", f"{layer.scale.high:g}", layer.scale.label)
    return LayerPart(
        name=layer.name,
        title=layer.title,
        caption=layer.caption,
        note=layer.note,
        picture=chart_address(layer.image, 900),
        swatches=tuple(_swatch(swatch) for swatch in layer.legend),
        scale=scale,
    )


def _swatch(swatch: Swatch) -> tuple[str, str]:
    return _css(swatch.color), swatch.label


def _dot(dome: LightDome, light: Light) -> Dot:
    x, y = dome.place_on_disc(dome.direction_of(light))
    return Dot(50 + 44 * x, 50 - 44 * y, _css(knob_color(light)))


def _css(color: Iterable[int | float | np.number]) -> str:
    red, green, blue = (round(float(c)) for c in color)
    return f"rgb({red},{green},{blue})"


def _u8(values: np.ndarray) -> np.ndarray:
    return np.rint(values * 255).astype(np.uint8)

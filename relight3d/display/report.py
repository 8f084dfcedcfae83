"""The report: one HTML page about a model and its capture, which carries its own pictures and needs no network."""

import logging
import time
from pathlib import Path

import jinja2

from relight3d.display.embedded import file_address
from relight3d.display.report_parts import (
    DIFFERENCE_GAIN,
    effect_chips,
    frame_parts,
    health_parts,
    layer_parts,
    study_plots,
    surface_parts,
)
from relight3d.display.subject import Subject
from relight3d.effects import SCENE
from relight3d.errors import InputError
from relight3d.evaluate.run import Evaluation, evaluate
from relight3d.io.files import write_text
from relight3d.records import Capture, RelightModel
from relight3d.relight.plan import plan_of

FILE_NAME = "index.html"
TEMPLATES = Path(__file__).parent / "templates"
_MOST_TRAINING_FRAMES = 6  # shown where a capture holds nothing out
log = logging.getLogger("relight3d")


def report(
    model: RelightModel,
    capture: Capture,
    folder: str | Path,
    study: str | Path | None = None,
    evaluation: Evaluation | None = None,
) -> Path:
    """Write the page to `folder`/index.html and return its path.

    `study` is a study's folder whose plots are shown (by default `folder`/study, if there is one); `evaluation` spares
    evaluating again. Raises InputError for a capture of another scene, a study that is not there, or a place that cannot
    be written.
    """
    if study is not None and not Path(study).is_dir():
        raise InputError("study", f"{study} (no such folder)", "the folder of a study")
    started = time.perf_counter()
    log.info("report ...")
    path = Path(folder) / FILE_NAME
    page = render_page(model, capture, Path(folder) / "study" if study is None else Path(study), evaluation)
    write_text(path, page)
    log.info("report: %.1f s, %.1f MB", time.perf_counter() - started, len(page) / 1e6)
    return path


def render_page(
    model: RelightModel, capture: Capture, study: Path | None = None, evaluation: Evaluation | None = None
) -> str:
    """The page as text."""
    subject = Subject(model, capture)
    if len(subject.photographs) == 0:
        raise InputError("capture", "no training photograph", "the capture that the model was recovered from")
    held_out = capture.split("test")
    if held_out and evaluation is None:
        evaluation = evaluate(model, capture)
    shown = held_out or capture.split("train")[:_MOST_TRAINING_FRAMES]
    frames = frame_parts(model, subject, shown, evaluation)
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(
        title=capture.folder.name or "capture",
        model=model,
        camera=model.camera,
        evaluation=evaluation,
        is_held_out=bool(held_out),
        frames=frames,
        groups=list(dict.fromkeys(frame.group for frame in frames)),
        hero=sorted(frames, key=lambda frame: frame.psnr_db)[len(frames) // 2] if frames else None,
        rows=[] if evaluation is None else evaluation.rows(),
        summary=_summary(evaluation),
        surfaces=surface_parts(model, evaluation),
        scene_effects=effect_chips(plan_of(model).lines, SCENE),
        health=health_parts(model),
        layers=layer_parts(subject),
        plots=study_plots(study),
        gain=DIFFERENCE_GAIN,
        icon=file_address(_ICON.encode(), "image/svg+xml"),
    )


def _summary(evaluation: Evaluation | None) -> list[tuple[str, str, str]]:
    """The figures at the top: a number, its unit and what it is."""
    if evaluation is None:
        return []
    mean, worst = evaluation.model.mean, evaluation.model.worst
    figures = [
        (f"{mean.psnr_db:.1f}", "dB", f"mean of {len(evaluation.model.frames)} held-out frames"),
        (f"{worst.psnr_db:.1f}", "dB", f"worst frame, {worst.name}"),
    ]
    if evaluation.baselines:
        name, best = max(evaluation.baselines.items(), key=lambda item: item[1].mean.psnr_db)
        shared = evaluation.model.only(frame.name for frame in best.frames)
        figures.append(
            (f"{shared.mean.psnr_db - best.mean.psnr_db:+.1f}", "dB", f"over the best interpolation, {name.upper()}")
        )
    return figures


_ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16">'
    '<circle cx="8" cy="8" r="7" fill="#2b2e34"/><circle cx="10.5" cy="5.5" r="2.5" fill="#ffcf5c"/></svg>'
)

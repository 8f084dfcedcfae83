"""The rows to measure: each is one recovery of one capture, and is kept when it is done."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from accuracy.faults import with_lamp_left_on, with_saturated_pixels, without_labels, without_middle
from relight3d.evaluate.disturb import with_blocked_light, with_misplaced_mesh, with_noise
from relight3d.evaluate.run import OURS, Evaluation
from relight3d.evaluate.study_captures import with_photographs
from relight3d.io.files import write_text
from relight3d.records import Capture

SATURATED, NOISE, SHIFT_PX, FEW = 0.02, 0.05, 1.0, 8


@dataclass(frozen=True)
class Row:
    """A recovery: of the capture as `change` leaves it, with options that differ in `options` (dotted names)."""

    name: str
    words: str
    change: Callable[[Capture], Capture] = lambda capture: capture
    options: Mapping[str, Any] = field(default_factory=dict)
    needs_truth: bool = False


ROWS = (
    Row("24", "as it is"),
    Row("8", "8 photographs", partial(with_photographs, num=FEW)),
    Row("no_detail", "detail of normals and lobes", options={"detail.mode": "off"}, needs_truth=True),
    Row("no_labels", "without the mesh's labels", without_labels, needs_truth=True),
    Row("lamp", "one photograph with a second lamp on, not in its file", with_lamp_left_on),
    Row("left_out", "that photograph left out by hand", without_middle),
    Row("saturated", "2 % of pixels saturated", partial(with_saturated_pixels, share=SATURATED)),
    Row("shift", "the mesh 1 pixel beside its place", partial(with_misplaced_mesh, right_px=SHIFT_PX, down_px=0.0)),
    Row(
        "shift_left",
        "the same, and left there",
        partial(with_misplaced_mesh, right_px=SHIFT_PX, down_px=0.0),
        options={"registration.method": "off"},
    ),
    Row("noise", "noise of 5 % of white", partial(with_noise, read=NOISE)),
    Row("no_bounce", "computed light between surfaces", options={"bounce.num_rays": 0}, needs_truth=True),
    Row("no_residual", "residual", options={"residual.max_modes": 0}, needs_truth=True),
    Row("no_lobes", "lobes", options={"specular.max_lobes": 0}, needs_truth=True),
    Row(
        "blocked", "one photograph with half of the picture in an unmodelled shadow", lambda c: with_blocked_light(c, 5)
    ),
    Row("no_thrown", "light thrown by mirrors", options={"force": ("thrown=off",)}, needs_truth=True),
    Row("no_texture", "texture", options={"force": ("texture=off",)}, needs_truth=True),
)
FAULTS = ("lamp", "left_out", "blocked", "saturated", "shift", "shift_left", "noise")
RECOVERED_WITHOUT = ("no_bounce", "no_residual", "no_detail", "no_lobes", "no_thrown", "no_texture")
WORDS = {row.name: row.words for row in ROWS}

Found = dict[str, Any]  # what is kept of a row: numbers and words only


class Store:
    """Finished rows, a JSON file each, in the folder of their capture."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def read(self, row: str) -> Found | None:
        path = self.folder / f"{row}.json"
        return json.loads(path.read_text("utf-8")) if path.is_file() else None

    def write(self, row: str, found: Found) -> None:
        write_text(self.folder / f"{row}.json", json.dumps(found, indent=1))


def figures(evaluation: Evaluation, capture: Capture) -> dict[str, dict[str, float]]:
    """PSNR in dB by method and by frames: all, captured view, worst, and each group."""
    shared = {p.name for p in capture.split(evaluation.split) if p.camera.same_as(capture.camera)}
    found = {}
    for name, metrics in {OURS: evaluation.model, **evaluation.baselines}.items():
        found[name] = {group: mean.psnr_db for group, mean in metrics.groups.items()}
        found[name] |= {"all": metrics.mean.psnr_db, "worst": metrics.worst.psnr_db}
        found[name]["captured view"] = metrics.only(shared).mean.psnr_db
    return found

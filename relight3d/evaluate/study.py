"""What accuracy costs in time, on one capture: a ladder of settings measured, and the front of those worth choosing.

Settings differ from the default in one thing each; render settings share one recovered model. Every finished setting
is kept as a file, so that a stopped study goes on where it was; a time budget ends it before a setting that would not
fit, and what was left out is named.
"""

import json
import logging
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from relight3d.errors import InputError
from relight3d.evaluate.study_captures import halved
from relight3d.evaluate.study_front import COSTS, cost_of, dominated, key_of, on_one_clock
from relight3d.evaluate.study_growth import Growth, frame_growth, growth_of, recovery_growth
from relight3d.evaluate.study_measure import Judge, Point, measure_baselines, measure_recovery, measure_render
from relight3d.evaluate.study_settings import RECOVERY, RENDER, Setting, ladder
from relight3d.io.files import hash_of, read_bytes, write_json
from relight3d.io.model_file import load_model
from relight3d.records import Capture, RelightModel
from relight3d.relight.options import RelightOptions
from relight3d.relight.prices import measure_prices
from relight3d.relight.relighter import Relighter

FORMAT = 2  # of the kept measurements: another number measures anew
QUICK_BUDGET_S = 450.0
FULL = Setting(RECOVERY, "pixels", "full resolution")
Report = Callable[[str, float], None]
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Study:
    """The measured settings of a capture, what was left out, and how costs grow."""

    title: str
    points: tuple[Point, ...]
    skipped: tuple[str, ...]  # settings that the time budget left out
    growth: tuple[Growth, ...]
    seconds: float
    notes: tuple[str, ...] = ()

    def family(self, family: str) -> tuple[Point, ...]:
        """The points of "recovery" or "render", cheapest first."""
        return tuple(sorted((p for p in self.points if p.family == family), key=cost_of))

    def dominators(self) -> dict[tuple[str, str, str], str]:
        """For each point (family, factor, name) that another beats in error and cost: that one's name."""
        return {key_of(p): by for f in COSTS for p, by in zip(*dominated(self.family(f))) if by}

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    def save(self, folder: str | Path) -> Path:
        """Write CSV, Markdown, plots and the HTML page; the page's path is returned."""
        from relight3d.evaluate.study_report import write_report

        return write_report(self, Path(folder))


def study(
    capture: Capture,
    folder: str | Path | None = None,
    quick: bool = False,
    budget_s: float | None = None,
    progress: Report | None = None,
) -> Study:
    """Measure the ladder on a capture with held-out photographs at its own viewpoint, and report it into `folder`.

    The quick form has fewer settings, recovers them at half resolution, and takes QUICK_BUDGET_S at most. After
    `budget_s` nothing new is begun, and nothing that took longer than what is left. Raises InputError for a
    capture without held-out photographs, or a budget that is no time.
    """
    if not any(p.camera.same_as(capture.camera) for p in capture.split("test")):
        raise InputError("capture", 'no photograph of split "test" at the captured viewpoint', "held-out photographs")
    if budget_s is not None and not budget_s >= 0:
        raise InputError("budget_s", budget_s, "0 or more seconds")
    run = _Run(capture, None if folder is None else Path(folder), quick, budget_s, progress)
    result = run.study()
    if folder is not None:
        result.save(folder)
    return result


class _Run:
    """One study under way: its clock, its kept measurements, and the model that the render settings share."""

    def __init__(
        self, capture: Capture, folder: Path | None, quick: bool, budget_s: float | None, progress: Report | None
    ) -> None:
        self._capture, self._folder, self._quick, self._progress = capture, folder, quick, progress
        self._budget_s = budget_s if budget_s is not None else QUICK_BUDGET_S if quick else float("inf")
        self._start = time.perf_counter()
        self._key = hash_of(FORMAT, capture, quick)
        self._took: dict[str, float] = {RENDER: 0.0, RECOVERY: 0.0, "baselines": 0.0}  # the longest of each kind
        self._model: RelightModel | None = None
        self._default: Relighter | None = None
        self._judges: dict[str, Judge] = {}
        self._memory: dict[str, dict[str, Any]] = {}

    def study(self) -> Study:
        settings = ladder(len([p for p in self._capture.split("train") if p.lights]), self._quick)
        points: list[Point] = []
        skipped: list[str] = []
        for index, setting in enumerate(settings):
            self._report(f"{setting.family}, {setting.factor}: {setting.name}", index / (len(settings) + 1))
            point = self._kept(setting) or self._measured(setting)
            if point is None:
                skipped.append(f"{setting.family}, {setting.factor}: {setting.name}")
            else:
                points.append(point)
        points += self._baselines()
        points = on_one_clock(points)
        self._report("growth", len(settings) / (len(settings) + 1))
        growth = self._growth(points)
        self._report("done", 1.0)
        seconds = time.perf_counter() - self._start
        notes = ("Recovery settings are at half the capture's resolution.",) if self._halves else ()
        return Study(self._capture.folder.name or "capture", tuple(points), tuple(skipped), growth, seconds, notes)

    # ------------------------------------------------------------------------------------- settings

    def _measured(self, setting: Setting) -> Point | None:
        """The setting measured and kept; None where the time budget has no room for it."""
        if not setting.is_default and not self._has_time(setting.family):
            return None
        model = self._shared_model() if setting.family == RENDER else None
        start = time.perf_counter()
        if model is not None:
            default = self._default_relighter()
            point = measure_render(setting, model, self._judge(RENDER), default)
        else:
            point, _ = measure_recovery(setting, self._judge(RECOVERY).capture, self._judge(RECOVERY))
        took = time.perf_counter() - start
        self._took[setting.family] = max(self._took[setting.family], took)
        logger.info("study: %s, %s: %.2f dB, %.1f s", setting.factor, setting.name, point.psnr_db, took)
        self._keep(setting, asdict(point))
        return point

    def _has_time(self, kind: str) -> bool:
        return time.perf_counter() - self._start + self._took[kind] <= self._budget_s

    def _shared_model(self) -> RelightModel:
        """The default model, at full resolution; recovered once a study, and kept beside the measurements."""
        if self._model is None:
            path = self._file(f"model-{self._key}.relight")
            if path is not None and path.is_file():
                self._model = load_model(path)
            else:
                point, model = measure_recovery(self._full, self._capture, self._judge(RENDER))
                self._keep(self._full, asdict(point))
                self._model = replace(model, prices=measure_prices(model, self._capture))
                if path is not None:
                    self._model.save(path)
        return self._model

    def _default_relighter(self) -> Relighter:
        if self._default is None:
            self._default = Relighter(self._shared_model(), options=RelightOptions())
        return self._default

    @property
    def _halves(self) -> bool:
        """A quick study recovers its settings at half resolution, unless that is next to nothing."""
        return self._quick and self._capture.camera.width > 100

    @property
    def _full(self) -> Setting:
        """What the shared model's own recovery is called in the ladder."""
        return FULL if self._halves else Setting(RECOVERY, "default", "default")

    def _judge(self, family: str) -> Judge:
        key = RECOVERY if family == RECOVERY and self._halves else RENDER
        if key not in self._judges:
            self._judges[key] = Judge(halved(self._capture) if key == RECOVERY else self._capture)
        return self._judges[key]

    def _baselines(self) -> list[Point]:
        points = []
        for family in (RENDER, RECOVERY):
            setting = Setting(family, "baseline", "all")
            kept = self._read(setting)
            if kept is None and self._has_time("baselines"):
                found = measure_baselines(self._shared_model(), self._judge(family), family)
                kept = {"points": [asdict(p) for p in found]}
                self._keep(setting, kept)
            points += [Point(**p) for p in kept["points"]] if kept else []
        return points

    def _growth(self, points: list[Point]) -> tuple[Growth, ...]:
        setting = Setting(RENDER, "growth", "all")
        kept = self._read(setting)
        if kept is not None:
            frames = [growth_of(g["what"], g["against"], g["sizes"], g["times"]) for g in kept["growth"]]
        else:
            frames = frame_growth(self._shared_model()) if self._has_time(RENDER) else []
            if frames:
                self._keep(setting, {"growth": [asdict(g) for g in frames]})
        full = self._kept(FULL) if self._halves else None
        return (*frames, *recovery_growth([*points, full] if full is not None else points))

    # ------------------------------------------------------------------------------------- kept files

    def _file(self, name: str) -> Path | None:
        return None if self._folder is None else self._folder / "settings" / name

    def _keep(self, setting: Setting, value: dict[str, Any]) -> None:
        name = f"{hash_of(self._key, setting)}.json"
        self._memory[name], path = value, self._file(name)
        if path is not None:
            write_json(path, value)

    def _read(self, setting: Setting) -> dict[str, Any] | None:
        name = f"{hash_of(self._key, setting)}.json"
        path = self._file(name)
        if name not in self._memory and path is not None and path.is_file():
            with suppress(ValueError):  # spoilt by a disk, or by hand: it is measured anew
                self._memory[name] = json.loads(read_bytes(path))
        return self._memory.get(name)

    def _kept(self, setting: Setting) -> Point | None:
        value = self._read(setting)
        return None if value is None else Point(**value)

    def _report(self, what: str, fraction: float) -> None:
        if self._progress is not None:
            self._progress(what, fraction)

"""A study as files: a table (CSV, Markdown), its plots, and one page that a person can read on its own."""

import csv
import io
from dataclasses import asdict, fields
from pathlib import Path

from relight3d.evaluate.study import Study
from relight3d.evaluate.study_front import cost_of, key_of
from relight3d.evaluate.study_measure import Point
from relight3d.evaluate.study_plots import error_plot, growth_plot, price_plot
from relight3d.evaluate.study_settings import RECOVERY, RENDER
from relight3d.io.files import write_json, write_text

COLUMNS = ("what", "setting", "PSNR dB", "worst", "SSIM", "FLIP", "cost", "quartiles", "MB", "rays", "dominated by")
FRONT = "— (on the front)"
TITLES = {RENDER: "Frames: one model, rendered with other settings", RECOVERY: "Recovery: other settings of the fits"}
PLOTS = {
    "error_frame": lambda study: error_plot(study, RENDER),
    "error_recovery": lambda study: error_plot(study, RECOVERY),
    "price_frame": lambda study: price_plot(study, RENDER),
    "price_recovery": lambda study: price_plot(study, RECOVERY),
    "growth": lambda study: growth_plot(study.growth),
}


def write_report(study: Study, folder: Path) -> Path:
    """study.json, study.csv, study.md, plots/*.svg and study.html; the page's path is returned."""
    plots = {name: make(study) for name, make in PLOTS.items()}
    write_json(folder / "study.json", study.to_dict())
    write_text(folder / "study.csv", csv_of(study))
    write_text(folder / "study.md", markdown_of(study))
    for name, svg in plots.items():
        if svg:
            write_text(folder / "plots" / f"{name}.svg", '<?xml version="1.0" encoding="utf-8"?>\n' + svg)
    write_text(folder / "study.html", page_of(study, plots))
    return folder / "study.html"


def csv_of(study: Study) -> str:
    """Every figure of every point, and what dominates it."""
    stream, names = io.StringIO(), [f.name for f in fields(Point)]
    by = study.dominators()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*names, "dominated_by"])
    for point in study.points:
        writer.writerow([*asdict(point).values(), by.get(key_of(point), "")])
    return stream.getvalue()


def cells_of(study: Study, family: str) -> list[tuple[str, ...]]:
    """Cells under COLUMNS, most accurate first."""
    by = study.dominators()
    points = sorted(study.family(family), key=lambda p: -p.psnr_db)
    return [_cells(p, by.get(key_of(p), "")) for p in points]


def markdown_of(study: Study) -> str:
    """The same tables, with what was left out and how costs grow."""
    lines = [f"# Study of {study.title}", "", summary_of(study), *study.notes, ""]
    for family, title in TITLES.items():
        rule = ["---"] * 2 + ["---:"] * (len(COLUMNS) - 3) + ["---"]
        lines += [f"## {title}", "", *("| " + " | ".join(row) + " |" for row in (COLUMNS, rule))]
        lines += ["| " + " | ".join(row) + " |" for row in cells_of(study, family)] + [""]
    lines += ["## Growth", "", *(f"- {line}" for line in growth_lines(study)), ""]
    if study.skipped:
        lines += ["## Left out by the time budget", "", *(f"- {name}" for name in study.skipped), ""]
    return "\n".join(lines)


def summary_of(study: Study) -> str:
    """What a reader in haste takes home."""
    parts = []
    for family, unit in ((RENDER, "ms a frame"), (RECOVERY, "s of recovery")):
        points, by = study.family(family), study.dominators()
        front = [p for p in points if key_of(p) not in by and p.factor != "baseline"]
        default = next((p for p in points if p.factor == "default"), None)
        if default is None or not front:
            continue
        cheap = [p for p in front if p.psnr_db >= default.psnr_db - 0.5]
        text = f"The default reaches {default.psnr_db:.1f} dB at {cost_of(default):.3g} {unit}"
        if cheap and cost_of(cheap[0]) < 0.97 * cost_of(default):
            text += f"; within 0.5 dB of it, {_name(cheap[0])} needs {cost_of(cheap[0]):.3g}"
        parts.append(text + ".")
    best = max((p for p in study.points if p.factor == "baseline"), key=lambda p: p.psnr_db, default=None)
    if best is not None:
        parts.append(f"The best interpolation of the photographs, {best.name}, reaches {best.psnr_db:.1f} dB.")
    return " ".join(parts)


def growth_lines(study: Study) -> list[str]:
    """Exponents in words."""
    return [
        f"{g.what} time grows as {g.against} to the power {g.exponent:.2f} ± {g.scatter:.2f} ({len(g.sizes)} sizes, "
        f"{min(g.sizes):,.0f} to {max(g.sizes):,.0f}): " + ("at most n log n" if g.is_at_most_linear else "faster")
        for g in study.growth
    ]


def page_of(study: Study, plots: dict[str, str]) -> str:
    """One HTML page without any other file."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(loader=PackageLoader("relight3d.evaluate"), autoescape=True, trim_blocks=True)
    families = [
        (title, plots["error_" + key], plots["price_" + key], cells_of(study, family))
        for (family, title), key in zip(TITLES.items(), ("frame", "recovery"))
    ]
    return environment.get_template("study.html.jinja").render(
        study=study,
        summary=summary_of(study),
        families=families,
        columns=COLUMNS,
        front=FRONT,
        growth=growth_lines(study),
        growth_plot=plots["growth"],
    )


def _cells(p: Point, by: str) -> tuple[str, ...]:
    is_frame = p.family == RENDER
    spread = f"{p.frame_low_ms:.1f} to {p.frame_high_ms:.1f}" if is_frame and p.frame_low_ms else ""
    memory = p.buffers_mb if is_frame else p.recovery_mb
    verdict = by or FRONT
    return (
        p.factor,
        p.name,
        f"{p.psnr_db:.2f}",
        f"{p.worst_psnr_db:.2f}",
        f"{p.ssim:.4f}",
        f"{p.flip:.4f}",
        f"{cost_of(p):.1f} " + ("ms" if is_frame else "s"),
        spread,
        "" if memory is None else f"{memory:.0f}",
        "" if p.rays is None else f"{p.rays:,}",
        verdict,
    )


def _name(point: Point) -> str:
    return point.name if point.factor == "combined" else f"{point.factor}: {point.name}"

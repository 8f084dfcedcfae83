"""Plots and tables of the degradation curves, from their CSV file."""

import csv
from itertools import pairwise
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from stability.curves import CURVES
from stability.sections import table, write_section

Point = tuple[float, int, float]  # value, number of training photographs, mean PSNR in dB
CLIFF_DB = 6.0  # between neighbouring points of a curve
# The reason of each cliff ("capture curve step"), kept by hand: what was found when the models on both sides of it were
# compared. A step that is not here is shown as unexplained.
ONE_LIGHT = "Within the smaller angle lies one light only: this is the curve of one photograph."
WHY = {
    "desk photographs 4 to 3": """\
With 4 photographs the lobe of one surface is found, with 3 left-out photographs gain 0.0 dB by it. With 4 and that lobe
switched off 24.8 dB remain; with 3 and it forced on it is 29.6.""",
    "desk clustering 30 to 20": ONE_LIGHT,
    "diligent_cat photographs 3 to 2": """\
The residual (the misfit carried over) needs 3 photographs; with 3 but without it, 31.3 dB remain. With 2, ambient light is
found that costs 1.0 dB (forced off 28.0). That leaves 3.3 dB, unexplained.""",
    "diligent_cat clustering 20 to 12": ONE_LIGHT,
    "desk misregistration 4 to 8": """\
Up to 4 pixels the mesh is moved back to its place. Eight, of a hundred, are further than anything looks alike here.""",
}


def read(path: Path) -> dict[tuple[str, str], list[Point]]:
    """The points of each curve of each capture, in the curve's order; nothing where there is no file yet."""
    curves: dict[tuple[str, str], list[Point]] = {}
    if path.exists():
        with open(path, newline="") as file:
            for name, curve, value, photographs, _, psnr in csv.reader(file):
                curves.setdefault((name, curve), []).append((float(value), int(photographs), float(psnr)))
    for (_, curve), points in curves.items():
        points.sort(key=lambda point: CURVES[curve][1].index(point[0]))
    return curves


def draw(path: Path, folder: Path) -> None:
    """One picture a curve, all captures in it."""
    curves = read(path)
    for curve, (label, values, _) in CURVES.items():
        figure, axes = plt.subplots(figsize=(5, 3.2), constrained_layout=True)
        for name, points in [(name, points) for (name, which), points in curves.items() if which == curve]:
            axes.plot([values.index(point[0]) for point in points], [point[2] for point in points], "o-", label=name)
        axes.set_xticks(range(len(values)), [f"{value:g}" for value in values])
        axes.set_xlabel(label)
        axes.set_ylabel("mean PSNR, dB")
        axes.grid(alpha=0.3)
        axes.legend()
        figure.savefig(folder / f"degradation_{curve}.png", dpi=110)
        plt.close(figure)


def cliffs(points: list[Point]) -> list[tuple[str, float]]:
    """Neighbours that differ by more than the limit: which, and by how many dB."""
    steps = [(f"{a[0]:g} to {b[0]:g}", a[2] - b[2]) for a, b in pairwise(points)]
    return [(name, step) for name, step in steps if abs(step) > CLIFF_DB]


def widths(path: Path) -> str:
    """To what width each capture was averaged down."""
    with open(path, newline="") as file:
        found = {(row[0], int(row[4])) for row in csv.reader(file)}
    return ", ".join(f"{name} to {width} pixels' width" for name, width in sorted(found))


def write_page(path: Path, captures: list[Path], faces: int) -> None:
    """The section of docs/stability.md."""
    curves, names = read(path), " ".join(str(folder) for folder in captures)
    text = ["## How the error grows", "", f"`python pipelines/degradation.py {names}`: mean PSNR of the held-out"]
    text += [f"frames; photographs averaged down ({widths(path)}), meshes split"]
    text += [f"until they have {faces:,} faces, if they have fewer. The figures are in"]
    text += ["[degradation.csv](degradation.csv) (capture, curve, value, photographs, width in pixels, dB).", ""]
    for curve, (label, values, _) in CURVES.items():
        here = {name: points for (name, which), points in curves.items() if which == curve}
        found = {name: {point[0]: f"{point[2]:.1f}" for point in points} for name, points in here.items()}
        rows = [[name, *(each.get(value, "") for value in values)] for name, each in found.items()]
        text += [f"### {curve.capitalize()}", "", f"![{label}](images/degradation_{curve}.png)", ""]
        text += [table([label, *(f"{value:g}" for value in values)], rows), ""]
        missing = [f"{name} {value:g}" for name, each in found.items() for value in values if value not in each]
        text += [f"Not measured: {', '.join(missing)}.", ""] if missing else []
        steps = [(name, *step) for name, points in here.items() for step in cliffs(points)]
        text += [
            f"Above {CLIFF_DB:g} dB in {name}, {step}: {size:.1f} dB. {WHY.get(f'{name} {curve} {step}', 'Unexplained.')}\n"
            for name, step, size in steps
        ]
        text += [] if steps else [f"No step above {CLIFF_DB:g} dB.", ""]
    write_section("degradation", "\n".join(text))

"""What a capture holds, before anything is recovered: lights, exposure, masks, mesh, and what of it is doubtful.

    python pipelines/inspect_capture.py data/desk
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from start import start

from relight3d.commands.tables import terminal_table
from relight3d.io.capture import load_capture, read_photograph
from relight3d.maths.color import exposure_of, luminance
from relight3d.progress import remark, say, show
from relight3d.records import Capture, Photograph
from relight3d.recover.conventions import doubts_of

CAPTURE = Path("data/desk")
COLUMNS = ("photograph", "split", "lights", "power", "angle to mean", "valid %", "median", "white")


def main(capture: Annotated[Path, tyro.conf.Positional] = CAPTURE) -> None:
    read = load_capture(capture)
    center = (read.mesh.vertices.min(axis=0) + read.mesh.vertices.max(axis=0)) / 2
    axis = mean_direction(read, center)
    rows = [row(read, photograph, center, axis) for photograph in read.photographs]
    show(terminal_table(f"{capture}: {len(rows)} photographs", COLUMNS, rows))
    camera, mesh = read.camera, read.mesh
    extent = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    labels = 0 if mesh.object_id is None else len(np.unique(mesh.object_id))
    say(f"camera: {camera.width} x {camera.height} pixels, focal length {camera.fx:.1f}; {read.color_space} images")
    counts = f"{len(mesh.vertices)} vertices, {len(mesh.faces)} faces, {labels} labels"
    say(f"mesh: {counts}, {extent:.4g} {read.unit} across")
    for line in doubts_of(read):
        remark(f"warning: {line}")


def mean_direction(capture: Capture, center: np.ndarray) -> np.ndarray:
    """The mean direction of the training lights, from the middle of the mesh."""
    lights = [light for photograph in capture.split("train") for light in photograph.lights]
    total = sum((light.incident(center[None]).to_light[0] for light in lights), np.zeros(3))
    return total / max(np.linalg.norm(total), 1e-9)


def row(capture: Capture, photograph: Photograph, center: np.ndarray, axis: np.ndarray) -> tuple[str, ...]:
    """One line of the table."""
    radiance, is_valid = read_photograph(capture, photograph)
    values = luminance(radiance[is_valid])
    ways = [light.incident(center[None]).to_light[0] for light in photograph.lights]
    angles = " ".join(f"{np.degrees(np.arccos(np.clip(way @ axis, -1, 1))):.0f}°" for way in ways)
    kinds = " ".join(light.kind for light in photograph.lights) or "off"
    power = " ".join(f"{float(luminance(light.power)):.3g}" for light in photograph.lights)
    figures = (f"{100 * is_valid.mean():.1f}", f"{np.median(values):.4g}", f"{1 / exposure_of(values):.4g}")
    return (photograph.name, photograph.split, kinds, power, angles, *figures)


if __name__ == "__main__":
    start(main, __doc__)

"""relight3d recover: from a capture to a model file."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

import relight3d
from relight3d.commands.command import CapturePath, Command, require_writable
from relight3d.io.capture import load_capture
from relight3d.maths.least_squares import Status
from relight3d.progress import remark, say, stage_bar
from relight3d.records import RelightModel
from relight3d.recover.run import RecoverOptions


@dataclass(frozen=True)
class Recover(Command):
    """Recover a model from a capture: a folder with transforms.json, photographs and a mesh."""

    capture: CapturePath
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="MODEL")]  # the model file to write
    options: Annotated[RecoverOptions, tyro.conf.arg(name="")] = field(default_factory=RecoverOptions)

    def run(self) -> None:
        recover_to(self.output, self.capture, self.options, self.hides_bar)


def recover_to(path: Path, capture: Path, options: RecoverOptions, hides_bar: bool) -> RelightModel:
    """Recover a capture, write the model file, and say what came of it."""
    require_writable(path)
    with stage_bar("recover", hides_bar) as report:
        model = relight3d.recover(load_capture(capture), options, progress=report)
    model.save(path)
    for warning in model.warnings:
        remark(f"warning: {warning}")
    counts = f"{model.surfaces.num_surfaces} surfaces, {len(model.mesh.faces)} faces, {len(model.lights)} photographs"
    cost = f"{sum(model.seconds.values()):.1f} s, {path.stat().st_size / 1e6:.1f} MB"
    say(f"{path}: {counts}; {cost}")
    say(f"solves: {health_line(model)}")
    return model


def health_line(model: RelightModel) -> str:
    """How many solves of each family ended in each status, as "indirect: 812 ok, 12 no data; albedo: 7 ok"."""
    families = []
    for name, health in model.health.items():
        counts = [(int((health.status == status).sum()), status.name.lower().replace("_", " ")) for status in Status]
        families.append(f"{name}: " + ", ".join(f"{count} {word}" for count, word in counts if count))
    return "; ".join(families) or "none"

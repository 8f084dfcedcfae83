"""One row measured: recover, evaluate, and what else its name asks for."""

import logging
from dataclasses import replace
from pathlib import Path

import relight3d
from accuracy.ablation import ablation
from accuracy.frames import shots_of, truth_of
from accuracy.measure import albedo, kinds, mirror, places
from accuracy.relief import Relief
from accuracy.rows import RECOVERED_WITHOUT, Found, Row, figures
from relight3d.evaluate.study_settings import changed
from relight3d.io.stage_file import kept, library_hash
from relight3d.records import Capture, RelightModel
from relight3d.recover.run import RecoverOptions

PICTURE = "detail.png"


def measure(row: Row, capture: Capture, options: RecoverOptions, work: Path, images: Path) -> Found:
    """The figures of a row; the picture of detail is left in `images` by the row without it."""
    read, truth = row.change(capture), truth_of(capture.folder)
    model = recovered(row, read, options, work)
    evaluation = relight3d.evaluate(model, read, baselines=row.name not in RECOVERED_WITHOUT)
    exposure = evaluation.exposure
    found: Found = {
        "code": library_hash(),
        "seconds": sum(model.seconds.values()),
        "photographs": sum(1 for p in read.split("train") if p.lights),
        "psnr": figures(evaluation, read),
        "exposure": exposure,
        "lobes": {name: len(lobes) for name, lobes in zip(model.surfaces.names, model.lobes)},
        "warnings": list(model.warnings),
    }
    if truth is not None and row.name in ("24", "8", "no_labels"):
        found |= {"kinds": kinds(model, truth), "albedo": albedo(model, truth)}
    if row.name in ("24", "8"):
        shots = shots_of(read, model)
        single = [shot for shot in shots if len(shot.lights) == 1]
        found["places"] = places(model, read, single, exposure)
        if truth is not None and truth.of_kind("mirror").any():
            found["mirror"] = mirror(model, read, single, truth, exposure)
        if row.name == "24":
            found["ablation"] = ablation(model, shots, exposure)
    if row.name == "no_detail" and truth is not None:
        detailed = recovered(Row("24", ""), capture, options, work)
        relief = Relief(model, detailed, shots_of(read, model), truth, exposure)
        found["relief"] = relief.errors() | {"shown": relief.picture(images / PICTURE)}
        found["relief"]["evidence"] = [d.reason for d in detailed.decisions if d.effect == "detail" and d.is_on]
    return found


def recovered(row: Row, capture: Capture, options: RecoverOptions, work: Path) -> RelightModel:
    """The row's model, kept until capture, options or code change."""
    options = changed(replace(options, prices=False), row.options)
    path = work / f"{row.name}.npz"
    logging.getLogger("relight3d").info("accuracy: %s", path)
    return kept(path, lambda: relight3d.recover(capture, options, quiet=True), capture, options)

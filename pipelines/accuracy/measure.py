"""What is measured of a recovered model beside its PSNR: kinds, albedo, the mirror's image, where the error is."""

import numpy as np
from scipy import ndimage

from accuracy.frames import Shot, Truth, baseline_frames
from accuracy.rows import Found
from relight3d.evaluate.baselines import BASELINES
from relight3d.evaluate.metrics import display_values, psnr_db
from relight3d.evaluate.run import OURS
from relight3d.records import Capture, Frame, RelightModel
from relight3d.relight.relighter import Relighter

BORDER_PX = 2  # a pixel this near to a shadow's edge is one of its border
STRONG = 0.5  # the share of a pixel's radiance that makes it a highlight


def kinds(model: RelightModel, truth: Truth) -> list[Found]:
    """For each true surface: what the regions that cover it were taken for, and at how many of its pixels rightly."""
    label, found = truth.label.ravel()[model.pixels.points.pixel], []
    for key, given in truth.surfaces.items():
        regions, counts = np.unique(model.pixels.surface[label == key], return_counts=True)
        if not len(regions):
            continue
        named = [model.surfaces.kinds[region] for region in regions]
        right = sum(count for words, count in zip(named, counts) if set(words) == {given["kind"]})
        most = ", ".join(named[int(np.argmax(counts))])
        share = float(right / counts.sum())
        # A region that reaches over a surface's rim by a few pixels is no piece of that surface.
        num = int((counts > 0.02 * counts.sum()).sum())
        found.append({"name": given["name"], "kind": given["kind"], "found": most, "share": share, "regions": num})
    return found


def albedo(model: RelightModel, truth: Truth) -> list[Found]:
    """Relative errors of each surface's albedo and of its pixels', the mirror left out (it has none)."""
    pixel, found = model.pixels.points.pixel, []
    label, true = truth.label.ravel()[pixel], truth.albedo.reshape(-1, 3)[pixel]
    for key, given in truth.surfaces.items():
        mine = label == key
        if given["kind"] == "mirror" or not mine.any():
            continue
        wanted = true[mine].mean(axis=0)
        surface = model.surface_albedo[model.pixels.surface[mine]].mean(axis=0)
        pixels = np.abs(model.pixels.albedo[mine] / true[mine] - 1)
        found.append(
            {
                "name": given["name"],
                "kind": given["kind"],
                "surface": float(np.abs(surface / wanted - 1).mean()),
                "median": float(np.median(pixels)),
                "most": float(np.quantile(pixels, 0.9)),
            }
        )
    return found


def mirror(model: RelightModel, capture: Capture, shots: list[Shot], truth: Truth, exposure: float) -> Found:
    """PSNR at the mirror's pixels, of the model and of each baseline: the mean over the shots."""
    asked = truth.of_kind("mirror")
    frames = {OURS: _render(model, shots)}
    frames |= {name: baseline_frames(name, capture, model, shots, asked) for name in BASELINES}
    return {
        name: _mean_psnr(each, shots, [asked & shot.mask for shot in shots], exposure) for name, each in frames.items()
    }


def places(model: RelightModel, capture: Capture, shots: list[Shot], exposure: float) -> dict[str, Found]:
    """PSNR of the model and of RBF by kind of pixel, and the kind's share of the pixels and of the squared error."""
    relighter, ours, masks = Relighter(model), [], []
    for shot in shots:
        frame = relighter.render(list(shot.lights))
        ours.append(frame.radiance)
        masks.append(classes(frame, shot.mask))
    anywhere = np.any([shot.mask for shot in shots], axis=0)
    others = baseline_frames("rbf", capture, model, shots, anywhere)
    missed = [(display_values(f, exposure) - display_values(s.wanted, exposure)) ** 2 for f, s in zip(ours, shots)]
    total = sum(float(each[shot.mask].sum()) for each, shot in zip(missed, shots))
    found = {}
    for name in masks[0]:
        own = [mask[name] for mask in masks]
        if any(mask.any() for mask in own):
            found[name] = {
                "pixels": float(np.mean([mask.sum() / shot.mask.sum() for mask, shot in zip(own, shots)])),
                "error": sum(float(each[mask].sum()) for each, mask in zip(missed, own)) / total,
                OURS: _mean_psnr(ours, shots, own, exposure),
                "rbf": _mean_psnr(others, shots, own, exposure),
            }
    return found


def classes(frame: Frame, mask: np.ndarray) -> dict[str, np.ndarray]:
    """Every pixel of the mask in one class: on a shadow's border, in a highlight, lit, or in shadow or a mirror."""
    direct, specular = (
        0 * frame.radiance if term is None else term for term in (frame.terms.direct, frame.terms.specular)
    )
    seen = direct.max(axis=-1) > 0
    strong = (specular.mean(axis=-1) > STRONG * frame.radiance.mean(axis=-1)) & mask
    near = {"lit": _grown(seen & mask), "dark": _grown(~seen & mask)}
    border = near["lit"] & near["dark"] & mask
    found = {"shadow borders and attached shadows": border, "highlights": strong & mask & ~border}
    rest = mask & ~border & ~found["highlights"]
    return found | {"lit, no highlight": rest & seen, "no direct light": rest & ~seen}


def _grown(mask: np.ndarray) -> np.ndarray:
    return ndimage.binary_dilation(mask, iterations=BORDER_PX)


def _render(model: RelightModel, shots: list[Shot]) -> list[np.ndarray]:
    relighter = Relighter(model)
    return [relighter.render(list(shot.lights)).radiance for shot in shots]


def _mean_psnr(frames: list[np.ndarray], shots: list[Shot], masks: list[np.ndarray], exposure: float) -> float:
    """The mean over the shots in which the mask has a pixel."""
    each = [
        psnr_db(display_values(frame[mask], exposure), display_values(shot.wanted[mask], exposure))
        for frame, shot, mask in zip(frames, shots, masks)
        if mask.any()
    ]
    return float(np.mean(each))

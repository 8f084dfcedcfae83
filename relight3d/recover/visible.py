"""What a person could see of each effect: a gain between two errors that no display shows is no reason to have it.

Left-out photographs say by which factor an effect lowers the error. Here that factor is set against what the error is
on a display: with a just visible error added before and after, in squared display values,

    gain = 10 log10((before + JUST_VISIBLE) / (before / factor + JUST_VISIBLE)).

`before` is the error of the photographs that were fitted, without the effect. No effect of a surface gains more than what
these lose when it is taken out. What then gains no more than its noise is dropped, unless a person forces it on.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32

from relight3d.effects import SCENE
from relight3d.maths.color import srgb_from_linear
from relight3d.records import Mirror, Observations
from relight3d.recover.rounds.light import direct_irradiance, specular_layers
from relight3d.recover.rounds.state import Evidence, Fitted, Stage

NUM_SAMPLES = 4000  # points of a surface by which an error is told
JUST_VISIBLE = (1 / 255) ** 2  # of white, squared: a step of eight bits


def visible_gain_db(gain_db: float, before: float) -> float:
    """The gain as far as a display shows it; `before` is the mean square of display values without the effect.

    Nothing visible gains nothing, and no gain is made larger.
    """
    return visible_step_db(before, before * 10 ** (-gain_db / 10))


def visible_step_db(before: float, after: float) -> float:
    """By how many dB a mean square of display values fell, as far as one sees it."""
    return float(10 * np.log10((before + JUST_VISIBLE) / (after + JUST_VISIBLE)))


def display_error(stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> float:
    """Mean square of display values by which the fits miss the photographs, clear of borders, outlines and mirrors."""
    direct, total, count = direct_irradiance(stage, observed, mirrors, fitted), 0.0, 0
    some = _some_of_each(stage.surface, stage.surfaces.num_surfaces)
    some = some[stage.is_matte[some] & observed.is_interior[some]]
    for photo in range(len(fitted.irradiance)):
        chosen = some[observed.is_safe[photo, some] & (observed.weight[photo, some] > 0)]
        radiance = fitted.albedo[chosen] / np.float32(np.pi) * (direct[photo] + fitted.irradiance[photo])[chosen]
        radiance = radiance if fitted.specular is None else radiance + fitted.specular[photo, chosen]
        miss = displayed(radiance, stage.white) - displayed(observed.radiance[photo, chosen], stage.white)
        total, count = total + float((miss.astype(np.float64) ** 2).sum()), count + miss.size
    return total / max(count, 1)


def needed_db(stage: Stage, effect: str, evidence: Evidence) -> float:
    """What an effect must gain: its threshold in the Options, and a texture three times its own noise.

    Errors of the mesh's normals stay where they are from photograph to photograph, and look like texture.
    """
    return max(stage.options.texture.min_gain_db, 3 * evidence.noise_db) if effect == "texture" else evidence.noise_db


def without_unseen(stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> Fitted:
    """The fits with gains as a display shows them, and without the effects of surfaces that show too little."""
    before, whole = _errors_without(stage, observed, mirrors, fitted)
    evidence = dict(fitted.evidence)
    unseen: list[tuple[str, int]] = []
    for (effect, surface), error in before.items():
        old = evidence.get((effect, surface))
        if old is None:
            continue
        gain = visible_gain_db(old.gain_db, error)
        # Left-out photographs are judged by the pixels that a surface's effect is fitted to; over all it may do less.
        gain = gain if surface == SCENE else min(gain, visible_step_db(error, whole[surface]))
        new = replace(old, gain_db=gain)
        evidence[effect, surface] = new
        is_kept = stage.forced.get((effect, surface), new.gain_db > needed_db(stage, effect, new))
        if surface >= 0 and not is_kept:
            unseen.append((effect, surface))
    fitted = replace(fitted, evidence=evidence)
    return _without(stage, observed, mirrors, fitted, unseen)


def _without(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted, unseen: list[tuple[str, int]]
) -> Fitted:
    albedo, normal, gain = fitted.albedo.copy(), fitted.normal.copy(), fitted.lobe_gain.copy()
    lobes, is_textured = list(fitted.lobes), fitted.is_textured.copy()
    for effect, surface in unseen:
        mine = stage.surface == surface
        if effect == "texture":
            is_textured[surface] = False
            albedo[mine] = fitted.surface_albedo[surface].astype(np.float32)
        elif effect == "detail":
            normal[mine], gain[mine] = stage.points.normal[mine], 1.0
        elif effect == "lobes":
            lobes[surface] = ()
    changed = bool((normal != stage.points.normal).any())
    fitted = replace(
        fitted, albedo=albedo, is_textured=is_textured, texture_shows=fitted.texture_shows & is_textured,
        normal=normal if changed else stage.points.normal, lobe_gain=gain, lobes=tuple(lobes),
    )  # fmt: skip
    return replace(fitted, specular=specular_layers(stage, observed, mirrors, fitted)) if unseen else fitted


# ------------------------------------------------------------------------------------------------ errors


def _errors_without(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted
) -> tuple[Mapping[tuple[str, int], float], Mapping[int, float]]:
    """Mean square of display values by which the fitted photographs are missed without each effect that is there, and,
    by surface, with all of them.

    Clear of shadow borders, and off the outlines, where a pixel mixes what it covers; of a surface that is nearly all
    outline, everywhere.
    """
    num = stage.surfaces.num_surfaces
    whole = np.bincount(stage.surface, stage.is_matte, minlength=num)
    inside = np.bincount(stage.surface, stage.is_matte & observed.is_interior, minlength=num)
    counts = stage.is_matte & (observed.is_interior | (inside < 0.2 * whole)[stage.surface])
    some = _some_of_each(stage.surface, num)
    surface, counts = stage.surface[some], counts[some]
    squares, known = {}, np.zeros(num)
    for photo, pictures in enumerate(_pictures_without(stage, observed, mirrors, fitted, some)):
        measured = displayed(observed.radiance[photo, some], stage.white)
        weight = counts * (observed.weight[photo, some] > 0) * observed.is_safe[photo, some]
        known += np.bincount(surface, weight, minlength=num)
        for name, radiance in pictures.items():
            miss = ((displayed(radiance, stage.white) - measured) ** 2).mean(axis=1)
            squares[name] = squares.get(name, 0.0) + np.bincount(surface, weight * miss, minlength=num)
    is_there = {
        "texture": fitted.is_textured,
        "detail": np.bincount(stage.surface, _has_detail(stage, fitted), minlength=num) > 0,
        "lobes": np.array([len(lobes) > 0 for lobes in fitted.lobes]),
    }
    errors = {
        (name, int(s)): float(squares[name][s] / max(known[s], 1.0))
        for name, there in is_there.items()
        for s in np.flatnonzero(there)
    }
    errors["indirect", SCENE] = float(squares["indirect"].sum() / max(known.sum(), 1.0))
    whole = {int(s): float(squares["none"][s] / max(known[s], 1.0)) for s in range(num)}
    return errors, whole


def _pictures_without(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted, some: np.ndarray
) -> Iterator[dict[str, Float32[np.ndarray, "point 3"]]]:
    """Each photograph as fitted but for one effect, by the effect's name, at some of the points."""
    over_pi, nothing = np.float32(1 / np.pi), np.float32(0)
    mean, albedo = fitted.surface_albedo[stage.surface[some]].astype(np.float32), fitted.albedo[some]
    direct = smooth = direct_irradiance(stage, observed, mirrors, fitted)
    gloss = smooth_gloss = fitted.specular
    if _has_detail(stage, fitted).any():
        flat = replace(fitted, normal=stage.points.normal, lobe_gain=np.ones_like(fitted.lobe_gain))
        smooth = direct_irradiance(stage, observed, mirrors, flat)
        smooth_gloss = specular_layers(stage, observed, mirrors, flat)
    for photo in range(len(fitted.irradiance)):
        indirect, lit = fitted.irradiance[photo, some], direct[photo, some]
        light = (lit + indirect) * over_pi
        shine = nothing if gloss is None else gloss[photo, some]
        smooth_shine = nothing if smooth_gloss is None else smooth_gloss[photo, some]
        yield {
            "texture": mean * light + shine,
            "detail": albedo * over_pi * (smooth[photo, some] + indirect) + smooth_shine,
            "lobes": albedo * light,
            "indirect": albedo * over_pi * lit + shine,
            "none": albedo * light + shine,
        }


def _has_detail(stage: Stage, fitted: Fitted) -> Bool[np.ndarray, " point"]:
    return (fitted.normal != stage.points.normal).any(axis=1) | (fitted.lobe_gain != 1)


def _some_of_each(surface: np.ndarray, num_surfaces: int) -> np.ndarray:
    """Points of every surface, at most NUM_SAMPLES of each, in the order of the points."""
    mine = [np.flatnonzero(surface == s) for s in range(num_surfaces)]
    return np.sort(np.concatenate([each[thinned(len(each))] for each in mine]))


def thinned(num: int) -> np.ndarray:
    """Evenly spread places in a list, at most NUM_SAMPLES."""
    return np.linspace(0, num - 1, min(num, NUM_SAMPLES)).astype(int)


def displayed(radiance: np.ndarray, white: float) -> Float32[np.ndarray, "point 3"]:
    """Display values in [0, 1] of radiance, with `white` shown as white."""
    return srgb_from_linear((radiance / np.float32(white)).astype(np.float32))

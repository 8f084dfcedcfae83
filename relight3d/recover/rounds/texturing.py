"""Which surfaces are textured, and what each surface's albedo is as a whole."""

from dataclasses import replace

import numpy as np

from relight3d.maths.least_squares import weighted_median
from relight3d.records import Observations
from relight3d.recover import texture
from relight3d.recover.rounds.state import Evidence, Fitted, Stage

OUTSHONE = 0.25  # of the rest: where a lobe shines more, a photograph says nothing of the texture


def surface_medians(albedo: np.ndarray, information: np.ndarray, surface: np.ndarray, num: int) -> np.ndarray:
    """The median albedo of each surface by what its points have to say.

    By information, since a point that the light grazes turns any indirect light into albedo. A surface that no light
    reaches has the mean of the others, and a half where none is reached.
    """
    out = np.full((num, 3), np.nan)
    for s in range(num):
        mine = np.flatnonzero(surface == s)
        if (information[mine] > 0).any():
            out[s] = [weighted_median(albedo[mine, c], information[mine, c].astype(np.float64)) for c in range(3)]
    is_known = np.isfinite(out[:, :1])
    others = out[is_known[:, 0]].mean(axis=0) if is_known.any() else np.full(3, 0.5)
    return np.where(is_known, out, others)


def looks_textured(
    stage: Stage, observed: Observations, direct: np.ndarray, albedo: np.ndarray, num: int
) -> np.ndarray:
    """A first look at texture, before any indirect light is known: by neighbours, which share theirs, and by paints too
    unlike for it.
    """
    options = stage.options.texture
    measured = texture.difference_measure(observed, stage.points, stage.surface, albedo, stage.camera, num, options)
    unlike = texture.unlike_share(observed, stage.points, stage.surface, stage.is_matte, direct, stage.camera, num)
    return np.array([replace(m, spread=0.0).is_textured(options) for m in measured]) | (unlike >= options.min_share)


def judge_texture(stage, observed, target, weight, direct, albedo, mean, fitted: Fitted) -> Fitted:
    """Which surfaces are textured (1.1.1), and which keep an albedo per pixel: those whose left-out photographs gain."""
    options = stage.options.texture
    glare = observed.is_highlight
    if fitted.specular is not None:
        shine, rest = fitted.specular.mean(axis=2), np.abs(target).mean(axis=2)
        glare = glare | (shine > 0.05 * rest)
        # What a lobe misses is as large as what it shines, and no matter of the albedo.
        weight = weight * (shine < OUTSHONE * rest)
    measured = texture.difference_measure(
        replace(observed, radiance=target, is_highlight=glare),
        stage.points,
        stage.surface,
        albedo,
        stage.camera,
        len(mean),
        options,
    )
    # What a lobe leaves unexplained differs between neighbours as well: a gloss must differ by twice as much.
    strict = replace(options, min_difference=2 * options.min_difference)
    shows = np.array([m.is_textured(strict if fitted.lobes[s] else options) for s, m in enumerate(measured)])
    light = direct + fitted.irradiance
    gains = texture.left_out_gain(target, weight, light, stage.surface, len(mean), stage.white)
    evidence = dict(fitted.evidence)
    kept = np.zeros(len(mean), bool)
    for s, (gain, by_folds, by_photographs) in enumerate(gains):
        # Where neighbours differ it is a texture, and one photograph that a highlight spoils makes it no less of one.
        # Errors of the normals, which neighbours share, must gain whatever is left out.
        noise = by_photographs if replace(measured[s], spread=0.0).is_textured(options) else by_folds
        kept[s] = stage.forced.get(("texture", s), shows[s] or gain > max(options.min_gain_db, 2 * noise))
        reason = f"neighbours differ by {100 * measured[s].typical:.0f} %, spread {100 * measured[s].spread:.0f} %"
        evidence["texture", s] = Evidence(gain, noise, reason)
    return replace(fitted, is_textured=kept, texture_shows=shows, evidence=evidence)

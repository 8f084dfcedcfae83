"""How the lamps light the points, and what the lobes make of it, with the detail found so far."""

import numpy as np
from jaxtyping import Float32

from relight3d.maths.blur import blur_known
from relight3d.records import Mirror, Observations, ShadingPoints
from relight3d.recover import specular
from relight3d.recover.rounds.state import Fitted, Stage

WEIGHTS_BLUR_PX = 1.5
QUIET = 0.02  # of white: noise that weights with floors of 0.05 and 0.1 do not follow, as a median


def direct_irradiance(stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> np.ndarray:
    """Direct irradiance for normalised photographs: the lights' own, with detail, and what mirrors throw."""
    total = observed.form
    if fitted.normal is not stage.points.normal:
        total = total * cosine_change(observed, stage.points, fitted.normal)[..., None]
    if observed.thrown is None:
        return total
    total = np.broadcast_to(total, observed.radiance.shape).copy()
    for one, form in zip([m for m in mirrors if m.throws_light], observed.thrown, strict=True):
        total += form * one.reflectance.astype(np.float32)
    return total


def cosine_change(observed: Observations, points: ShadingPoints, normal: np.ndarray) -> np.ndarray:
    """The cosine with detail over that without, per photograph and point (of its strongest light)."""
    out = np.ones(observed.is_lit.shape, np.float32)
    for photo, each in enumerate(observed.lights):
        if each:
            to_light = strongest(each).incident(points.position)[0]
            # Clamped off zero: at grazing light the ratio means nothing, and nothing there is believed anyway.
            before = np.maximum(np.einsum("pi,pi->p", points.normal, to_light), 0.02)
            after = np.maximum(np.einsum("pi,pi->p", normal, to_light), 0.0)
            out[photo] = np.clip(after / before, 0.0, 20.0)
    return out


def strongest(lights: tuple):
    """The light of a photograph that matters most."""
    return max(lights, key=lambda one: float(one.power.sum()))


def specular_layers(stage: Stage, observed: Observations, fitted: Fitted) -> np.ndarray | None:
    """The lobes' radiance at every photograph and point; None when no surface has a lobe."""
    if not any(fitted.lobes):
        return None
    out = np.zeros_like(observed.radiance)
    points, change = stage.points, cosine_change(observed, stage.points, fitted.normal)
    for s, lobes in enumerate(fitted.lobes):
        mine = np.flatnonzero((stage.surface == s) & stage.is_matte) if lobes else ()
        for photo, each in enumerate(observed.lights if len(mine) else ()):
            for light in each:
                # The form sums a photograph's lights; one of several gets its part by its power.
                share = (light.power / observed.scale[photo]).astype(np.float32) if len(each) > 1 else np.float32(1)
                form = observed.form[photo, mine] * change[photo, mine, None] * share
                to_light = np.asarray(light.incident(points.position[mine])[0], np.float32)
                value = specular.specular_radiance(
                    lobes, fitted.normal[mine], to_light, points.to_viewer[mine], form, points.position[mine]
                )
                out[photo, mine] += value * fitted.lobe_gain[mine, None]
    return out


def calm_radiance(stage: Stage, observed: Observations) -> Float32[np.ndarray, "photo point 3"]:
    """Photographs for weights that go with brightness, at least 0: blurred where all of them are noisy.

    A weight that goes with a pixel's own noise believes the pixel most where its noise is darkest.
    """
    shape, pixel = (stage.camera.height, stage.camera.width), stage.points.pixel
    out = np.empty_like(observed.radiance)
    for photo, is_known in enumerate(observed.weight > 0):
        value = observed.radiance[photo]
        mean = blur_known(value, is_known, pixel, shape, WEIGHTS_BLUR_PX).reshape(3, -1)[:, pixel].T
        # Half of the pixels of one photograph that differ no more than this from their neighbours: no noise is larger.
        noise = np.median(np.abs(value - mean)[is_known]) if is_known.any() else np.inf
        if not observed.is_dark[photo] and noise < QUIET * stage.white:
            return np.maximum(observed.radiance, 0.0)
        out[photo] = np.maximum(mean, 0.0)
    return out

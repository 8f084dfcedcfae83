"""How the lamps light the points, and what the lobes make of it, with the detail found so far."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from relight3d.lights import Light
from relight3d.maths.blur import blur_known
from relight3d.records import Lobe, Mirror, Observations, ShadingPoints
from relight3d.recover import specular
from relight3d.recover.rounds.state import Fitted, Stage
from relight3d.shading import mirrored_light

WEIGHTS_BLUR_PX = 1.5
QUIET = 0.02  # of white: noise that weights with floors of 0.05 and 0.1 do not follow, as a median


class Lamp(NamedTuple):
    """A light of a photograph, or a mirror's image of it, and how it lights some points."""

    light: Light
    form: Float32[np.ndarray, "point color"]  # normalised, without detail; 0 where it is not seen
    is_image: bool


def lamps(observed: Observations, mirrors: tuple[Mirror, ...], photo: int, mine: np.ndarray) -> Iterator[Lamp]:
    """What lights some points in a photograph: its lights, and their images in mirrors that throw light there."""
    throwing = [m for m in mirrors if m.throws_light] if observed.thrown is not None else []
    thrown = () if observed.thrown is None else observed.thrown
    for light in observed.lights[photo]:
        # The form sums a photograph's lights; one of several gets its part by its power.
        is_one_of_several = len(observed.lights[photo]) > 1
        share = (light.power / observed.scale[photo]).astype(np.float32) if is_one_of_several else np.float32(1)
        yield Lamp(light, observed.form[photo, mine] * share, False)
        for one, forms in zip(throwing, thrown, strict=True):
            form = forms[photo, mine]
            if form.any():
                yield Lamp(mirrored_light(light, one), form * share * one.reflectance.astype(np.float32), True)


def direct_irradiance(stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> np.ndarray:
    """Direct irradiance for normalised photographs: the lights' own and what mirrors throw, both with detail."""
    total, points, has_detail = observed.form, stage.points, fitted.normal is not stage.points.normal
    if has_detail:
        total = total * _changes(observed.lights, points, fitted.normal)[..., None]
    if observed.thrown is None:
        return total
    total = np.broadcast_to(total, observed.radiance.shape).copy()
    for one, form in zip([m for m in mirrors if m.throws_light], observed.thrown, strict=True):
        if has_detail:
            images = tuple(tuple(mirrored_light(light, one) for light in each) for each in observed.lights)
            form = form * _changes(images, points, fitted.normal)[..., None]
        total += form * one.reflectance.astype(np.float32)
    return total


def _changes(lights: tuple[tuple[Light, ...], ...], points: ShadingPoints, normal: np.ndarray) -> np.ndarray:
    """cosine_change per photograph and point, of the photograph's strongest light."""
    out = np.ones((len(lights), len(points)), np.float32)
    for photo, each in enumerate(lights):
        if each:
            out[photo] = cosine_change(points.normal, normal, strongest(each).incident(points.position)[0])
    return out


def cosine_change(mesh_normal: np.ndarray, normal: np.ndarray, to_light: np.ndarray) -> np.ndarray:
    """The cosine with detail over that without, per point."""
    # Clamped off zero: at grazing light the ratio means nothing, and nothing there is believed anyway.
    before = np.maximum(np.einsum("pi,pi->p", mesh_normal, to_light), 0.02)
    after = np.maximum(np.einsum("pi,pi->p", normal, to_light), 0.0)
    return np.clip(after / before, 0.0, 20.0)


def strongest(lights: tuple):
    """The light of a photograph that matters most."""
    return max(lights, key=lambda one: float(one.power.sum()))


def specular_layers(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted
) -> np.ndarray | None:
    """The lobes' radiance at every photograph and point; None when no surface has a lobe."""
    if not any(fitted.lobes):
        return None
    out = np.zeros_like(observed.radiance)
    for s, lobes in enumerate(fitted.lobes):
        mine = np.flatnonzero((stage.surface == s) & stage.is_matte) if lobes else np.zeros(0, int)
        for photo in range(len(observed.lights) if len(mine) else 0):
            for lamp in lamps(observed, mirrors, photo, mine):
                out[photo, mine] += shine(stage.points, lobes, lamp, fitted.normal, mine)
        out[:, mine] *= fitted.lobe_gain[mine, None]
    return out


def shine(
    points: ShadingPoints, lobes: tuple[Lobe, ...], lamp: Lamp, normal: np.ndarray, mine: np.ndarray
) -> Float32[np.ndarray, "point 3"]:
    """The radiance of lobes of gain 1 under one lamp, at some points, by the normals of all."""
    at, form = points.position[mine], lamp.form
    to_light = np.asarray(lamp.light.incident(at)[0], np.float32)
    if normal is not points.normal:
        form = form * cosine_change(points.normal[mine], normal[mine], to_light)[:, None]
    return specular.specular_radiance(lobes, normal[mine], to_light, points.to_viewer[mine], form, at)


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

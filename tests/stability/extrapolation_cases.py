"""Lights where no photograph was: frames stay within a stated bound of the nearest photographed radiance."""

from dataclasses import replace

import numpy as np

from relight3d.evaluate.scenes import GOLDEN_ANGLE, desk_scene
from relight3d.lights import DirectionalLight, PointLight
from relight3d.records import Capture, RelightModel
from tests.stability.harness import (
    HEIGHT,
    RUNAWAY,
    WIDTH,
    Outcome,
    brightest,
    case,
    checked,
    frame,
    good_capture,
    good_error,
    good_model,
    held_out_error,
    outcome,
    photographed,
)
from tests.stability.light_cases import toward

# What is fitted (indirect light and residual) may leave the photographed range by no more than this factor: it is read
# at the edge of reach, about one gap between lights beyond them, where a second-order function still rises a little.
FITTED_BOUND = 1.5


def everywhere(num: int = 60) -> list[DirectionalLight]:
    """Lights over the whole sphere, from below too."""
    z = 1 - 2 * (np.arange(num) + 0.5) / num
    a, ring = GOLDEN_ANGLE * np.arange(num), np.sqrt(1 - z * z)
    return [DirectionalLight(tuple(d), np.pi) for d in np.stack([ring * np.cos(a), ring * np.sin(a), z], axis=1)]


def fitted_part(model: RelightModel, light: DirectionalLight) -> np.ndarray:
    """What a frame has beyond the direct light."""
    bare = replace(model, indirect=None, residual=None, background=None)
    return frame(model, light) - frame(bare, light)


def _stays_bounded(capture: Capture, runaway: float = RUNAWAY) -> Outcome:
    model = checked(capture, runaway=runaway)
    photographed_lights = [p.lights[0] for p in capture.split("train")]
    known = max(np.abs(fitted_part(model, light)).max() for light in photographed_lights)
    lights = everywhere()
    farthest = max(np.abs(fitted_part(model, light)).max() for light in lights)
    assert farthest <= FITTED_BOUND * known, (farthest, known)
    largest = max(frame(model, light).max() for light in lights)
    assert largest <= runaway * brightest(capture), (largest, brightest(capture))
    error = held_out_error(model, capture)
    return outcome(model, error, f"fitted light at most {farthest / known:.2f} times the photographed")


@case("extrapolation", "all lights over the sphere, photographed from above", "polynomials beyond their data")
def whole_sphere() -> Outcome:
    return _stays_bounded(good_capture())


@case("extrapolation", "photographed within a cone of 20 degrees", "polynomials far beyond their data")
def from_a_cone() -> Outcome:
    lights = [toward(90 - 20 * r, a) for r, a in zip((0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1, 1, 1), range(0, 1370, 137))]
    test = [p.lights for p in good_capture().split("test")]
    return _stays_bounded(photographed(desk_scene(2 * WIDTH, 2 * HEIGHT), lights, test))


@case("extrapolation", "photographed within 3 degrees", "photographs that say the same ten times")
def nearly_one_light() -> Outcome:
    rng = np.random.default_rng(5)
    lights = [toward(50 + 1.5 * a, 60 + 2 * b) for a, b in rng.uniform(-1, 1, (10, 2))]
    test = [p.lights for p in good_capture().split("test")]
    # What all ten only graze may be taken for white: radiance 1 and its indirect light, where the brightest is 0.56.
    return _stays_bounded(photographed(desk_scene(2 * WIDTH, 2 * HEIGHT), lights, test), runaway=2.5)


@case("extrapolation", "a lamp close to the scene, photographed under distant light", "1 / distance^2 in a fit")
def near_lamp() -> Outcome:
    model = good_model()
    for height in (2.0, 0.8, 0.65, 0.61):  # the box is 0.6 high
        lamp = PointLight((-0.5, 0.1, height), np.pi)
        bare = replace(model, indirect=None, residual=None, background=None)
        fitted = np.abs(frame(model, lamp) - frame(bare, lamp)).max()
        # As strong as a distant light that is as bright at the distance where softening begins, half the radius.
        limit = max(np.abs(fitted_part(model, p.lights[0])).max() for p in good_capture().split("train"))
        assert fitted <= FITTED_BOUND * limit / model.indirect.softening**2
    return Outcome("ok", wanted=good_error(), note="fitted light is bounded by the softening distance")

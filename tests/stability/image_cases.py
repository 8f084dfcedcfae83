"""Nasty photographs: empty, constant, broken, clipped, noisy, tiny."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from relight3d.evaluate import disturb
from relight3d.evaluate.scenes import desk_scene, hemisphere_lights
from relight3d.records import Capture, RelightModel
from tests.stability.harness import (
    Outcome,
    case,
    checked,
    frame,
    good_capture,
    good_error,
    held_out_error,
    outcome,
    photographed,
    relative,
)


def edited(edit: Callable[[np.ndarray, np.random.Generator], np.ndarray]) -> Capture:
    """The good capture with its training photographs edited; the held-out ones keep telling the truth."""
    rng = np.random.default_rng(0)
    photographs = [
        replace(p, pixels=edit(p.pixels.copy(), rng).astype(np.float32)) if p.split == "train" else p
        for p in good_capture().photographs
    ]
    return replace(good_capture(), photographs=tuple(photographs))


def _against_truth(capture: Capture, worse: float, note: str = "") -> Outcome:
    """Held-out error at most `worse` times the well-posed one."""
    model = checked(capture)
    error = held_out_error(model, good_capture())
    assert error < worse * good_error(), f"{error:.4f} against {good_error():.4f}"
    return outcome(model, error, note)


def albedo_error(model: RelightModel) -> float:
    """The largest relative error of a surface's albedo against the desk's truth."""
    truth = np.array([material.albedo for material in desk_scene().materials])
    return float(np.abs(model.surface_albedo / truth - 1).max())


@case("images", "all photographs black", "exposure and ratios of 0 / 0")
def black() -> Outcome:
    capture = edited(lambda pixels, rng: 0 * pixels)
    model = checked(replace(capture, photographs=capture.split("train")))
    # Nothing came back from anywhere: albedo 0, no lobe, black frames.
    assert model.surface_albedo.max() < 1e-9 and not any(model.lobes)
    assert frame(model, *capture.photographs[0].lights).max() == 0.0
    return outcome(model, 0.0, "black frames")


@case("images", "all photographs constant", "an image that no light explains")
def constant() -> Outcome:
    capture = edited(lambda pixels, rng: np.full_like(pixels, 0.3))
    training = replace(capture, photographs=capture.split("train"))
    model = checked(training)
    # As bright in the shadow as in the light: the shadows' own edges stay, the rest is evened out by what is fitted.
    seen = np.zeros(model.camera.num_pixels, bool)
    seen[model.pixels.points.pixel] = True
    seen = seen.reshape(model.camera.height, model.camera.width)
    error = float(np.mean([relative(frame(model, *p.lights), p.pixels, seen) for p in training.photographs]))
    assert error < 0.35, error
    return outcome(model, error, "of the photographs themselves")


@case("images", "5 % NaN and infinite pixels", "one of them in a sum spoils it")
def not_finite() -> Outcome:
    def spoil(pixels, rng):
        pixels[rng.random(pixels.shape) < 0.03] = np.nan
        pixels[rng.random(pixels.shape) < 0.02] = np.inf
        return pixels

    # A pixel with one bad colour is left out: an eighth of the data is gone, at random.
    return _against_truth(edited(spoil), 1.25)


@case("images", "a photograph that is NaN but for one pixel", "a photograph without weight")
def nearly_all_nan() -> Outcome:
    capture = edited(lambda pixels, rng: pixels)
    bad = np.full_like(capture.photographs[0].pixels, np.nan)
    bad[20, 20] = capture.photographs[0].pixels[20, 20]
    photographs = (replace(capture.photographs[0], pixels=bad), *capture.photographs[1:])
    # One photograph of ten is lost.
    return _against_truth(replace(capture, photographs=photographs), 1.3)


@case("images", "saturated at half of white", "the brightest third is cut")
def saturated() -> Outcome:
    capture = disturb.with_saturation(good_capture(), 0.5)
    model = checked(capture)
    error = held_out_error(model, good_capture())
    # Cut pixels are left out, so the albedos are not bent. Where all of a pixel's photographs are cut, only the
    # surface's own value is left: of the box, 9 % off in the good case already, that is all of its sunny side.
    assert error < 2.0 * good_error() and albedo_error(model) < 0.3, (error, albedo_error(model))
    return outcome(model, error, f"albedo off by {100 * albedo_error(model):.0f} %")


@case("images", "peaks of 1e6", "a sum of squares that one pixel decides")
def peaks() -> Outcome:
    def hot(pixels, rng):
        pixels[rng.random(pixels.shape[:2]) < 0.002] = 1e6
        return pixels

    capture = edited(hot)
    model = checked(capture)
    error = held_out_error(model, good_capture())
    # Two pixels a photograph, at random places: robust fits lose those pixels in that photograph.
    assert error < 2.0 * good_error(), error
    return outcome(model, error)


@case("images", "8-bit quantised", "steps of 1/255 in the dark")
def eight_bits() -> Outcome:
    # A step of 1/255 of white is 3 % of a dark pixel at a tenth of white, and is averaged over ten photographs.
    return _against_truth(disturb.with_quantisation(good_capture(), 8), 1.2)


@case("images", "5 % noise", "texture, detail and lobes fitted to noise")
def noisy() -> Outcome:
    capture = disturb.with_noise(good_capture(), read=0.05)
    model = checked(capture)
    error = held_out_error(model, good_capture())
    # 5 % of white is 10 % of a mean radiance of half of white; over ten photographs a third of that is left.
    assert error < good_error() + 0.05, error
    assert not any(model.lobes)  # noise is no highlight
    return outcome(model, error)


@case("images", "negative values", "roots and logarithms of negative radiance")
def negative() -> Outcome:
    def below(pixels, rng):
        # A black level taken off too high by 2 % of white, on top of noise.
        return pixels - 0.01 + 0.01 * rng.standard_normal(pixels.shape)

    capture = edited(below)
    assert min(float(p.pixels.min()) for p in capture.split("train")) < 0
    model = checked(capture)
    error = held_out_error(model, good_capture())
    # 0.01 of a mean radiance of about 0.2 is 5 %.
    assert error < good_error() + 0.06, error
    return outcome(model, error)


@case("images", "one pixel wide", "neighbours, edges and windows that do not exist")
def one_pixel_wide() -> Outcome:
    scene = desk_scene(2, 96)
    scene = replace(scene, camera=replace(scene.camera, fx=48.0, fy=96.0))
    capture = photographed(scene, hemisphere_lights(8), hemisphere_lights(2, seed=3))
    assert capture.camera.width == 1
    model = checked(capture)
    error = held_out_error(model, capture)
    # Every pixel is on an outline or alone in its row: no border, no texture. The light itself is still computed.
    assert error < 0.3, error
    return outcome(model, error)


@case("images", "one row", "neighbours above and below that do not exist")
def one_row() -> Outcome:
    scene = desk_scene(96, 2)
    capture = photographed(scene, hemisphere_lights(8), hemisphere_lights(2, seed=3))
    assert capture.camera.height == 1
    model = checked(capture)
    error = held_out_error(model, capture)
    assert error < 0.3, error
    return outcome(model, error)

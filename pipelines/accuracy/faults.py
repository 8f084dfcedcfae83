"""Faults of photographs that relight3d.evaluate.disturb has no function for, or has with another parameter."""

from dataclasses import replace

import numpy as np

from relight3d.evaluate.disturb import with_saturation
from relight3d.io.capture import read_photograph
from relight3d.maths.color import exposure_of
from relight3d.records import Capture, Photograph


def with_lamp_left_on(capture: Capture) -> Capture:
    """The middle training photograph, with the first one's lamp burning too; its file does not say so.

    Light adds up, so the sum of the two photographs (the ambient light once, where it was photographed) is exact.
    """
    lit = [p for p in capture.split("train") if p.lights]
    dark = [p for p in capture.split("train") if not p.lights]
    spoilt, lamp = _middle(capture), read_photograph(capture, lit[0])[0]
    extra = lamp - read_photograph(capture, dark[0])[0] if dark else lamp
    return replace(
        capture,
        photographs=tuple(_with_added(capture, p, extra) if p is spoilt else p for p in capture.photographs),
    )


def without_middle(capture: Capture) -> Capture:
    """The capture without the photograph that with_lamp_left_on spoils."""
    left_out = _middle(capture)
    return replace(capture, photographs=tuple(p for p in capture.photographs if p is not left_out))


def with_saturated_pixels(capture: Capture, share: float) -> Capture:
    """A sensor that is full in this share of all the training photographs' pixels."""
    pictures = [read_photograph(capture, p) for p in capture.split("train")]
    values = np.concatenate([picture[valid] for picture, valid in pictures])
    return with_saturation(capture, float(np.quantile(values.max(axis=1), 1 - share)) * exposure_of(values.ravel()))


def without_labels(capture: Capture) -> Capture:
    """The mesh as a scan is: it does not say which face belongs to what."""
    return replace(capture, mesh=replace(capture.mesh, object_id=None, object_names=None))


def _middle(capture: Capture) -> Photograph:
    lit = [p for p in capture.split("train") if p.lights]
    return lit[len(lit) // 2]


def _with_added(capture: Capture, photograph: Photograph, extra: np.ndarray) -> Photograph:
    picture, valid = read_photograph(capture, photograph)
    return replace(photograph, pixels=picture + extra, is_valid=valid, image_path=None, mask_path=None)

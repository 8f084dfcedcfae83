"""What was measured on the files as written: units, camera, noise floor, light coverage."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from desk.lights import Lamp
from desk.settings import Material, SceneSettings
from desk.truth import NO_SURFACE, Truth, to_lamp

WHITE_PERCENTILE = 99.5


def interior(truth: Truth, is_lit: np.ndarray) -> np.ndarray:
    """Pixels whose 3x3 neighbourhood is of one surface and wholly lit."""
    label = truth.label
    return (minimum_filter(label, 3) == maximum_filter(label, 3)) & minimum_filter(is_lit, 3)


@dataclass(frozen=True)
class Under:
    """The scene under one lamp of a colour, from one eye."""

    settings: SceneSettings
    truth: Truth
    is_lit: np.ndarray
    lamp: Lamp
    color: np.ndarray
    eye: np.ndarray


def expected_direct(under: Under, material: Material) -> np.ndarray:
    """Radiance where the lamp is seen, from the formulas: Lambert, and GGX with separable Smith shadowing."""
    normals, points = under.truth.normals, under.truth.points
    to_light, irradiance = to_lamp(under.lamp, points)
    to_eye = under.eye - points
    to_eye /= np.linalg.norm(to_eye, axis=-1, keepdims=True)
    cos_light = np.clip((normals * to_light).sum(-1), 1e-6, 1)
    result = under.truth.albedo / np.pi * cos_light[..., None]
    if material.lobe_reflectance:
        squared = material.lobe_alpha**2
        half = to_light + to_eye
        half /= np.linalg.norm(half, axis=-1, keepdims=True)
        cos_half = np.clip((normals * half).sum(-1), 0, 1)
        cos_eye = np.clip((normals * to_eye).sum(-1), 1e-6, 1)
        peak = squared / (np.pi * (cos_half**2 * (squared - 1) + 1) ** 2)
        seen = [2 / (1 + np.sqrt(1 + squared * (1 / c**2 - 1))) for c in (cos_light, cos_eye)]
        result = result + (material.lobe_reflectance * peak * seen[0] * seen[1] / (4 * cos_eye))[..., None]
    return result * irradiance[..., None] * under.color


def units(under: Under, direct: np.ndarray) -> dict:
    """Median over interior lit pixels of direct radiance / expected: of each surface, and of all Lambertian ones."""
    where = interior(under.truth, under.is_lit)
    ratios, lambertian = {}, []
    for i, thing in enumerate(under.settings.things):
        mine = where & (under.truth.label == i)
        if thing.material.kind == "mirror" or mine.sum() < 20:
            continue
        ratio = direct[mine] / expected_direct(under, thing.material)[mine]
        ratios[thing.name] = round(float(np.median(ratio)), 6)
        if thing.material.kind in ("diffuse", "textured"):
            lambertian.append(ratio.ravel())
    if lambertian:  # a very small picture may have no such pixel
        ratios["diffuse"] = round(float(np.median(np.concatenate(lambertian))), 6)
    return ratios


def registration_px(under: Under, direct: np.ndarray) -> list[float]:
    """Shift (x, y) of the written direct part against the formulas at the pixel centres.

    First order in the gradient of outlines, textures and shadow borders. Pixel centres at +0.5 give zero.
    """
    expected = np.zeros_like(direct)
    is_known = np.zeros(under.is_lit.shape, bool)
    for i, thing in enumerate(under.settings.things):
        if thing.material.kind != "mirror":
            mine = under.truth.label == i
            expected[mine] = (expected_direct(under, thing.material) * under.is_lit[..., None])[mine]
            is_known |= mine
    where = minimum_filter(is_known, 5)
    gradient = np.stack([np.gradient(direct.mean(-1), axis=axis)[where] for axis in (1, 0)], 1)
    shift = np.linalg.lstsq(gradient, (expected - direct).mean(-1)[where], rcond=None)[0]
    return [round(float(s), 3) for s in shift]


def surface_error_m(settings: SceneSettings, truth: Truth) -> dict:
    """Contract's ray times Mitsuba's distance must land on the known surface: largest error in metres, by object."""
    errors = {}
    for i, thing in enumerate(settings.things):
        points = truth.points[
            (truth.label == i) & (truth.face_normals[..., 2] > (0.99 if thing.shape == "slab" else -2))
        ]
        if len(points) and thing.shape == "slab":
            errors[thing.name] = float(np.abs(points[:, 2] - thing.at[2]).max())
        if len(points) and thing.shape == "sphere":  # a little inside the true sphere: it is tessellated
            middle = np.array(thing.at) + [0, 0, thing.size[2] / 2]
            errors[thing.name] = float(np.abs(np.linalg.norm(points - middle, axis=1) - thing.size[0] / 2).max())
    return {name: float(f"{error:.3g}") for name, error in errors.items()}


def display(radiance: np.ndarray, white: float) -> np.ndarray:
    clipped = np.clip(radiance / white, 0, 1)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)


def psnr_db(one: np.ndarray, other: np.ndarray, white: float, is_counted: np.ndarray) -> float:
    """The contract's PSNR over the counted pixels."""
    error = (display(one, white) - display(other, white))[is_counted]
    return float(-10 * np.log10(np.mean(error**2)))


def noise_floor(one: np.ndarray, other: np.ndarray, white: float, truth: Truth, settings: SceneSettings) -> dict:
    """Two independent renders of one frame against each other, over all mesh pixels and by surface."""
    is_seen = truth.label != NO_SURFACE
    by_surface = {
        thing.name: round(psnr_db(one, other, white, truth.label == i), 2)
        for i, thing in enumerate(settings.things)
        if (truth.label == i).any()
    }
    return {
        "psnr_db": round(psnr_db(one, other, white, is_seen), 2),
        "by_surface_psnr_db": by_surface,
        "white": float(white),
    }

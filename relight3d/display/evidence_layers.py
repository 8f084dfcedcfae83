"""Layers of evidence: what in the photographs the recovered numbers were read from, and what is left over."""

import numpy as np
from jaxtyping import Float32

from relight3d.display.grids import contact_grid
from relight3d.display.pictures import (
    LIT,
    SHADOWED,
    Painting,
    Scale,
    Swatch,
    hit_mask,
    image_of_points,
    paint_numbers,
    painted_numbers,
    upper_limit,
)
from relight3d.display.subject import Lights, Subject, options_of
from relight3d.maths.color import display_u8, luminance
from relight3d.recover.diffuse import DiffuseOptions, border_pairs
from relight3d.recover.mirror import EdgeTest, MirrorOptions, edge_test

_PREDICTED, _FOUND = (255, 64, 64), (0, 191, 191)  # both together make a near-white


def photographs(subject: Subject, lights: Lights) -> Painting:
    radiance, _ = subject.measured
    exposure = subject.model.exposure
    names = [photograph.name for photograph in subject.photographs]
    cells = [(name, display_u8(picture, exposure)) for name, picture in zip(names, radiance)]
    return Painting(image=contact_grid(cells), values=radiance, note=f"{len(cells)} training photographs")


def shadow_borders(subject: Subject, lights: Lights) -> Painting:
    """The pairs of eq. (1) over the mean photograph: the lit side yellow, the shadowed side blue."""
    model, observed = subject.model, subject.observed
    pixels = model.pixels
    pairs = border_pairs(
        observed, pixels.points, pixels.surface, model.camera, options_of(model, "diffuse", DiffuseOptions)
    )
    sides = [np.bincount(pairs[:, side], minlength=len(pixels.points)) for side in (1, 2)]
    image = _grey_scene(subject)
    for count, color in zip(sides, (LIT, SHADOWED)):
        strength = image_of_points(model, np.minimum(count / 3.0, 1.0), 0.0)[..., None]
        image = image + strength * (np.array(color) - image)
    per_surface = np.bincount(pixels.surface[pairs[:, 1]], minlength=model.surfaces.num_surfaces)
    named = [f"{name} {num:,}" for name, num in zip(model.surfaces.names, per_surface) if num]
    legend = (Swatch(LIT, "lit side of a pair"), Swatch(SHADOWED, "shadowed side"))
    note = "pairs: " + (", ".join(named) or "none, so no surface's albedo rests on a shadow border")
    values = np.stack([image_of_points(model, count, 0) for count in sides], axis=-1)
    return Painting(image=np.rint(image).astype(np.uint8), legend=legend, values=values, note=note)


def mirror_edges(subject: Subject, lights: Lights) -> Painting:
    """What each surface large enough would mirror, against the edges found there."""
    model = subject.model
    tests = edge_tests(subject)
    image = 0.45 * _grey_scene(subject)
    predicted, found = np.zeros((2, *image.shape[:2]), np.float32)
    areas = [image_of_points(model, model.pixels.surface == test.surface, False) for test in tests]
    scale = max([float(np.quantile(test.found[mine], 0.98)) for test, mine in zip(tests, areas)], default=1.0)
    for test, mine in zip(tests, areas):
        predicted = np.maximum(predicted, test.predicted & mine)
        found = np.where(mine, np.clip(test.found / max(scale, 1e-6), 0.0, 1.0), found)
    image = image * (1 - np.maximum(predicted, found))[..., None]
    image += predicted[..., None] * np.array(_PREDICTED) + found[..., None] * np.array(_FOUND)
    legend = (
        Swatch(_PREDICTED, "edge predicted"),
        Swatch(_FOUND, "edge found"),
        Swatch((255, 255, 255), "both: they agree"),
    )
    note = "; ".join(_verdict(subject, test) for test in tests) or "no surface is large and even enough to be tested"
    values = np.stack([predicted, found], axis=-1)
    return Painting(image=np.rint(np.clip(image, 0, 255)).astype(np.uint8), legend=legend, values=values, note=note)


def edge_tests(subject: Subject) -> list[EdgeTest]:
    """The edge test (1.1.3) of every surface that can be tested, repeated on the photographs."""
    model = subject.model
    points, surface = model.pixels.points, model.pixels.surface
    radiance = subject.measured[0].reshape(len(model.lights), -1, 3)[:, points.pixel]
    options = options_of(model, "mirror", MirrorOptions)
    tests = (
        edge_test(
            subject.scene,
            model.mesh,
            points,
            surface,
            model.surfaces.surface_of_face,
            model.camera,
            radiance,
            index,
            options,
        )
        for index in range(model.surfaces.num_surfaces)
    )
    return [test for test in tests if test is not None]


def residual(subject: Subject, lights: Lights) -> Painting:
    """Root mean square over the photographs of what a display would show of the misfit."""
    error, is_known = misfits(subject)
    count = np.maximum(is_known.sum(axis=0), 1)
    values = np.sqrt((np.square(luminance(error)) * is_known).sum(axis=0) / count)
    values = np.where(is_known.any(axis=0) & hit_mask(subject.model), values, np.nan).astype(np.float32)
    each = np.sqrt(np.nanmean(np.square(values)))
    label = "RMS difference to the photographs, share of white"
    return painted_numbers(
        values, "inferno", 0.0, upper_limit(values, 0.98), label, f"{each:.3f} over the whole picture"
    )


def residual_photographs(subject: Subject, lights: Lights) -> Painting:
    """The signed misfit of each photograph."""
    error, is_known = misfits(subject)
    shade = np.where(is_known & hit_mask(subject.model), luminance(error), np.nan).astype(np.float32)
    limit = upper_limit(np.abs(shade), 0.98)
    scale = Scale("RdBu_r", -limit, limit, "model minus photograph, share of white")
    names = [photograph.name for photograph in subject.photographs]
    cells = [(name, paint_numbers(picture, scale)) for name, picture in zip(names, shade)]
    return Painting(image=contact_grid(cells), scale=scale, values=shade)


def misfits(subject: Subject) -> tuple[Float32[np.ndarray, "photo height width 3"], np.ndarray]:
    """Model minus photograph where both are shown, exposed and clipped to [0, 1]; and where it counts."""
    radiance, is_known = subject.measured
    exposure = np.float32(subject.model.exposure)
    shown = np.stack([np.clip(frame.radiance * exposure, 0, 1) for frame in subject.predicted])
    return shown - np.clip(radiance * exposure, 0, 1), is_known


def _grey_scene(subject: Subject) -> np.ndarray:
    """The mean photograph, grey and dim, to draw on."""
    mean = luminance(subject.measured[0].mean(axis=0))
    grey = 0.6 * display_u8(mean, 1.5 * subject.model.exposure).astype(np.float64)
    return np.repeat(grey[..., None], 3, axis=2)


def _verdict(subject: Subject, test: EdgeTest) -> str:
    is_mirror = any(mirror.surface == test.surface for mirror in subject.model.mirrors)
    name = subject.model.surfaces.names[test.surface]
    return f"{name} {test.score:.2f} (chance {test.chance:.2f}): {'a mirror' if is_mirror else 'none'}"

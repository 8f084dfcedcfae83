"""Layers of light: the frame and its terms, shadows, and the indirect light with its coefficients."""

import numpy as np
from jaxtyping import Float, Shaped

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
    paint_on_empty,
    painted_categories,
    upper_limit,
)
from relight3d.display.subject import Lights, Subject
from relight3d.errors import InputError
from relight3d.maths.color import display_u8, luminance
from relight3d.records import Indirect, RelightModel
from relight3d.shading import cast_light, indirect_irradiance

_FUNCTIONS = {  # what the functions of maths.light_basis are, by name
    "constant": ("1",),
    "linear": ("1", "x", "y", "z"),
    "angles2": ("1", "θ", "φ", "θ²", "θφ", "φ²"),
    "cosines2": ("1", "x", "y", "z", "xy", "yz", "xz", "x²−y²", "z²"),
}
_HARMONICS = ("1", "y", "z", "x", "xy", "yz", "xz", "3z²−1", "x²−y²")


def relit(subject: Subject, lights: Lights) -> Painting:
    frame = subject.render(lights)
    note = f"{len(lights)} light{'' if len(lights) == 1 else 's'}, {frame.stats.total_ms:.0f} ms"
    return Painting(image=display_u8(frame.radiance, frame.exposure), values=frame.radiance, note=note)


def term(name: str):
    """The layer of one term of the frame, under the frame's exposure."""

    def paint(subject: Subject, lights: Lights) -> Painting:
        frame = subject.render(lights)
        values = getattr(frame.terms, name)
        if values is None:
            black = np.zeros((*frame.is_hit.shape, 3), np.float32)
            return Painting(image=display_u8(black), values=black, note="this scene's plan leaves it out")
        total = float(np.abs(frame.radiance).sum())
        share = 100.0 * float(values.sum()) / max(total, 1e-30)
        return Painting(
            image=display_u8(values, frame.exposure), values=values, note=f"{share:.1f} % of the frame's light"
        )

    return paint


def shadows(subject: Subject, lights: Lights) -> Painting:
    model = subject.model
    points = model.pixels.points
    count = np.zeros(len(points), np.int32)
    for light in lights:
        count += cast_light(subject.scene, points, light.translated(-model.mesh.center), model.pixels.normal).is_lit
    if len(lights) <= 1:
        legend = (Swatch(SHADOWED, "in shadow, or turned away"), Swatch(LIT, "sees the light"))
    else:
        shades = np.linspace(SHADOWED, LIT, len(lights) + 1).astype(int).tolist()
        legend = tuple(Swatch((r, g, b), f"sees {i} of {len(lights)} lights") for i, (r, g, b) in enumerate(shades))
    return painted_categories(image_of_points(model, count, -1), legend)


def irradiance(subject: Subject, lights: Lights) -> Painting:
    """Irradiance as a white sheet would show it, on a linear scale of the same exposure as the frame."""
    model = subject.model
    indirect = _indirect(model)
    centred = [light.translated(-model.mesh.center) for light in lights]
    at_sites = indirect_irradiance(indirect, centred, site_places(model, indirect.site))
    values = image_of_points(model, at_points(model, indirect.site, at_sites))
    image = display_u8(values / np.float32(np.pi), model.exposure)
    return Painting(image=paint_on_empty(image, hit_mask(model)), values=values)


def ambient(subject: Subject, lights: Lights) -> Painting:
    model = subject.model
    indirect = _indirect(model)
    values = image_of_points(model, at_points(model, indirect.site, indirect.ambient))
    image = display_u8(values / np.float32(np.pi), model.exposure)
    note = "measured apart" if indirect.ambient_is_separate else "not told apart from the indirect light: a prior"
    return Painting(image=paint_on_empty(image, hit_mask(model)), values=values, note=note)


def coefficients(subject: Subject, lights: Lights) -> Painting:
    """One picture for each function of the light: how strongly the irradiance at each place answers to it."""
    model = subject.model
    indirect = _indirect(model)
    shade = at_points(model, indirect.site, luminance(indirect.coefficients)[..., None])[..., 0]
    limit = upper_limit(np.abs(shade), 0.98)
    scale = Scale("RdBu_r", -limit, limit, "irradiance for a light of power 1")
    words = _FUNCTIONS.get(indirect.basis, _HARMONICS)
    cells = []
    for index in range(shade.shape[1]):
        word = words[index] if index < len(words) else f"function {index}"
        cells.append((word, paint_numbers(image_of_points(model, shade[:, index]), scale)))
    values = np.stack([image_of_points(model, shade[:, index]) for index in range(shade.shape[1])], axis=-1)
    note = f"basis {indirect.basis}, {len(indirect.coefficients):,} sites: one for each {indirect.site}"
    return Painting(image=contact_grid(cells), scale=scale, values=values, note=note)


def site_places(model: RelightModel, site: str) -> Float[np.ndarray, "site 3"]:
    """Where the sites of a kind are, in centred coordinates."""
    if site == "pixel":
        return model.pixels.points.position
    places = model.mesh.centered_vertices
    return places if site == "vertex" else places[model.mesh.faces].mean(axis=1)


def at_points(
    model: RelightModel, site: str, values: Shaped[np.ndarray, "site *channel"]
) -> Shaped[np.ndarray, "point *channel"]:
    """Values of the sites where the captured view's points are: blended between vertices, else looked up."""
    points = model.pixels.points
    if site == "vertex":
        return np.einsum("pk,pk...->p...", points.barycentric, values[model.mesh.faces[points.face]])
    if site == "face":
        return values[points.face]
    return values[model.pixels.surface] if site == "surface" else values


def _indirect(model: RelightModel) -> Indirect:
    if model.indirect is None:
        raise InputError(
            "layer", "a model without indirect light", "one that has it", "its plan leaves indirect light out"
        )
    return model.indirect

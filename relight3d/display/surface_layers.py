"""Layers of what was recovered of the surfaces: regions, texture, normals, lobes."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from relight3d.display.pictures import (
    DULL,
    Painting,
    Scale,
    Swatch,
    category_color,
    hit_mask,
    image_of_points,
    paint_numbers,
    paint_on_empty,
    painted_categories,
    painted_numbers,
    upper_limit,
)
from relight3d.display.subject import Lights, Subject
from relight3d.maths.color import display_u8, luminance
from relight3d.records import Lobe, RelightModel
from relight3d.shading import largest_albedo


def surfaces(subject: Subject, lights: Lights) -> Painting:
    model = subject.model
    named = zip(model.surfaces.names, model.surfaces.kinds)
    legend = tuple(Swatch(category_color(i), f"{name}: {', '.join(kinds)}") for i, (name, kinds) in enumerate(named))
    return painted_categories(image_of_points(model, model.pixels.surface, -1), legend)


def kinds(subject: Subject, lights: Lights) -> Painting:
    model = subject.model
    found = sorted(set(model.surfaces.kinds))
    legend = tuple(Swatch(category_color(i), " and ".join(words)) for i, words in enumerate(found))
    index = np.array([found.index(words) for words in model.surfaces.kinds], np.int32)
    return painted_categories(image_of_points(model, index[model.pixels.surface], -1), legend)


def faces(subject: Subject, lights: Lights) -> Painting:
    model = subject.model
    # Neighbouring faces get unlike greys by scrambling their numbers.
    shade = (model.pixels.points.face.astype(np.uint64) * np.uint64(2654435761) % np.uint64(1 << 32)) / 2.0**32
    grey = np.rint(70 + 150 * shade).astype(np.uint8)
    image = image_of_points(model, np.repeat(grey[:, None], 3, axis=1), 0)
    note = f"{len(model.mesh.faces):,} faces, {len(np.unique(model.pixels.points.face)):,} of them in sight"
    return Painting(image=paint_on_empty(image, hit_mask(model)), note=note)


def albedo(subject: Subject, lights: Lights) -> Painting:
    return _colors(subject.model, subject.model.pixels.albedo)


def surface_albedo(subject: Subject, lights: Lights) -> Painting:
    model = subject.model
    return _colors(model, model.surface_albedo[model.pixels.surface].astype(np.float32))


def texture(subject: Subject, lights: Lights) -> Painting:
    model = subject.model
    mean = luminance(model.surface_albedo[model.pixels.surface])
    relative = luminance(model.pixels.albedo) / np.maximum(mean, 1e-4)
    values = image_of_points(model, relative.astype(np.float32))
    painting = painted_numbers(values, "BrBG", 0.0, 2.0, "albedo, times its surface's own")
    return _without_mirrors(model, painting)


def normals_of_mesh(subject: Subject, lights: Lights) -> Painting:
    return _normals(subject.model, subject.model.pixels.points.normal)


def normals(subject: Subject, lights: Lights) -> Painting:
    return _normals(subject.model, subject.model.pixels.normal)


def relief(subject: Subject, lights: Lights) -> Painting:
    model = subject.model
    cosine = np.einsum("pi,pi->p", model.pixels.normal, model.pixels.points.normal)
    degrees = image_of_points(model, np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    limit = upper_limit(degrees, least=1.0)
    return painted_numbers(degrees, "magma", 0.0, limit, "degrees between the mesh's normal and the recovered one")


def lobe_strength(subject: Subject, lights: Lights) -> Painting:
    model = subject.model
    share = np.array([sum(_energy(lobe) for lobe in lobes) for lobes in model.lobes])
    values = share[model.pixels.surface] * model.pixels.lobe_gain
    return _lobes(model, values, "share of the light that the lobes reflect, at most")


def lobe_width(subject: Subject, lights: Lights) -> Painting:
    model = subject.model
    width = np.array([min((half_width_deg(lobe) for lobe in lobes), default=np.nan) for lobes in model.lobes])
    return _lobes(model, width[model.pixels.surface], "degrees from a highlight's peak to its half")


def half_width_deg(lobe: Lobe) -> float:
    """How far from its peak a lobe has fallen to one half; a brushed one where it is narrowest."""
    if lobe.is_halfway:  # base = 1 / (c sin^2 + cos^2) of half the angle
        steepest = max(float(max(lobe.axes[:2])) - 1.0, 1e-6)
        sine = np.sqrt(np.clip((2.0 ** (1.0 / max(lobe.exponent, 1e-6)) - 1.0) / steepest, 0.0, 1.0))
        return float(np.degrees(2 * np.arcsin(sine)))
    return float(np.degrees(np.arccos(np.clip(0.5 ** (1.0 / max(lobe.exponent, 1e-6)), -1.0, 1.0))))


def describe_lobe(lobe: Lobe) -> str:
    """A lobe's parameters in one line, in the words of eq. (4)."""
    x, y, z = lobe.axes
    red, green, blue = lobe.color
    if lobe.is_halfway:
        x, y = 1 / np.sqrt(lobe.axes[:2])
        kind = "half-way" if lobe.axes[0] == lobe.axes[1] else "brushed"
        return f"{kind}, n {lobe.exponent:.3g}, width {x:.2f} by {y:.2f}, colour ({red:.3g}, {green:.3g}, {blue:.3g})"
    return f"n {lobe.exponent:.3g}, C ({x:.2f}, {y:.2f}, {z:.2f}), colour ({red:.3g}, {green:.3g}, {blue:.3g})"


def _energy(lobe: Lobe) -> float:
    return float(np.mean(lobe.color)) * largest_albedo(lobe)


def _colors(model: RelightModel, colors: Float[np.ndarray, "point 3"]) -> Painting:
    values = image_of_points(model, colors)
    return _without_mirrors(model, Painting(image=paint_on_empty(display_u8(values), hit_mask(model)), values=values))


def _without_mirrors(model: RelightModel, painting: Painting) -> Painting:
    """Mirrors painted over: what they show is not theirs."""
    is_mirror = model.surfaces.which("mirror")
    if not is_mirror.any():
        return painting
    image = painting.image.copy()
    image[image_of_points(model, is_mirror[model.pixels.surface], False)] = DULL
    return replace(painting, image=image, legend=(*painting.legend, Swatch(DULL, "a mirror, which has none")))


def _normals(model: RelightModel, normal: Float[np.ndarray, "point 3"]) -> Painting:
    """Normals in the camera's axes as colours: right red, up green, towards the viewer blue."""
    in_camera = normal @ model.camera.world_from_camera[:3, :3].astype(np.float32)
    values = image_of_points(model, in_camera.astype(np.float32))
    image = np.rint(np.clip(np.nan_to_num(values) * 0.5 + 0.5, 0.0, 1.0) * 255).astype(np.uint8)
    legend = (
        Swatch((255, 128, 128), "faces right"),
        Swatch((128, 255, 128), "faces up"),
        Swatch((128, 128, 255), "faces the camera"),
    )
    return Painting(image=paint_on_empty(image, hit_mask(model)), legend=legend, values=values)


def _lobes(model: RelightModel, per_point: Float[np.ndarray, " point"], label: str) -> Painting:
    """Numbers of glossy surfaces, the others dark; the note holds the lobes themselves."""
    has_lobe = np.array([len(lobes) > 0 for lobes in model.lobes], bool)[model.pixels.surface]
    values = image_of_points(model, np.where(has_lobe, per_point, np.nan).astype(np.float32))
    scale = Scale("viridis", 0.0, upper_limit(values, 1.0), label)
    dull = Swatch(DULL, "no lobe")
    image = paint_numbers(values, scale)
    image[image_of_points(model, ~has_lobe, False)] = dull.color
    named = zip(model.surfaces.names, model.lobes)
    note = "; ".join(f"{name}: {describe_lobe(lobe)}" for name, lobes in named for lobe in lobes)
    return Painting(image=image, legend=(dull,), scale=scale, values=values, note=note)

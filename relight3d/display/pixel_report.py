"""One pixel, looked at: what the photographs measured there, what the model says, and the parameters behind it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from relight3d.display.light_layers import at_points
from relight3d.display.subject import Subject
from relight3d.display.surface_layers import describe_lobe
from relight3d.errors import InputError
from relight3d.maths.color import luminance
from relight3d.maths.least_squares import Status
from relight3d.records import Capture, RelightModel
from relight3d.shading import cast_light

TERMS = ("indirect", "direct", "specular", "mirror")


@dataclass(frozen=True, eq=False)
class PixelReport:
    """A pixel of the captured view over all photographs, in their order; linear radiance.

    `measured` is NaN where a photograph is masked, and everywhere without a capture. `terms` holds what the model's
    values are the sum of, by name. `parameters` are lines of what was recovered there, for a person.
    """

    x: int
    y: int
    surface: str
    photographs: tuple[str, ...]
    measured: Float32[np.ndarray, "photo 3"]
    predicted: Float32[np.ndarray, "photo 3"]
    terms: dict[str, Float32[np.ndarray, "photo 3"]]
    is_lit: Bool[np.ndarray, " photo"]
    parameters: tuple[tuple[str, str], ...]

    @property
    def order(self) -> np.ndarray:
        """The photographs sorted by the model's value, brightest first: along it the model's values are a curve."""
        return np.argsort(-luminance(self.predicted), kind="stable")

    @property
    def rms_error(self) -> float:
        """Root mean square of predicted minus measured, NaN without a measurement."""
        known = np.isfinite(self.measured)
        return float(np.sqrt(np.mean((self.predicted - self.measured)[known] ** 2))) if known.any() else float("nan")

    def figure(self):
        """Measured dots against the model's curve and its terms, and the parameters beside, as a matplotlib Figure."""
        from relight3d.display.pixel_figure import figure_of

        return figure_of(self)


def inspect_pixel(model: RelightModel, capture: Capture | None, x: int, y: int) -> PixelReport:
    """Look at the pixel in column x and row y. Raises InputError outside of the picture or where the mesh is not."""
    return inspect_subject(Subject(model, capture), x, y)


def inspect_subject(subject: Subject, x: int, y: int) -> PixelReport:
    """`inspect_pixel` of a subject, which keeps the frames of all photographs' lights for the next pixel."""
    model = subject.model
    point = point_of_pixel(model, x, y)
    num = len(model.lights)
    measured = np.full((num, 3), np.nan, np.float32)
    names = tuple(f"photograph {index}" for index in range(num))
    if subject.capture is not None:
        radiance, is_valid = subject.measured
        measured = np.where(is_valid[:, y, x, None], radiance[:, y, x], np.float32(np.nan))
        names = tuple(photograph.name for photograph in subject.photographs)
    terms = {}
    for name in TERMS:
        parts = [getattr(frame.terms, name) for frame in subject.predicted]
        if parts and all(part is not None for part in parts):
            terms[name] = np.stack([part[y, x] for part in parts])
    return PixelReport(
        x=x,
        y=y,
        surface=model.surfaces.names[model.pixels.surface[point]],
        photographs=names,
        measured=measured,
        predicted=np.stack([frame.radiance[y, x] for frame in subject.predicted]),
        terms=terms,
        is_lit=_lit_in(subject, point),
        parameters=tuple(_parameters(model, point)),
    )


def point_of_pixel(model: RelightModel, x: int, y: int) -> int:
    """The point that a pixel sees. Raises InputError outside of the picture or where the mesh is not."""
    camera = model.camera
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        raise InputError("pixel x, y", (x, y), f"within {camera.width} x {camera.height}")
    found = np.flatnonzero(model.pixels.points.pixel == y * camera.width + x)
    if len(found) == 0:
        raise InputError("pixel x, y", (x, y), "a pixel that sees the mesh")
    return int(found[0])


def _lit_in(subject: Subject, point: int) -> Bool[np.ndarray, " photo"]:
    model = subject.model
    alone = model.pixels.points.take(np.array([point]))
    normal = model.pixels.normal[[point]]
    offset = -model.mesh.center
    return np.array(
        [
            any(cast_light(subject.scene, alone, light.translated(offset), normal).is_lit[0] for light in lights)
            for lights in model.lights
        ],
        dtype=bool,
    )


def _parameters(model: RelightModel, point: int) -> list[tuple[str, str]]:
    pixels = model.pixels
    surface = int(pixels.surface[point])
    turned = np.clip(pixels.normal[point] @ pixels.points.normal[point], -1.0, 1.0)
    lines = [
        ("surface", f"{model.surfaces.names[surface]} ({', '.join(model.surfaces.kinds[surface])})"),
        ("place", _vector(pixels.points.position[point] + model.mesh.center)),
        ("normal", _vector(pixels.normal[point])),
        ("detail", f"turned by {np.degrees(np.arccos(turned)):.1f}°"),
        ("albedo", _vector(pixels.albedo[point])),
        ("surface's", _vector(model.surface_albedo[surface])),
    ]
    lines += [(f"lobe {i + 1}", describe_lobe(lobe)) for i, lobe in enumerate(model.lobes[surface])]
    if model.lobes[surface]:
        lines.append(("lobe gain", f"{pixels.lobe_gain[point]:.2f}"))
    for mirror in model.mirrors:
        if mirror.surface == surface:
            lines.append(("mirror", f"reflects {_vector(mirror.reflectance)}, edge score {mirror.score:.2f}"))
    if model.indirect is not None:
        here = at_points(model, model.indirect.site, luminance(model.indirect.coefficients)[..., None])[point, :, 0]
        lines.append(("indirect", f"{model.indirect.basis}: {' '.join(f'{c:.3g}' for c in here)}"))
    lines.append(("lit in", f"{pixels.num_lit[point]} of {len(model.lights)} photographs"))
    return lines + _health(model, point)


def _health(model: RelightModel, point: int) -> list[tuple[str, str]]:
    """Status, rank and condition of the fits that this pixel reads; of a face's corners the worst."""
    lines = []
    face, surface = model.pixels.points.face[point], model.pixels.surface[point]
    sites = {"vertex": model.mesh.faces[face], "face": [face], "pixel": [point], "surface": [surface]}
    for name, health in model.health.items():
        if health.site in sites:
            index = np.asarray(sites[health.site])
            worst = index[np.argmax(health.status[index])]
            status = Status(int(health.status[worst])).name.replace("_", " ").lower()
            text = f"{status}, rank {health.rank[worst]}, condition {health.condition[worst]:.3g}"
            lines.append((f"fit: {name}", text))
    return lines


def _vector(values: Float[np.ndarray, " n"]) -> str:
    return " ".join(f"{value:.3f}" for value in np.asarray(values, np.float64))

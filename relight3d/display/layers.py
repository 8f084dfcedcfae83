"""Inspection layers by name: pictures of everything that was recovered, of its evidence, and of how far to trust it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from relight3d.display import evidence_layers, health_layers, light_layers, surface_layers
from relight3d.display.pictures import Layer, Painting
from relight3d.display.subject import Lights, Subject
from relight3d.errors import InputError
from relight3d.records import Capture, RelightModel


@dataclass(frozen=True)
class LayerKind:
    """What a layer shows, and who paints it."""

    title: str
    caption: str  # one line for a person who is new here
    paint: Callable[[Subject, Lights], Painting]
    needs_capture: bool = False


_surface, _light, _evidence, _health = surface_layers, light_layers, evidence_layers, health_layers

LAYERS: Mapping[str, LayerKind] = {
    # What was recovered.
    "surfaces": LayerKind("Surfaces", "Regions of one material, one colour each.", _surface.surfaces),
    "kinds": LayerKind("Kinds", "What the photographs say each surface is.", _surface.kinds),
    "faces": LayerKind("Faces", "The triangles that rays are traced against, one shade each.", _surface.faces),
    "albedo": LayerKind(
        "De-lit texture", "The scene's own colours, with all light and shadow taken out.", _surface.albedo
    ),
    "surface_albedo": LayerKind("Albedo", "One colour a surface, its pattern left out.", _surface.surface_albedo),
    "texture": LayerKind("Texture alone", "How much lighter or darker than its surface a pixel is.", _surface.texture),
    "normals_mesh": LayerKind("Normals of the mesh", "Which way the mesh faces.", _surface.normals_of_mesh),
    "normals": LayerKind(
        "Normals with detail", "Which way each pixel faces, with the relief that the photographs reveal.",
        _surface.normals,
    ),
    "relief": LayerKind("Relief", "How far the photographs turn each pixel from the mesh.", _surface.relief),
    "lobe_strength": LayerKind("Gloss", "How much light shiny surfaces reflect as highlights.", _surface.lobe_strength),
    "lobe_width": LayerKind("Sharpness", "How wide a highlight is on each shiny surface.", _surface.lobe_width),
    # The light, now.
    "relit": LayerKind("Relit", "The scene under these lights.", _light.relit),
    "direct": LayerKind("Direct light", "Straight from the lamps, with traced shadows.", _light.term("direct")),
    "specular": LayerKind("Highlights", "What shiny surfaces add.", _light.term("specular")),
    "indirect": LayerKind(
        "Indirect light", "What comes by way of other surfaces, or from the room.", _light.term("indirect")
    ),
    "mirror": LayerKind("Mirrors", "What the mirrors show.", _light.term("mirror")),
    "shadows": LayerKind("Shadows", "Which pixels see the light, by tracing rays.", _light.shadows),
    "irradiance": LayerKind(
        "Indirect irradiance", "Indirect light alone, as a white sheet over everything would show it.",
        _light.irradiance,
    ),
    "ambient": LayerKind("Ambient", "The room's light with every lamp off, on a white sheet.", _light.ambient),
    "coefficients": LayerKind(
        "Indirect coefficients", "How indirect light grows (red) or falls (blue) as the lamp moves along an axis.",
        _light.coefficients,
    ),
    # Evidence, in the photographs.
    "photographs": LayerKind("Photographs", "What everything was recovered from.", _evidence.photographs, True),
    "shadow_borders": LayerKind(
        "Shadow borders", "Pixels across a cast shadow: their difference says how much light a surface reflects.",
        _evidence.shadow_borders, True,
    ),
    "mirror_edges": LayerKind(
        "Mirror edges", "Edges that each surface would show if it were a mirror, and those it shows.",
        _evidence.mirror_edges, True,
    ),
    "residual": LayerKind("Residual", "How far the model is from the photographs.", _evidence.residual, True),
    "residual_photographs": LayerKind(
        "Residual by photograph", "Where the model is too bright (red) or too dark (blue).",
        _evidence.residual_photographs, True,
    ),
    # Trust.
    "trust": LayerKind("Trust", "How well each pixel is known: in how many photographs it is lit.", _health.trust),
    "plan": LayerKind("Effects plan", "Which effects each surface has; absent ones cost nothing.", _health.plan),
}  # fmt: skip

_MEASURES = {
    "status": ("Status", "Whether the data answered each fit, or a fallback did."),
    "rank": ("Rank", "How many unknowns of each fit the data decides."),
    "condition": ("Condition", "How much each fit magnifies noise."),
}


def layer_names(model: RelightModel, has_capture: bool = True) -> tuple[str, ...]:
    """The layers that can be made of a model, with its capture or without; "status:NAME" for the fits it reports on."""
    names = [name for name, kind in LAYERS.items() if has_capture or not kind.needs_capture]
    if model.indirect is None:
        names = [name for name in names if name not in ("irradiance", "ambient", "coefficients")]
    return (*names, *health_layers.health_names(model))


def layer(model: RelightModel, name: str, capture: Capture | None = None, lights: Lights | None = None) -> Layer:
    """One layer of a model, under lights (by default some of the photographed ones).

    Raises InputError for an unknown name, and for a layer of evidence without the capture.
    """
    return paint_layer(Subject(model, capture), name, lights)


def paint_layer(subject: Subject, name: str, lights: Lights | None = None) -> Layer:
    """`layer` of a subject, which keeps what several layers share."""
    kind = layer_kind(name)
    if kind.needs_capture and subject.capture is None:
        hint = "give it: the layer shows what was read from the photographs"
        raise InputError(f"layer {name}", "no capture", "the capture of the model", hint)
    painting = kind.paint(subject, subject.default_lights if lights is None else tuple(lights))
    return Layer(name=name, title=kind.title, caption=kind.caption, **vars(painting))


def layer_kind(name: str) -> LayerKind:
    """What a layer shows, by its name. Raises InputError for an unknown one."""
    measure, _, family = name.partition(":")
    if family and measure in _MEASURES:
        title, caption = _MEASURES[measure]
        return LayerKind(f"{title}: {family}", caption, health_layers.health_layer(measure, family))
    if name not in LAYERS:
        fits = ", ".join(f"{measure}:FIT" for measure in _MEASURES)
        raise InputError("layer", name, f"one of {', '.join(LAYERS)}, {fits}")
    return LAYERS[name]

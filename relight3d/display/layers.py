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
    group: str
    needs_capture: bool = False


_surface, _light, _evidence, _health = surface_layers, light_layers, evidence_layers, health_layers

LAYERS: Mapping[str, LayerKind] = {
    # What was recovered.
    "surfaces": LayerKind("Surfaces", "The regions of one material.", _surface.surfaces, "surfaces"),
    "kinds": LayerKind("Kinds", "What the photographs say each surface is.", _surface.kinds, "surfaces"),
    "faces": LayerKind("Faces", "The mesh that rays meet, one shade a face.", _surface.faces, "surfaces"),
    "albedo": LayerKind("De-lit texture", "Albedo of each pixel: no light, no shadow.", _surface.albedo, "surfaces"),
    "surface_albedo": LayerKind("Albedo", "The one albedo of each surface.", _surface.surface_albedo, "surfaces"),
    "texture": LayerKind("Texture alone", "Albedo over its surface's own.", _surface.texture, "surfaces"),
    "normals_mesh": LayerKind("Normals of the mesh", "Before detail.", _surface.normals_of_mesh, "surfaces"),
    "normals": LayerKind("Normals with detail", "What shading uses.", _surface.normals, "surfaces"),
    "relief": LayerKind("Relief", "How far the detail turns each normal.", _surface.relief, "surfaces"),
    "lobe_strength": LayerKind("Gloss", "How much the lobes reflect.", _surface.lobe_strength, "surfaces"),
    "lobe_width": LayerKind("Sharpness", "How wide a highlight is.", _surface.lobe_width, "surfaces"),
    # The light, now.
    "relit": LayerKind("Relit", "The frame under these lights.", _light.relit, "light"),
    "direct": LayerKind("Direct light", "Diffuse, with traced shadows.", _light.term("direct"), "light"),
    "specular": LayerKind("Highlights", "What the lobes add.", _light.term("specular"), "light"),
    "indirect": LayerKind("Indirect light", "From other surfaces, and ambient.", _light.term("indirect"), "light"),
    "mirror": LayerKind("Mirrors", "What is seen in them.", _light.term("mirror"), "light"),
    "shadows": LayerKind("Shadows", "Which pixels see the light, by rays.", _light.shadows, "light"),
    "irradiance": LayerKind(
        "Indirect irradiance", "Indirect and ambient light on a white sheet laid over the scene.",
        _light.indirect_light, "light",
    ),
    "ambient": LayerKind("Ambient", "Light with every lamp off, on a white sheet.", _light.ambient_light, "light"),
    "coefficients": LayerKind(
        "Indirect coefficients", "How the indirect light at each place answers to the light's direction.",
        _light.indirect_coefficients, "light",
    ),
    # Evidence, in the photographs.
    "photographs": LayerKind(
        "Photographs", "What everything was recovered from.", _evidence.photographs, "evidence", True
    ),
    "shadow_borders": LayerKind(
        "Shadow borders", "Pairs of pixels across a cast shadow, from which reflectance is read.",
        _evidence.shadow_borders, "evidence", True,
    ),
    "mirror_edges": LayerKind(
        "Mirror edges", "Edges that each surface would show if it were a mirror, and those it shows.",
        _evidence.mirror_edges, "evidence", True,
    ),
    "residual": LayerKind("Residual", "What the model misses.", _evidence.residual, "evidence", True),
    "residual_photographs": LayerKind(
        "Residual by photograph", "Where the model is too bright (red) or too dark (blue).",
        _evidence.residual_photographs, "evidence", True,
    ),
    # Trust.
    "trust": LayerKind("Trust", "Where a relit pixel rests on little: never seen, never lit.", _health.trust, "trust"),
    "plan": LayerKind("Effects plan", "Which effects run on which surface.", _health.plan, "trust"),
}  # fmt: skip

_MEASURES = {
    "status": ("Status", "Whether each fit was answered by its data."),
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
        return LayerKind(f"{title}: {family}", caption, health_layers.health_layer(measure, family), "trust")
    if name not in LAYERS:
        fits = ", ".join(f"{measure}:FIT" for measure in _MEASURES)
        raise InputError("layer", name, f"one of {', '.join(LAYERS)}, {fits}")
    return LAYERS[name]

"""How frames and models show themselves in a notebook: HTML with the picture in it."""

from html import escape

import numpy as np

from relight3d.display.embedded import chart_address, photo_address
from relight3d.display.frames import show_frame_u8
from relight3d.display.layers import paint_layer
from relight3d.display.subject import Subject
from relight3d.records import Frame, RelightModel

_WIDTH = 480  # pixels a picture is shown with


def html_of_frame(frame: Frame) -> str:
    """The relit frame under its exposure, with its size and cost below."""
    height, width = frame.is_hit.shape
    text = f"{width} × {height} px, {frame.stats.total_ms:.1f} ms, {frame.stats.num_rays:,} rays"
    return _figure(photo_address(show_frame_u8(frame)), text, "A relit frame")


def html_of_model(model: RelightModel) -> str:
    """Texture and surfaces of a model side by side, and what there is of each thing, with its warnings."""
    subject = Subject(model)
    albedo, surfaces = (paint_layer(subject, name) for name in ("albedo", "surfaces"))
    pictures = _figure(photo_address(albedo.image), "de-lit texture", albedo.title)
    pictures += _figure(chart_address(surfaces.image), "surfaces", surfaces.title)
    rows = [
        ("picture", f"{model.camera.width} × {model.camera.height} px"),
        ("mesh", f"{len(model.mesh.faces):,} faces"),
        ("photographs", f"{len(model.lights)}"),
        ("surfaces", ", ".join(_surface(model, index) for index in range(model.surfaces.num_surfaces))),
        ("indirect light", _indirect(model)),
        *(("warning", line) for line in model.warnings),
    ]
    cells = "".join(
        f'<tr><td style="text-align:left;color:gray">{escape(word)}</td>'
        f'<td style="text-align:left;white-space:normal">{escape(text)}</td></tr>'
        for word, text in rows
    )
    return f'<div>{pictures}<table style="clear:both">{cells}</table></div>'


def _surface(model: RelightModel, index: int) -> str:
    num_lobes = len(model.lobes[index])
    lobes = f", {num_lobes} lobe{'s' if num_lobes > 1 else ''}" if num_lobes else ""
    return f"{model.surfaces.names[index]} ({', '.join(model.surfaces.kinds[index])}{lobes})"


def _indirect(model: RelightModel) -> str:
    if model.indirect is None:
        return "none"
    num_sites, num_functions, _ = np.shape(model.indirect.coefficients)
    return f"{num_functions} functions ({model.indirect.basis}) at each {model.indirect.site}, {num_sites:,} of them"


def _figure(address: str, text: str, alt: str) -> str:
    return (
        f'<figure style="display:inline-block;margin:0 12px 8px 0">'
        f'<img src="{address}" alt="{escape(alt)}" style="width:{_WIDTH}px;max-width:100%">'
        f'<figcaption style="color:gray;font-size:90%">{escape(text)}</figcaption></figure>'
    )

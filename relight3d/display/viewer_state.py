"""What the viewer shows and how it answers: all of it without a window, so that it can be tested and scripted."""

import textwrap
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float32, UInt8
from PIL import Image

from relight3d.display.effects import FrameMaker, Speed, effects_of, make_frame_maker, share_of_effect
from relight3d.display.gizmo import Gizmo
from relight3d.display.layers import LAYERS, layer_names, paint_layer
from relight3d.display.light_dome import LightDome
from relight3d.display.light_rack import LightRack
from relight3d.display.orbit import orbited, panned, seen_from, vertex_colors, zoomed
from relight3d.display.pictures import EMPTY, Layer
from relight3d.display.pixel_report import TERMS, PixelReport, inspect_subject
from relight3d.display.subject import Subject
from relight3d.errors import InputError
from relight3d.lights import Light
from relight3d.maths.color import display_u8
from relight3d.records import Capture, Frame, RelightModel
from relight3d.relight.relighter import Relighter

RELIT = "relit"
Picture = UInt8[np.ndarray, "rows columns 3"]


class ViewerState:
    """Lights, camera, exposure, layer and looked-at pixel; and the picture that they make.

    Nothing is rendered until a picture is asked for, and nothing twice.
    """

    def __init__(
        self, model: RelightModel, capture: Capture | None = None, lights: Sequence[Light] | None = None
    ) -> None:
        self.subject = Subject(model, capture)
        self.model = model
        self.camera = model.camera
        self.dome = LightDome.of(model)
        self.rack = LightRack.of(self.dome, self.subject.default_lights if lights is None else lights)
        self.exposure_stops = 0.0
        self.layer_name = RELIT
        self.speed = Speed()
        self.effects = effects_of(model)
        self.shows_gizmo = True
        self.pixel: PixelReport | None = None
        self.message = ""
        points = model.pixels.points.position
        self.pivot = model.mesh.center + (np.median(points, axis=0) if len(points) else np.zeros(3))
        self._frame: tuple[tuple, Frame] | None = None
        self._picture: tuple[tuple, Picture] | None = None
        self._maker: tuple[Speed, FrameMaker] | None = None
        self._moved: tuple[tuple, Relighter] | None = None
        self._layer: tuple[tuple, Layer] | None = None
        self._shares: tuple[tuple, dict[str, float]] = ((), {})

    # ----------------------------------------------------------------------------- what is shown

    @property
    def exposure(self) -> float:
        return self.model.exposure * 2.0**self.exposure_stops

    @property
    def is_captured_view(self) -> bool:
        return self.camera.same_as(self.model.camera)

    @property
    def names_of_layers(self) -> tuple[str, ...]:
        """What the layers menu lists; the relit frame comes first."""
        names = layer_names(self.model, self.subject.capture is not None)
        return (RELIT, *(name for name in names if name != RELIT))

    def frame(self) -> Frame:
        """The relit frame of the present camera, lights and speed."""
        key = (self.camera, self.rack.entries, self.speed)
        if self._frame is None or not _same(self._frame[0], key):
            self._frame = (key, self.relighter().render(list(self.rack.active)))
        return self._frame[1]

    def picture(self) -> Picture:
        """The relit frame, or the layer chosen, at the camera's size."""
        key = (self.camera, self.rack.entries, self.speed, self.exposure, self.layer_name)
        if self._picture is None or not _same(self._picture[0], key):
            self._picture = (key, self._painted())
        return self._picture[1]

    def layer(self) -> Layer:
        """The layer chosen, of the captured view, under the present lights."""
        key = (self.rack.entries, self.layer_name)
        if self._layer is None or not _same(self._layer[0], key):
            self._layer = (key, paint_layer(self.subject, self.layer_name, self.rack.active))
        return self._layer[1]

    def quick_colors(self) -> Float32[np.ndarray, "vertex 3"]:
        """Display values for the vertices, for a mesh view while the camera moves: the captured view's picture."""
        if self.layer_name == RELIT:
            captured = self.maker().captured.render(list(self.rack.active))
            return vertex_colors(self.model, display_u8(captured.radiance, self.exposure))
        image = self.layer().image
        size = (self.model.camera.height, self.model.camera.width)
        return vertex_colors(self.model, image if image.shape[:2] == size else np.full((*size, 3), EMPTY, np.uint8))

    def shares(self) -> dict[str, float]:
        """What is known of the effects' worth in this frame: by how many percent of its light each changes it."""
        key = (self.camera, self.rack.entries, self.speed)
        if not _same(self._shares[0], key):
            self._shares = (key, {})
        return self._shares[1]

    def measure_next_share(self) -> bool:
        """Find out one more effect's worth, which takes another frame; False where all are known."""
        known = self.shares()
        waiting = [name for name in self.effects if name not in known and name not in self.speed.off]
        if waiting:
            lights, frame = self.rack.active, self.frame()
            known[waiting[0]] = share_of_effect(self.model, self.speed, waiting[0], self.camera, lights, frame)
        return len(waiting) > 1

    def cost_lines(self) -> list[str]:
        """The frame's time and rays, and what a budget gave up, for a person."""
        stats = self.frame().stats
        kept = (
            ", shadows as before"
            if self.rack.active and stats.num_rays == 0 and "shadows" not in self.speed.off
            else ""
        )
        lines = [f"frame: {stats.total_ms:.1f} ms, {stats.num_rays:,} rays{kept}"]
        lines += [f"  {name}: {milliseconds:.1f} ms" for name, milliseconds in stats.milliseconds.items()]
        return [*lines, *self.maker().notes]

    def layer_lines(self) -> list[str]:
        """How to read the layer shown, for a person."""
        if self.layer_name == RELIT or self.layer_name in TERMS:
            return [LAYERS[self.layer_name].caption]
        shown = self.layer()
        lines = [shown.caption, *textwrap.wrap(shown.note, 44)]
        if shown.scale is not None:
            lines += [f"{shown.scale.low:g} to {shown.scale.high:g}:", *textwrap.wrap(shown.scale.label, 44)]
        return lines

    def display(self, width: int, height: int) -> tuple[Picture, tuple[int, int, int, int]]:
        """The picture fitted into a window of that size, with the lights drawn over it; and its box (x, y, w, h)."""
        picture = self.picture()
        box = fitted_box(picture.shape[1], picture.shape[0], width, height)
        scale = box[2] / picture.shape[1]
        way = Image.Resampling.NEAREST if scale >= 2 else Image.Resampling.LANCZOS
        shown = np.asarray(Image.fromarray(picture).resize(box[2:], way if scale != 1 else Image.Resampling.NEAREST))
        if self.shows_gizmo and self.layer_name in (RELIT, *TERMS, "shadows", "irradiance"):
            shown = self.gizmo.drawn(shown, self.rack.shown, self.rack.selected)
        canvas = np.full((height, width, 3), EMPTY, np.uint8)
        canvas[box[1] : box[1] + box[3], box[0] : box[0] + box[2]] = shown
        return canvas, box

    @property
    def gizmo(self) -> Gizmo:
        return Gizmo(self.dome, self.camera, self.pivot)

    # ----------------------------------------------------------------------------- how it answers

    def set_layer(self, name: str) -> None:
        """Choose a layer by name, or the relit frame. Raises InputError for an unknown one."""
        if name not in self.names_of_layers:
            raise InputError("layer", name, f"one of {', '.join(self.names_of_layers)}")
        self.layer_name = name

    def switch_effect(self, name: str, is_on: bool) -> None:
        """Leave one effect out of the frame, and its cost too, or bring it back."""
        assert name in self.effects
        self.speed = replace(self.speed, off=self.speed.off - {name} if is_on else self.speed.off | {name})

    def set_speed(self, preset: str, budget_ms: float | None = None) -> None:
        """Choose a preset, or with a budget the most accurate settings that fit it."""
        self.speed = replace(self.speed, preset=preset, budget_ms=budget_ms)

    def orbit(self, x_px: float, y_px: float) -> None:
        """Carry the camera around the scene as a drag over so many of its pixels asks: the width is half a turn."""
        per_px = np.pi / self.camera.width
        self.camera = orbited(self.camera, self.pivot, self.dome.pole, -x_px * per_px, y_px * per_px)

    def zoom(self, steps: float) -> None:
        self.camera = zoomed(self.camera, self.pivot, 0.9**steps)

    def pan(self, x_px: float, y_px: float) -> None:
        self.camera = panned(self.camera, self.pivot, x_px, y_px)

    def reset_camera(self) -> None:
        """Back to the captured view, exactly."""
        self.camera = self.model.camera

    def inspect(self, x: float, y: float) -> None:
        """Look at the pixel at a place in the picture; from elsewhere, at the captured pixel of the same spot."""
        try:
            column, row = self._captured_pixel(int(x), int(y))
            self.pixel = inspect_subject(self.subject, column, row)
            self.message = ""
        except InputError as error:
            self.pixel, self.message = None, f"pixel ({int(x)}, {int(y)}): {error.got}"

    def _captured_pixel(self, x: int, y: int) -> tuple[int, int]:
        if self.is_captured_view:
            return x, y
        view = self.relighter().view
        found = np.flatnonzero(view.points.pixel == y * self.camera.width + x)
        if len(found) == 0 or view.share[found[0]].sum() == 0:
            raise InputError("pixel", "a spot that the photographs did not see", "one that they did")
        source = view.source[found[0], np.argmax(view.share[found[0]])]
        row, column = divmod(int(self.model.pixels.points.pixel[source]), self.model.camera.width)
        return column, row

    # ----------------------------------------------------------------------------- how it is made

    def maker(self) -> FrameMaker:
        """The present speed's settings, and their relighter of the captured view."""
        if self._maker is None or self._maker[0] != self.speed:
            if self.speed == Speed():
                relighter = self.subject.relighter
                self._maker = (self.speed, FrameMaker(self.model, relighter.options, (), relighter))
            else:
                self._maker = (self.speed, make_frame_maker(self.model, self.speed))
        return self._maker[1]

    def relighter(self) -> Relighter:
        """The present camera's relighter; one that is not the captured view's is kept until the camera moves on."""
        if self.is_captured_view:
            return self.maker().captured
        key = (self.camera, self.speed)
        if self._moved is None or not _same(self._moved[0], key):
            self._moved = (key, self.maker().seen_from(self.camera))
        return self._moved[1]

    def _painted(self) -> Picture:
        if self.layer_name == RELIT:
            return display_u8(self.frame().radiance, self.exposure)
        if self.layer_name in TERMS:
            part = getattr(self.frame().terms, self.layer_name)
            return display_u8(np.zeros_like(self.frame().radiance) if part is None else part, self.exposure)
        image = self.layer().image
        size = (self.model.camera.height, self.model.camera.width)
        if self.is_captured_view or image.shape[:2] != size:
            return image
        return seen_from(self.subject.scene, self.model, self.camera, image)


def _same(key: tuple, other: tuple) -> bool:
    """Whether nothing that a result was made from has changed: the same objects, or equal plain values."""
    return len(key) == len(other) and all(
        a is b or (isinstance(a, str | float | Speed) and a == b) for a, b in zip(key, other)
    )


def fitted_box(columns: int, rows: int, width: int, height: int) -> tuple[int, int, int, int]:
    """The largest box (x, y, w, h) of a picture's shape in the middle of a window."""
    scale = min(width / columns, height / rows)
    size = max(1, round(columns * scale)), max(1, round(rows * scale))
    return (width - size[0]) // 2, (height - size[1]) // 2, *size


def title_of(name: str) -> str:
    """A layer's name as menus show it."""
    return LAYERS[name].title if name in LAYERS else name.replace(":", ": ")

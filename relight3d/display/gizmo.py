"""The lights drawn into the picture, on a hemisphere about the scene, and dragged there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw

from relight3d.camera import Camera
from relight3d.display.light_dome import RIM_DEG, LightDome, knob_color
from relight3d.lights import DirectionalLight, Light

_LINE, _STEM, _INK = (255, 255, 255, 70), (255, 255, 255, 150), (20, 20, 22, 255)
_FILL = 0.84  # of the shorter side of the picture: the dome stays in sight


@dataclass(frozen=True, eq=False)
class Gizmo:
    """A hemisphere about `center` (world), as large as the camera's picture has room for."""

    dome: LightDome
    camera: Camera
    center: Float[np.ndarray, "3"]

    @property
    def radius(self) -> float:
        depth = float((self.camera.center - self.center) @ self.camera.world_from_camera[:3, 2])
        room = min(self.camera.width / self.camera.fx, self.camera.height / self.camera.fy)
        return 0.5 * _FILL * room * max(depth, 1e-9)

    def place_of(self, light: Light) -> Float[np.ndarray, "3"]:
        """Where a light's knob stands: a lamp's where it is if that is in sight, else on the hemisphere."""
        if not isinstance(light, DirectionalLight):
            position = np.asarray(light.position, np.float64)
            if self._is_in_sight(position):
                return position
        return self.center + self.radius * self.dome.direction_of(light)

    def knob(self, light: Light) -> tuple[float, float]:
        """The knob's place in the picture (x, y in pixels); NaN behind the camera."""
        image, _ = self.camera.project(self.place_of(light)[None])
        return float(image[0, 0]), float(image[0, 1])

    def pick(self, lights: Sequence[Light], x: float, y: float, reach_px: float) -> int | None:
        """The light whose knob is nearest to a place in the picture, within reach."""
        places = np.array([self.knob(light) for light in lights]).reshape(-1, 2)
        away = np.nan_to_num(np.hypot(places[:, 0] - x, places[:, 1] - y), nan=np.inf)
        return int(np.argmin(away)) if len(away) and away.min() <= reach_px else None

    def dragged(self, light: Light, x: float, y: float) -> Light:
        """The light with its knob under a place in the picture: a lamp keeps its depth, others stay on the dome."""
        way = self.camera.directions(np.array([[x, y]]))[0]
        if not isinstance(light, DirectionalLight) and self._is_in_sight(np.asarray(light.position, np.float64)):
            axis = -self.camera.world_from_camera[:3, 2]
            depth = float((np.asarray(light.position) - self.camera.center) @ axis)
            place = self.camera.center + way * depth / max(float(way @ axis), 1e-6)
            return light.translated(place - np.asarray(light.position))
        return self.dome.turned_to(light, self._direction_under(way))

    def drawn(
        self, picture: UInt8[np.ndarray, "rows columns 3"], lights: Sequence[tuple[Light, bool]], selected: int
    ) -> UInt8[np.ndarray, "rows columns 3"]:
        """The picture, of any size, with the dome and the knobs over it; lights switched off are hollow."""
        rows, columns, _ = picture.shape
        scale = np.array([columns / self.camera.width, rows / self.camera.height])
        overlay = Image.new("RGBA", (columns, rows), (0, 0, 0, 0))
        draw = ImageDraw.Draw(overlay)
        for line in self._outline():
            self._draw_line(draw, line, scale, _LINE, 1)
        knob = max(5.0, 0.012 * columns)
        for index, (light, is_on) in enumerate(lights):
            place = self.place_of(light)
            if not self._is_in_front(place):
                continue
            self._draw_line(draw, np.stack([self.center, place]), scale, _STEM, 1)
            x, y = np.array(self.knob(light)) * scale
            fill = (*knob_color(light), 255) if is_on else (0, 0, 0, 90)
            draw.ellipse((x - knob - 1, y - knob - 1, x + knob + 1, y + knob + 1), None, _INK, 2)
            draw.ellipse((x - knob, y - knob, x + knob, y + knob), fill, _STEM[:3], 3 if index == selected else 1)
        return np.asarray(Image.alpha_composite(Image.fromarray(picture).convert("RGBA"), overlay).convert("RGB"))

    def _outline(self) -> list[Float[np.ndarray, "step 3"]]:
        """The horizon and two meridians of the hemisphere."""
        around = np.linspace(0, 2 * np.pi, 73)[:, None]
        over = np.linspace(-np.pi / 2, np.pi / 2, 37)[:, None]
        dome = self.dome
        lines = [np.cos(around) * dome.right + np.sin(around) * dome.ahead]
        lines += [np.sin(over) * side + np.cos(over) * dome.pole for side in (dome.right, dome.ahead)]
        return [self.center + self.radius * line for line in lines]

    def _draw_line(
        self, draw: ImageDraw.ImageDraw, line: np.ndarray, scale: np.ndarray, color: tuple, width: int
    ) -> None:
        image, _ = self.camera.project(line)
        if np.isfinite(image).all():
            draw.line([(float(x), float(y)) for x, y in image * scale], fill=color, width=width)

    def _direction_under(self, way: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """The dome's direction where a viewing ray meets it first; beside it, the nearest of its outline."""
        offset = self.camera.center - self.center
        along = float(offset @ way)
        beside = along * along - float(offset @ offset) + self.radius**2
        direction = offset + way * (-along - np.sqrt(max(beside, 0.0)))
        height = float(direction @ self.dome.pole)
        if height < 0 < beside:  # below the horizon in front: the far side of the dome is meant
            direction = offset + way * (-along + np.sqrt(beside))
            height = float(direction @ self.dome.pole)
        flat = direction - height * self.dome.pole
        lowest = -float(np.linalg.norm(flat)) * np.tan(np.radians(RIM_DEG - 90.0))
        direction = flat + max(height, lowest) * self.dome.pole
        length = float(np.linalg.norm(direction))
        return direction / length if length > 1e-9 else self.dome.pole

    def _is_in_front(self, place: Float[np.ndarray, "3"]) -> bool:
        return float((self.camera.center - place) @ self.camera.world_from_camera[:3, 2]) > 1e-3 * self.radius

    def _is_in_sight(self, place: Float[np.ndarray, "3"]) -> bool:
        if not self._is_in_front(place):
            return False
        x, y = self.camera.project(place[None])[0][0]
        return bool(0 <= x < self.camera.width and 0 <= y < self.camera.height)

"""The hemisphere that lights are dragged on: a disc seen from above, and the same dome about the scene.

Its pole is the mean direction of the photographed lights, so that it covers what the model knows whichever way a
scene lies; to the right on the disc is to the right in the captured view.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw

from relight3d.lights import DirectionalLight, Light, PointLight
from relight3d.records import RelightModel

RIM_DEG = 95.0  # from the pole to the disc's rim: a little below the horizon
_SKY, _RING, _KNOWN, _INK = (38, 42, 50), (72, 78, 90), (128, 136, 150), (238, 238, 240)


@dataclass(frozen=True, eq=False)
class LightDome:
    """A scene's middle and size (world coordinates), the pole, what is to the right, and what is ahead."""

    center: Float[np.ndarray, "3"]
    radius: float
    pole: Float[np.ndarray, "3"]
    right: Float[np.ndarray, "3"]
    ahead: Float[np.ndarray, "3"]

    @staticmethod
    def of(model: RelightModel) -> "LightDome":
        """The dome of a model's scene."""
        center = model.mesh.center
        toward = [light.incident(center[None]).to_light[0] for lights in model.lights for light in lights]
        mean = np.mean(toward, axis=0) if toward else np.zeros(3)
        if np.linalg.norm(mean) < 0.1:  # lights all around, or none: take the viewer's side
            mean = model.camera.center - center
        pole = mean / max(float(np.linalg.norm(mean)), 1e-12)
        across = model.camera.world_from_camera[:3, 0]
        right = across - (across @ pole) * pole
        if np.linalg.norm(right) < 1e-6:  # the camera's right is the pole itself
            right = np.cross(model.camera.world_from_camera[:3, 1], pole)
        right /= np.linalg.norm(right)
        return LightDome(center, model.mesh.radius, pole, right, np.cross(pole, right))

    def direction_of(self, light: Light) -> Float[np.ndarray, "3"]:
        """The unit direction from the scene's middle to a light."""
        return np.asarray(light.incident(self.center[None]).to_light[0], np.float64)

    def distance_of(self, light: Light) -> float:
        """How far a lamp is from the scene's middle; a light at infinity counts as 4 radii away."""
        if isinstance(light, DirectionalLight):
            return 4.0 * self.radius
        return float(np.linalg.norm(np.asarray(light.position) - self.center))

    def place_on_disc(self, direction: Float[np.ndarray, "3"]) -> tuple[float, float]:
        """Where a direction is on the unit disc (x right, y ahead): equal angles are equal distances from the pole."""
        x, y, z = (float(direction @ axis) for axis in (self.right, self.ahead, self.pole))
        angle, ring = np.degrees(np.arccos(np.clip(z, -1.0, 1.0))), max(np.hypot(x, y), 1e-12)
        reach = min(angle / RIM_DEG, 1.0)
        return reach * x / ring, reach * y / ring

    def direction_on_disc(self, x: float, y: float) -> Float[np.ndarray, "3"]:
        """The direction at a place on the disc; places outside count as on its rim."""
        reach = float(np.hypot(x, y))
        angle = np.radians(min(reach, 1.0) * RIM_DEG)
        along = (x * self.right + y * self.ahead) / max(reach, 1e-12)
        return np.cos(angle) * self.pole + np.sin(angle) * along

    def turned_to(self, light: Light, direction: Float[np.ndarray, "3"]) -> Light:
        """The light from another direction: at infinity as it was, or at the distance it had from the middle."""
        unit = np.asarray(direction, np.float64) / np.linalg.norm(direction)
        if isinstance(light, DirectionalLight):
            return DirectionalLight(_three(unit), light.irradiance)
        return light.translated(self.center + unit * self.distance_of(light) - np.asarray(light.position))

    def at_distance(self, light: Light, distance: float) -> Light:
        """A lamp moved along its direction, its intensity changed so that the scene's middle stays as bright."""
        if isinstance(light, DirectionalLight):
            return light
        before = max(self.distance_of(light), 1e-9)
        moved = light.translated(self.direction_of(light) * (distance - before))
        return moved.scaled((distance / before) ** 2)

    def new_light(self, like: Light | None, kind: str, number: int = 0) -> Light:
        """A light off the pole, as bright at the scene's middle as `like` (or as daylight on white).

        The next number is a golden angle further around, so that no two start in one place.
        """
        around = 2.4 + 2.399963 * number
        direction = self.direction_on_disc(0.45 * float(np.cos(around)), 0.45 * float(np.sin(around)))
        irradiance = np.full(3, np.pi)
        if like is not None:
            _, facing, _ = like.incident(self.center[None])
            irradiance = np.full(3, max(float(facing[0].max()), 1e-9))
        if kind == "directional":
            return DirectionalLight(_three(direction), _three(irradiance))
        distance = 2.0 * self.radius
        return PointLight(_three(self.center + direction * distance), _three(irradiance * distance**2))


def dome_picture(
    dome: LightDome, lights: list[tuple[Light, bool]], selected: int, known: list[Float[np.ndarray, "3"]], size: int
) -> UInt8[np.ndarray, "size size 3"]:
    """The disc with the photographed lights as dots and these lights as knobs; those switched off are hollow."""
    scale = 3  # drawn larger and reduced, so that circles are smooth
    middle, rim = scale * size / 2, scale * (size / 2 - 8)
    image = Image.new("RGB", (scale * size, scale * size), (24, 26, 30))
    draw = ImageDraw.Draw(image)
    for angle in (90.0, 60.0, 30.0):
        reach = rim * angle / RIM_DEG
        box = (middle - reach, middle - reach, middle + reach, middle + reach)
        draw.ellipse(box, fill=_SKY if angle == 90.0 else None, outline=_RING, width=scale)
    for direction in known:
        _dot(draw, dome, direction, middle, rim, 1.6 * scale, _KNOWN, None)
    for index, (light, is_on) in enumerate(lights):
        color = knob_color(light) if is_on else None
        width = 2.2 * scale if index == selected else scale
        _dot(draw, dome, dome.direction_of(light), middle, rim, 6.0 * scale, color, _INK, int(width))
    return np.asarray(image.resize((size, size), Image.Resampling.BOX))


def knob_color(light: Light) -> tuple[int, int, int]:
    """A light's own colour, as bright as a screen shows it."""
    red, green, blue = (int(c) for c in np.rint(255 * (light.power / max(light.power.max(), 1e-30)) ** (1 / 2.2)))
    return red, green, blue


def _dot(
    draw: ImageDraw.ImageDraw, dome: LightDome, direction: np.ndarray, middle: float, rim: float, radius: float,
    fill: tuple[int, int, int] | None, outline: tuple[int, int, int] | None, width: int = 1,
) -> None:  # fmt: skip
    x, y = dome.place_on_disc(direction)
    left, top = middle + rim * x, middle - rim * y
    draw.ellipse((left - radius, top - radius, left + radius, top + radius), fill, outline, width)


def _three(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(part) for part in vector)
    return x, y, z

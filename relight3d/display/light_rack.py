"""The lights of the viewer: which there are, which are on, which one is held."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from relight3d.display.light_dome import LightDome
from relight3d.lights import DirectionalLight, Light, SpotLight


@dataclass(frozen=True, eq=False)
class RackLight:
    """One light: its colour is `tint` (largest part 1) times `strength` times what it was added with."""

    base: Light
    tint: tuple[float, float, float]
    strength: float
    is_on: bool

    @property
    def light(self) -> Light:
        """The light as it shines, whether it is on or not."""
        return self.base.scaled([self.strength * part for part in self.tint])


@dataclass(frozen=True, eq=False)
class LightRack:
    """Lights and the one selected. Every change gives another rack, so that an old one tells what has changed."""

    dome: LightDome
    entries: tuple[RackLight, ...]
    selected: int = 0

    @staticmethod
    def of(dome: LightDome, lights: Sequence[Light]) -> "LightRack":
        return LightRack(dome, tuple(_entry(light) for light in lights))

    @property
    def active(self) -> tuple[Light, ...]:
        """The lights that are on."""
        return tuple(entry.light for entry in self.entries if entry.is_on)

    @property
    def shown(self) -> list[tuple[Light, bool]]:
        """All lights, and whether each is on: what pictures of the rack draw."""
        return [(entry.light, entry.is_on) for entry in self.entries]

    @property
    def current(self) -> RackLight | None:
        return self.entries[self.selected] if self.entries else None

    def select(self, index: int) -> "LightRack":
        return replace(self, selected=int(np.clip(index, 0, max(len(self.entries) - 1, 0))))

    def add(self, kind: str) -> "LightRack":
        """One more light of a kind ("directional", "point"), selected; as bright as the one selected before."""
        like = self.current
        light = self.dome.new_light(None if like is None else like.light, kind, len(self.entries))
        return replace(self, entries=(*self.entries, _entry(light)), selected=len(self.entries))

    def remove(self) -> "LightRack":
        """Without the selected light."""
        entries = tuple(entry for index, entry in enumerate(self.entries) if index != self.selected)
        return replace(self, entries=entries).select(self.selected)

    def switch(self, is_on: bool) -> "LightRack":
        return self._with(is_on=is_on)

    def tint(self, red: float, green: float, blue: float) -> "LightRack":
        """Colour the selected light; black counts as a very dark grey, since it has no colour to come back from."""
        return self._with(tint=(max(red, 1e-3), max(green, 1e-3), max(blue, 1e-3)))

    def strengthen(self, strength: float) -> "LightRack":
        """Set how bright the selected light is, relative to when it was added."""
        return self._with(strength=max(float(strength), 0.0))

    def turn(self, x: float, y: float) -> "LightRack":
        """Move the selected light to a place on the dome's disc."""
        direction = self.dome.direction_on_disc(x, y)
        return self.change(lambda light: self.dome.turned_to(light, direction))

    def set_distance(self, distance: float) -> "LightRack":
        """Move the selected lamp nearer or farther; a light at infinity stays there."""
        return self.change(lambda light: self.dome.at_distance(light, distance))

    def pick_on_disc(self, x: float, y: float, reach: float = 0.12) -> int | None:
        """The light whose knob is nearest to a place on the disc, within reach."""
        places = [self.dome.place_on_disc(self.dome.direction_of(entry.light)) for entry in self.entries]
        away = [float(np.hypot(px - x, py - y)) for px, py in places]
        return int(np.argmin(away)) if away and min(away) <= reach else None

    def change(self, move: Callable[[Light], Light]) -> "LightRack":
        """Put another light in the place of the selected one, its colour and strength kept."""
        if self.current is None:
            return self
        return self._with(base=move(self.current.base))

    def _with(self, **changes) -> "LightRack":
        if self.current is None:
            return self
        entries = list(self.entries)
        entries[self.selected] = replace(self.current, **changes)
        return replace(self, entries=tuple(entries))

    @property
    def has_distance(self) -> bool:
        """Whether the selected light is a lamp at a place."""
        return self.current is not None and not isinstance(self.current.base, DirectionalLight)


def _entry(light: Light) -> RackLight:
    """An entry whose tint is the light's own colour and whose strength is 1."""
    top = float(light.power.max())
    if top <= 0:
        return RackLight(_white(light, 1.0), (1.0, 1.0, 1.0), 0.0, True)
    red, green, blue = (max(float(part) / top, 1e-3) for part in light.power)
    return RackLight(_white(light, top), (red, green, blue), 1.0, True)


def _white(light: Light, power: float) -> Light:
    """The light in white: made anew, since a channel that is black cannot be scaled back."""
    if isinstance(light, SpotLight):
        return light.moved(intensity=(power, power, power))
    name = "irradiance" if isinstance(light, DirectionalLight) else "intensity"
    return replace(light, **{name: (power, power, power)})

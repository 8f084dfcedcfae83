"""What a frame spends its time on: every approximation a named option, and the presets that combine them."""

from dataclasses import dataclass, replace
from typing import Literal

from relight3d.errors import InputError

Shadows = Literal["exact", "adaptive", "table", "off"]
Backend = Literal["auto", "numpy", "numba"]
Shading = Literal["exact", "adaptive", "half"]
Precision = Literal["float32", "int16", "int8"]
TABLE_SIZES = (256, 1024, 2304, 4096, 6400, 9216, 16384, 36864)
Preset = Literal["baked", "fast", "balanced", "exact"]


@dataclass(frozen=True)
class RelightOptions:
    """Settings of a Relighter. The prices of each, in error and time, are measured in docs/performance.md.

    An effect that the model does not have costs nothing whatever its option says. Raises InputError for a value out
    of range.
    """

    # adaptive: a lattice, refined where it disagrees; table: cast ahead when the relighter is made, then looked up by the
    # light's direction (with shading "half", of lights at infinity); off: none
    shadows: Shadows = "exact"
    borders: bool = True  # antialiased shadow borders: 3 rays between a lit and a dark neighbour
    lattice_px: int = 2  # of adaptive shadows: the lattice's spacing, 2 or 4 pixels
    shared_rays: bool = False  # of adaptive shadows: one ray for all parts of a pixel that show one surface
    table_directions: int = 16384  # of shadows cast ahead: over the sphere, a square number
    table_mb: int = 1024  # what they may take of memory
    # adaptive: indirect light at every fourth pixel, highlights where they can be seen; half: light at every second pixel
    # each way, shadows too (on a lattice of its own, not that of "adaptive")
    shading: Shading = "exact"
    light_samples: int = 16  # shadow samples of a sphere or rectangle light; other lights cost nothing by it
    edge_samples: int = 4  # points that a pixel on an outline is cut into (a square number; 1: none)
    max_bounces: int = 2  # mirrors followed one after the other; 0 shows mirrors black
    thrown: bool = True  # the sharp patches of light that plane mirrors throw
    indirect: bool = True  # indirect and ambient light
    max_lobes: int = 8  # of a surface's highlight, strongest first; 0: diffuse
    detail: bool = True  # perturbed normals and lobes of single pixels
    residual: bool = True  # the interpolated misfit of the captured pixels
    max_modes: int = 64  # of the residual, the strongest first
    backend: Backend = "auto"  # numba where it is installed, else the NumPy reference
    precision: Precision = "int16"  # of the residual's modes, finer where a step could be seen; float32; int8 rounds
    keep_lights: int = 8  # lights whose shadows are kept for frames that only change colours; a frame's own always are

    def __post_init__(self) -> None:
        _one_of("shadows", self.shadows, ("exact", "adaptive", "table", "off"))
        _one_of("backend", self.backend, ("auto", "numpy", "numba"))
        _one_of("shading", self.shading, ("exact", "adaptive", "half"))
        _one_of("precision", self.precision, ("float32", "int16", "int8"))
        _one_of("lattice_px", self.lattice_px, (2, 4))
        _one_of("edge_samples", self.edge_samples, (1, 4, 9, 16))
        _one_of("table_directions", self.table_directions, TABLE_SIZES)
        _between("table_mb", self.table_mb, 1, 65536)
        if self.shadows == "table" and self.shading != "half":
            raise InputError("shadows", "table", 'another, or shading "half", whose slots the table is of')
        _one_of("shared_rays", self.shared_rays, (False, True))
        _between("light_samples", self.light_samples, 1, 1024)
        _between("max_bounces", self.max_bounces, 0, 8)
        _between("max_lobes", self.max_lobes, 0, 8)
        _between("max_modes", self.max_modes, 0, 64)
        _between("keep_lights", self.keep_lights, 1, 4096)


def _one_of(field: str, value: object, allowed: tuple) -> None:
    if value not in allowed:
        raise InputError(field, value, f"one of {', '.join(str(each) for each in allowed)}")


def _between(field: str, value: int, low: int, high: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise InputError(field, value, f"a whole number from {low} to {high}")


BALANCED = RelightOptions(shadows="adaptive", lattice_px=4, shading="adaptive", precision="int8")
FAST = RelightOptions(shading="half", precision="int8", max_modes=8)
PRESETS: dict[Preset, RelightOptions] = {
    "baked": replace(FAST, shadows="table"),
    "fast": FAST,
    "balanced": BALANCED,
    "exact": RelightOptions(),
}


def preset_options(name: str) -> RelightOptions:
    """The options of a named preset. Raises InputError for another name."""
    _one_of("preset", name, tuple(PRESETS))
    return PRESETS[name]  # type: ignore[index]

"""The ladder of a study: settings that differ from the default in one thing, and a few that differ in several."""

from collections.abc import Mapping
from dataclasses import dataclass, field, is_dataclass, replace
from typing import Any, TypeVar

from relight3d.records import RelightModel
from relight3d.recover.run import RecoverOptions
from relight3d.relight.budget import preset_for
from relight3d.relight.options import RelightOptions

Options = TypeVar("Options")
RECOVERY, RENDER = "recovery", "render"


@dataclass(frozen=True)
class Setting:
    """One rung. `changes` are of RecoverOptions ("indirect.basis") or of RelightOptions ("shadows"), by family.

    `photographs` keeps so many of the training ones; `resolution` is the frame's, relative to the capture's; `preset`
    is a point of the model's own price list.
    """

    family: str
    factor: str  # the one thing that is varied; "combined" for several
    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    photographs: int | None = None
    resolution: float = 1.0
    preset: str | None = None

    @property
    def is_default(self) -> bool:
        return not self.changes and self.photographs is None and self.resolution == 1.0 and self.preset is None

    def recover_options(self) -> RecoverOptions:
        return changed(RecoverOptions(), self.changes if self.family == RECOVERY else {})

    def relight_options(self, model: RelightModel) -> RelightOptions:
        if self.preset is not None:
            return preset_for(model, self.preset)
        return changed(RelightOptions(), self.changes if self.family == RENDER else {})


def changed(options: Options, changes: Mapping[str, Any]) -> Options:
    """Options with dotted names replaced: {"indirect.basis": "sh2"}."""
    for path, value in changes.items():
        head, _, rest = path.partition(".")
        inner = getattr(options, head)
        assert not rest or is_dataclass(inner), f"{path} names no option"
        options = replace(options, **{head: changed(inner, {rest: value}) if rest else value})  # type: ignore[type-var]
    return options


def ladder(num_photographs: int, quick: bool) -> list[Setting]:
    """All settings, the most telling first, so that a short time budget leaves out the least."""
    render = [_render(*row) for row in _RENDER if not (quick and row[0] in _LONG)]
    render += [Setting(RENDER, "resolution", f"frames at {r:.0%}", resolution=r) for r in (0.5, 0.71)]
    render += [Setting(RENDER, "combined", f"preset {name}", preset=name) for name in ("balanced", "fast", "baked")]
    counts = [n for n in ((6, 12) if quick else (4, 6, 8, 12, 16, 20)) if n < num_photographs]
    recovery = [Setting(RECOVERY, "photographs", f"{n} photographs", photographs=n) for n in counts]
    rows = _RECOVERY_FIRST + ([] if quick else _RECOVERY_REST)
    recovery += [Setting(RECOVERY, *row) for row in rows]
    return [Setting(RENDER, "default", "default"), Setting(RECOVERY, "default", "default"), *_mixed(render, recovery)]


def _mixed(one: list[Setting], other: list[Setting]) -> list[Setting]:
    """Both lists to their ends at the same pace: a study that stops early has something of each."""
    places = [((k + 0.5) / len(some), setting) for some in (one, other) for k, setting in enumerate(some)]
    return [setting for _, setting in sorted(places, key=lambda place: place[0])]


def _render(factor: str, name: str, changes: Mapping[str, Any]) -> Setting:
    return Setting(RENDER, factor, name, changes)


_LONG = ("backend", "bounces")  # factors that a quick study leaves out
_RENDER: list[tuple[str, str, dict[str, Any]]] = [
    ("shadows", "lattice of 2 px", {"shadows": "adaptive"}),
    ("shadows", "lattice of 4 px", {"shadows": "adaptive", "lattice_px": 4}),
    ("shadows", "lattice of 4 px, shared rays", {"shadows": "adaptive", "lattice_px": 4, "shared_rays": True}),
    ("shadows", "looked up, 16384 directions", {"shading": "half", "shadows": "table"}),
    ("shadows", "looked up, 4096 directions", {"shading": "half", "shadows": "table", "table_directions": 4096}),
    ("shadows", "none", {"shadows": "off"}),
    ("shadow borders", "hard", {"borders": False}),
    ("outlines", "hard", {"edge_samples": 1}),
    ("outlines", "9 samples", {"edge_samples": 9}),
    ("residual", "none", {"residual": False}),
    ("residual", "3 modes", {"max_modes": 3}),
    ("residual", "8 modes", {"max_modes": 8}),
    ("residual", "8 bits", {"precision": "int8"}),
    ("residual", "float32", {"precision": "float32"}),
    ("shading", "adaptive", {"shading": "adaptive"}),
    ("shading", "half", {"shading": "half"}),
    ("lobes", "none", {"max_lobes": 0}),
    ("lobes", "1 a surface", {"max_lobes": 1}),
    ("detail", "none", {"detail": False}),
    ("mirrors", "black", {"max_bounces": 0}),
    ("bounces", "1 mirror", {"max_bounces": 1}),
    ("mirrors", "no thrown light", {"thrown": False}),
    ("indirect", "none", {"indirect": False}),
    ("backend", "NumPy", {"backend": "numpy"}),
    (
        "combined",
        "lattice, hard edges",
        {"shadows": "adaptive", "lattice_px": 4, "borders": False, "edge_samples": 1},
    ),
    (
        "combined",
        "lattice, hard edges, no residual",
        {"shadows": "adaptive", "lattice_px": 4, "borders": False, "edge_samples": 1, "residual": False},
    ),
    (
        "combined",
        "direct light only",
        {"indirect": False, "residual": False, "max_lobes": 0, "thrown": False, "max_bounces": 0, "edge_samples": 1},
    ),
]
_PLAIN: dict[str, Any] = {"num_rounds": 0, "residual.max_modes": 0}
_PAPER: dict[str, Any] = {
    "indirect.site": "face",
    "indirect.basis": "angles2",
    "indirect.smoothing_px": 0.0,
    "detail.mode": "lobe",
    "residual.max_modes": 0,
}
_RECOVERY_FIRST: list[tuple[str, str, dict[str, Any]]] = [
    ("detail", "none", {"detail.mode": "off"}),
    ("lobes", "none", {"specular.max_lobes": 0}),
    ("residual", "none", {"residual.max_modes": 0}),
    ("basis", "constant", {"indirect.basis": "constant"}),
    ("basis", "angles2 (the paper's)", {"indirect.basis": "angles2"}),
    ("basis", "sh2", {"indirect.basis": "sh2"}),
    ("site", "face (the paper's)", {"indirect.site": "face"}),
    ("faces", "4,000 faces", {"mesh.target_faces": 4000}),
    ("rounds", "1 round", {"num_rounds": 1}),
    ("combined", "no lobes, detail or residual", _PLAIN),
    ("combined", "the paper's choices", _PAPER),
    ("lobes", "1 a surface", {"specular.max_lobes": 1}),
    ("detail", "lobe only (the paper's)", {"detail.mode": "lobe"}),
]
_RECOVERY_REST: list[tuple[str, str, dict[str, Any]]] = [
    ("site", "pixel", {"indirect.site": "pixel"}),
    ("basis", "linear", {"indirect.basis": "linear"}),
    ("basis", "cosines2", {"indirect.basis": "cosines2"}),
    ("basis", "sh3", {"indirect.basis": "sh3"}),
    ("basis", "hsh2", {"indirect.basis": "hsh2"}),
    ("basis", "hsh3", {"indirect.basis": "hsh3"}),
    ("faces", "10,000 faces", {"mesh.target_faces": 10_000}),
    ("faces", "100,000 faces", {"mesh.target_faces": 100_000}),
    ("lobes", "2 a surface", {"specular.max_lobes": 2}),
    ("detail", "normal", {"detail.mode": "normal"}),
    ("detail", "normal, one linear step", {"detail.mode": "normal", "detail.num_steps": 1}),
    ("residual", "4 modes", {"residual.max_modes": 4}),
    ("alternations", "1", {"num_alternations": 1}),
    ("alternations", "8", {"num_alternations": 8}),
    ("combined", "4,000 faces, 1 round", {"mesh.target_faces": 4000, "num_rounds": 1}),
]

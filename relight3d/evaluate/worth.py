"""What each effect of a plan is worth on held-out photographs: kept ones taken out, left-out ones put in.

Nothing else is fitted again: a kept effect is removed from the model, a left-out one is carried over from a recovery
that was forced to have it. An effect of one surface is judged on the pixels of that surface.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from relight3d.effects import RAY_EFFECTS, SCENE, SCENE_EFFECTS, SURFACE_EFFECTS
from relight3d.evaluate.metrics import capture_exposure, display_values
from relight3d.io.capture import read_photograph
from relight3d.records import Capture, RelightModel
from relight3d.relight.force import apply_plan, forced_options, has_effect
from relight3d.relight.options import RelightOptions
from relight3d.relight.plan import plan_of
from relight3d.relight.plan_lines import Plan
from relight3d.relight.relighter import Relighter

FLOOR = 1e-10  # of a mean square of display values: 100 dB


@dataclass(frozen=True)
class Worth:
    """One effect switched the other way: by how many dB held-out photographs get worse (negative: better)."""

    effect: str
    surface: int
    where: str
    is_on: bool  # in the plan; the figures are of the other state
    gain_db: float | None  # the plan's evidence
    noise_db: float | None
    frame_db: float  # over the whole frames, mean over the photographs
    own_db: float  # over the pixels of its surface
    scatter_db: float  # standard error of that mean

    @property
    def is_right(self) -> bool:
        """A kept effect is missed by more than the plan's noise, a left-out one would bring less than 0.1 dB."""
        return self.own_db > (self.noise_db or 0.0) if self.is_on else -self.frame_db < 0.1


class HeldOut:
    """The held-out photographs at the captured viewpoint, and how a model misses them: pixel by pixel, read once."""

    def __init__(self, capture: Capture, model: RelightModel, split: str = "test") -> None:
        self._photographs = [p for p in capture.split(split) if p.camera.same_as(capture.camera)]
        pictures = [read_photograph(capture, p) for p in self._photographs]
        self._pixel, self._surface = model.pixels.points.pixel, model.pixels.surface
        masks = [valid.ravel()[self._pixel] for _, valid in pictures]
        self._wanted = [picture.reshape(-1, 3)[self._pixel] for picture, _ in pictures]
        self._exposure = capture_exposure(self._wanted, masks)
        self._masks = masks

    def psnr_db(self, model: RelightModel, options: RelightOptions, surface: int = SCENE) -> np.ndarray:
        """One figure a photograph, over one surface or all."""
        relighter = Relighter(model, options=options)
        mine = self._surface == surface if surface != SCENE else np.ones(len(self._pixel), bool)
        figures = []
        for photograph, wanted, mask in zip(self._photographs, self._wanted, self._masks):
            chosen = mask & mine
            got = relighter.render(list(photograph.lights)).radiance.reshape(-1, 3)[self._pixel]
            miss = display_values(got[chosen], self._exposure) - display_values(wanted[chosen], self._exposure)
            figures.append(-10 * np.log10(max(float(np.mean(miss.astype(np.float64) ** 2)), FLOOR)))
        return np.array(figures)


def worth_of_effects(model: RelightModel, capture: Capture, with_all: RelightModel | None = None) -> list[Worth]:
    """Every effect of the model's plan switched the other way; left-out ones only where `with_all` has them.

    `with_all` is a model of the same capture whose recovery was forced to have what the plan left out (`left_out`).
    """
    held_out, plan, exact = HeldOut(capture, model), plan_of(model), RelightOptions()
    found = []
    for line in plan.lines:
        other, options = _switched(model, with_all, exact, line.effect, line.surface, line.is_on)
        if other is None:
            continue
        frame = held_out.psnr_db(model, exact) - held_out.psnr_db(other, options)
        own = frame
        if line.surface != SCENE and line.effect not in ("mirror", "thrown"):  # mirrors change what others get
            own = held_out.psnr_db(model, exact, line.surface) - held_out.psnr_db(other, options, line.surface)
        scatter = float(own.std(ddof=1) / len(own) ** 0.5) if len(own) > 1 else 0.0
        evidence = (line.gain_db, line.noise_db)
        where = (line.effect, line.surface, line.where, line.is_on)
        found.append(Worth(*where, *evidence, float(frame.mean()), float(own.mean()), scatter))
    return found


def left_out(plan: Plan) -> tuple[str, ...]:
    """The words that force on what the plan leaves out and recovery could have had."""
    can_be_forced = ("indirect", "residual", "texture", "lobes", "detail")
    lines = [o for o in plan.lines if not o.is_on and o.effect in can_be_forced]
    return tuple(f"{o.effect}=on" if o.surface == SCENE else f"{o.effect}:{o.surface}=on" for o in lines)


def _switched(
    model: RelightModel, with_all: RelightModel | None, options: RelightOptions, effect: str, surface: int, is_on: bool
) -> tuple[RelightModel | None, RelightOptions]:
    """The model and options with one effect the other way; None where it has no other way."""
    if is_on and effect in RAY_EFFECTS:
        return model, forced_options(options, {(effect, SCENE): False})
    if is_on and effect in (*SCENE_EFFECTS, *SURFACE_EFFECTS):
        return apply_plan(model, {(effect, surface): False}), options
    if not is_on and with_all is not None and effect in (*SCENE_EFFECTS, *SURFACE_EFFECTS):
        is_new = has_effect(with_all, effect, surface) and not has_effect(model, effect, surface)
        return (with_effect_of(model, with_all, effect, surface) if is_new else None), options
    return None, options


def with_effect_of(model: RelightModel, other: RelightModel, effect: str, surface: int) -> RelightModel:
    """The model with one effect as another model of the same capture has it."""
    mine = model.pixels.surface == surface

    def from_other(names: Iterable[str]) -> RelightModel:
        changed = {}
        for name in names:
            own, given = getattr(model.pixels, name), getattr(other.pixels, name)
            changed[name] = np.where(mine if own.ndim == 1 else mine[:, None], given, own)
        return replace(model, pixels=replace(model.pixels, **changed))

    if effect == "texture":
        return from_other(["albedo"])
    if effect == "detail":
        return from_other(["normal", "lobe_gain"])
    if effect == "lobes":
        return replace(model, lobes=tuple(other.lobes[s] if s == surface else o for s, o in enumerate(model.lobes)))
    assert effect in ("indirect", "residual"), f"{effect} is not carried over"
    return replace(model, **{effect: getattr(other, effect)})

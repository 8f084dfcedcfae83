"""How frames are to be rendered: the flags that `render` and `evaluate` share."""

from dataclasses import dataclass, field
from typing import Annotated

import tyro

from relight3d.camera import Camera
from relight3d.effects import parse_force
from relight3d.records import RelightModel
from relight3d.relight.budget import one_of_three
from relight3d.relight.force import apply_plan, forced_options
from relight3d.relight.options import Preset, RelightOptions, preset_options
from relight3d.relight.relighter import Relighter


@dataclass(frozen=True, kw_only=True)
class Relighting:
    """What a frame spends its time on: a preset, a budget or single options; and effects switched by hand."""

    preset: Preset | None = None  # a named point between accuracy and time; exact if nothing is asked for
    budget_ms: float | None = None  # the most accurate settings whose frame fits this time on this machine
    force: tuple[str, ...] = ()  # effect=off, or effect:surface=off, by the names that `relight3d plan` shows
    options: Annotated[RelightOptions, tyro.conf.arg(name="")] = field(default_factory=RelightOptions)

    def relighter(self, model: RelightModel, camera: Camera | None = None) -> Relighter:
        """A relighter of these settings. Raises InputError for settings that exclude each other."""
        options = None if self.options == RelightOptions() else self.options
        one_of_three(options, self.budget_ms, self.preset)
        force = parse_force(self.force)
        model = apply_plan(model, force)
        if self.budget_ms is None:
            options = options or preset_options(self.preset or "exact")
            return Relighter(model, camera, options=forced_options(options, force))
        within_budget = Relighter(model, camera, budget_ms=self.budget_ms)
        options = forced_options(within_budget.options, force)
        return within_budget if options == within_budget.options else Relighter(model, camera, options=options)

"""How frames are to be rendered: the flags that `render` and `evaluate` share."""

from dataclasses import dataclass, field
from typing import Annotated

import tyro

from relight3d.camera import Camera
from relight3d.effects import parse_force
from relight3d.progress import working
from relight3d.records import RelightModel
from relight3d.relight.budget import check_wish, preset_for
from relight3d.relight.force import apply_plan, forced_options
from relight3d.relight.options import Preset, RelightOptions
from relight3d.relight.relighter import Relighter


@dataclass(frozen=True, kw_only=True)
class Relighting:
    """What a frame spends its time on: a preset, a budget or single options; and effects switched by hand."""

    preset: Preset | None = None  # a named point between accuracy and time; exact if nothing is asked for
    budget_ms: float | None = None  # the most accurate settings whose frame fits this time on this machine
    max_error_db: float | None = None  # the cheapest settings that lose no more than this to the exact ones
    force: tuple[str, ...] = ()  # effect=off, or effect:surface=off, by the names that `relight3d plan` shows
    options: Annotated[RelightOptions, tyro.conf.arg(name="")] = field(default_factory=RelightOptions)

    def relighter(self, model: RelightModel, camera: Camera | None = None) -> Relighter:
        """A relighter of these settings. Raises InputError for settings that exclude each other."""
        options = None if self.options == RelightOptions() else self.options
        check_wish(options, self.preset, self.budget_ms, self.max_error_db)
        force = parse_force(self.force)
        model = apply_plan(model, force)
        if self.budget_ms is None and self.max_error_db is None:
            options = forced_options(options or preset_for(model, self.preset or "exact"), force)
            with working("shadows cast ahead", quiet=options.shadows != "table"):
                return Relighter(model, camera, options=options)
        chosen = Relighter(model, camera, budget_ms=self.budget_ms, max_error_db=self.max_error_db)
        options = forced_options(chosen.options, force)
        return chosen if options == chosen.options else chosen.with_options(options)

"""The panels of the viewer: each shows a part of a ViewerState and changes it. No logic lives here."""

from collections.abc import Callable

from relight3d.display.effects import PRESETS, effect_line
from relight3d.display.health_layers import extrapolation_note
from relight3d.display.light_dome import dome_picture
from relight3d.display.open3d_modules import gui
from relight3d.display.pixel_figure import chart_height, chart_of
from relight3d.display.viewer_state import ViewerState, title_of
from relight3d.display.viewer_widgets import Picture, Slider, button, row

_DISC = 210  # pixels


class Panel:
    """A titled group of widgets. `refresh` shows a new state, `refresh_idle` what takes time."""

    title = ""

    def __init__(self, state: ViewerState, changed: Callable[[], None], em: float) -> None:
        self.state, self.changed, self.em = state, changed, em
        self.pictures: list[Picture] = []
        self.widget = gui.CollapsableVert(self.title, 0.35 * em, gui.Margins(0.3 * em, 0.2 * em, 0, 0.5 * em))
        for child in self.build():
            self.widget.add_child(child)

    def build(self) -> list:
        raise NotImplementedError

    def refresh(self) -> None:
        """Show the state as it is now."""

    def refresh_idle(self) -> bool:
        """Show one more thing that takes time; True where there is another."""
        return False


class LightPanel(Panel):
    """The rack of lights: choose, add, remove, switch, colour, strengthen and move them."""

    title = "Lights"

    def build(self) -> list:
        self.menu = gui.Combobox()
        self.menu.set_on_selection_changed(lambda _, index: self._set(self.state.rack.select(index)))
        self.switch = gui.Checkbox("on")
        self.switch.set_on_checked(lambda is_on: self._set(self.state.rack.switch(is_on)))
        self.color = gui.ColorEdit()
        self.color.set_on_value_changed(lambda c: self._set(self.state.rack.tint(c.red, c.green, c.blue)))
        self.strength = Slider(0.0, 4.0, 1.0, lambda value: self._set(self.state.rack.strengthen(value)))
        radius = self.state.dome.radius
        self.distance = Slider(
            0.2 * radius, 6.0 * radius, 2.0 * radius, lambda value: self._set(self.state.rack.set_distance(value))
        )
        self.disc = Picture(_DISC, _DISC)
        self.disc.widget.set_on_mouse(self._on_disc)
        self.pictures = [self.disc]
        self.note = gui.Label("")
        self._names: list[str] = []
        add_sun = button("+ directional", lambda: self._set(self.state.rack.add("directional")))
        add_lamp = button("+ point", lambda: self._set(self.state.rack.add("point")))
        remove = button("remove", lambda: self._set(self.state.rack.remove()))
        return [
            row(self.em, self.menu, self.switch),
            row(self.em, add_sun, add_lamp, remove),
            row(self.em, self.disc.widget),
            self.color,
            row(self.em, gui.Label("strength"), self.strength.widget),
            row(self.em, gui.Label("distance"), self.distance.widget),
            self.note,
        ]

    def refresh(self) -> None:
        rack = self.state.rack
        names = [f"{i + 1}  {e.base.kind}{'' if e.is_on else ' (off)'}" for i, e in enumerate(rack.entries)]
        if names != self._names:
            self.menu.clear_items()
            for name in names:
                self.menu.add_item(name)
            self._names = names
        if rack.current is not None:
            self.menu.selected_index = rack.selected
            self.switch.checked = rack.current.is_on
            self.color.color_value = gui.Color(*rack.current.tint)
            self.strength.show(rack.current.strength)
            self.distance.show(rack.dome.distance_of(rack.current.base))
        self.distance.widget.enabled = rack.has_distance
        known = [rack.dome.direction_of(light) for lights in self.state.model.lights for light in lights]
        self.disc.show(dome_picture(rack.dome, rack.shown, rack.selected, known, _DISC))
        self.note.text = extrapolation_note(self.state.model, rack.active).partition(",")[0]

    def _set(self, rack) -> None:
        self.state.rack = rack
        self.changed()

    def _on_disc(self, event) -> object:
        kind, frame = gui.MouseEvent.Type, self.disc.widget.frame
        half = min(frame.width, frame.height) / 2
        x = (event.x - frame.x - frame.width / 2) / (half - 8)
        y = -(event.y - frame.y - frame.height / 2) / (half - 8)
        rack = self.state.rack
        if event.type == kind.BUTTON_DOWN:
            picked = rack.pick_on_disc(x, y)
            self._set(rack.turn(x, y) if picked is None else rack.select(picked))
        elif event.type == kind.DRAG:
            self._set(rack.turn(x, y))
        return gui.Widget.EventCallbackResult.CONSUMED


class ViewPanel(Panel):
    """Exposure, the camera's way back, and whether the lights are drawn."""

    title = "View"

    def build(self) -> list:
        self.exposure = Slider(-4.0, 4.0, 0.0, self._expose)
        self.gizmo = gui.Checkbox("lights in the picture")
        self.gizmo.checked = True
        self.gizmo.set_on_checked(self._show_gizmo)
        hint = gui.Label("drag: orbit, right drag: move, wheel: zoom,\nclick: look at a pixel")
        return [
            row(self.em, gui.Label("exposure"), self.exposure.widget),
            row(self.em, button("captured view", self._reset), self.gizmo),
            hint,
        ]

    def refresh(self) -> None:
        self.exposure.show(self.state.exposure_stops)
        self.gizmo.checked = self.state.shows_gizmo

    def _expose(self, stops: float) -> None:
        self.state.exposure_stops = stops
        self.changed()

    def _show_gizmo(self, is_shown: bool) -> None:
        self.state.shows_gizmo = is_shown
        self.changed()

    def _reset(self) -> None:
        self.state.reset_camera()
        self.changed()


class SpeedPanel(Panel):
    """A preset or a budget, and what the frame costs."""

    title = "Speed"

    def build(self) -> list:
        self.menu = gui.Combobox()
        for name in (*PRESETS, "budget"):
            self.menu.add_item(name)
        self.menu.set_on_selection_changed(lambda name, _: self._choose(name))
        self.budget = Slider(4.0, 100.0, 16.0, lambda _: self._choose("budget"))
        self.costs = gui.Label("")
        return [self.menu, row(self.em, gui.Label("budget, ms"), self.budget.widget), self.costs]

    def refresh(self) -> None:
        speed = self.state.speed
        self.menu.selected_text = speed.preset if speed.budget_ms is None else "budget"
        self.costs.text = "\n".join(self.state.cost_lines())

    def _choose(self, name: str) -> None:
        if name == "budget":
            self.state.set_speed("exact", self.budget.value)
        else:
            self.state.set_speed(name)
        self.changed()


class EffectPanel(Panel):
    """A switch for each effect that the model has, with its worth and its cost."""

    title = "Effects"

    def build(self) -> list:
        self.lines = {}
        rows = gui.VGrid(2, 0.3 * self.em)
        for name in self.state.effects:
            switch, text = gui.Checkbox(name), gui.Label("")
            switch.set_on_checked(lambda is_on, name=name: self._switch(name, is_on))
            self.lines[name] = (switch, text)
            rows.add_child(switch)
            rows.add_child(text)
        return [rows]

    def refresh(self) -> None:
        shares, frame = self.state.shares(), self.state.frame()
        for name, (switch, text) in self.lines.items():
            switch.checked = name not in self.state.speed.off
            text.text = effect_line(name, shares.get(name), frame) if switch.checked else "off"

    def refresh_idle(self) -> bool:
        has_more = self.state.measure_next_share()
        self.refresh()
        return has_more

    def _switch(self, name: str, is_on: bool) -> None:
        self.state.switch_effect(name, is_on)
        self.changed()


class LayerPanel(Panel):
    """The menu of layers, and how to read the one shown."""

    title = "Layer"

    def build(self) -> list:
        self.menu = gui.Combobox()
        for name in self.state.names_of_layers:
            self.menu.add_item(title_of(name))
        self.menu.set_on_selection_changed(lambda _, index: self.choose(self.state.names_of_layers[index]))
        self.text = gui.Label("")
        return [self.menu, self.text]

    def choose(self, name: str) -> None:
        self.state.set_layer(name)
        self.changed()

    def refresh(self) -> None:
        self.menu.selected_index = self.state.names_of_layers.index(self.state.layer_name)
        self.text.text = "\n".join(self.state.layer_lines())


class PixelPanel(Panel):
    """The pixel looked at: its measured values against the model's, and the parameters there."""

    title = "Pixel"

    def build(self) -> list:
        self._width = int(20 * self.em)
        self.chart = Picture(self._width, chart_height(self._width))
        self.pictures = [self.chart]
        self.text = gui.Label("click into the picture")
        self._shown = None
        return [self.chart.widget, self.text]

    def refresh(self) -> None:
        report = self.state.pixel
        if report is None:
            self.text.text = self.state.message or "click into the picture"
        elif report is not self._shown:
            self.chart.show(chart_of(report, self._width))
            self.text.text = "\n".join(f"{word}: {text}" for word, text in report.parameters)
        self._shown = report

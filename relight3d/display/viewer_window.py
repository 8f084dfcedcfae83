"""The viewer's window: a thin shell of Open3D widgets around a ViewerState. Imported only where a window can open."""

import time

import numpy as np

from relight3d.display.frames import opencv_camera
from relight3d.display.open3d_modules import gui, open3d, rendering
from relight3d.display.viewer_panels import EffectPanel, LayerPanel, LightPanel, PixelPanel, SpeedPanel, ViewPanel
from relight3d.display.viewer_state import ViewerState
from relight3d.display.viewer_widgets import Picture

TABS = {"Lights": (LightPanel, ViewPanel), "Effects": (SpeedPanel, EffectPanel), "Inspect": (LayerPanel, PixelPanel)}
_INSPECT = 2  # the tab that a click into the picture opens
_PANEL_EM = 24  # width of the panel, in heights of its letters
_STILL_SECONDS = 0.25  # after so long without a move the picture is made pixel by pixel
_CLICK_PX = 4  # a press that moves less than this is a click
_KNOB_PX = 14
_REDRAWS = 3  # after each new picture, in which it is sent again


class ViewerWindow:
    """A window on a state: a picture to the left, panels to the right. One at a time in a process."""

    def __init__(self, state: ViewerState, title: str = "relight3d", width: int = 1280, height: int = 800) -> None:
        self.state = state
        self.app = gui.Application.instance
        self.app.initialize()
        self.window = self.app.create_window(title, width, height)
        self.image = Picture(8, 8)
        self.mesh = gui.SceneWidget()
        self.mesh.scene = rendering.Open3DScene(self.window.renderer)
        self.mesh.scene.set_background([0.106, 0.114, 0.129, 1.0])
        self.mesh.scene.view.set_post_processing(False)
        self.mesh.visible = False
        em = self.window.theme.font_size
        self.status = gui.Label("")
        self.tabs = gui.TabControl()
        self.parts, self.pages = [], []
        for name, kinds in TABS.items():
            page = gui.ScrollableVert(0.4 * em, gui.Margins(0.4 * em, 0.5 * em, 0.4 * em, 0.5 * em))
            for kind in kinds:
                self.parts.append(kind(state, self.changed, em))
                page.add_child(self.parts[-1].widget)
            self.tabs.add_tab(name, page)
            self.pages.append(page)
        self.panel = gui.Vert(0.3 * em, gui.Margins(0.5 * em, 0.5 * em, 0.5 * em, 0.5 * em))
        self.panel.add_child(self.status)
        self.panel.add_child(self.tabs)
        self.tabs.set_on_selected_tab_changed(self.open_tab)
        self.open_tab(0)
        self.pictures = [self.image, *(picture for part in self.parts for picture in part.pictures)]
        for widget in (self.image.widget, self.mesh, self.panel):
            self.window.add_child(widget)
        for widget in (self.image.widget, self.mesh):
            widget.set_on_mouse(self._on_mouse)
        self.window.set_on_layout(self._on_layout)
        self.window.set_on_tick_event(self._on_tick)
        self._laid_out_for = (0, 0)
        self._box = (0, 0, 1, 1)  # of the picture, in the window's pixels
        self._is_stale, self._is_idle, self._moved_at = True, False, 0.0
        self._num_redraws = 0
        self._press: tuple[str, int, int] | None = None
        self._last = (0, 0)
        self._colored_by: tuple | None = None

    def run(self) -> None:
        """Show the window until it is closed."""
        self.app.run()

    def close(self) -> None:
        """Close the window at the next tick: at once, from a callback of its own, would crash."""
        self.app.post_to_main_thread(self.window, self.window.close)

    def open_tab(self, index: int) -> None:
        """Show one page of panels. The others must be invisible: the last would take the mouse from all before it."""
        if self.tabs.selected_tab_index != index:
            self.tabs.selected_tab_index = index
        for number, page in enumerate(self.pages):
            page.visible = number == index
        self.changed()

    def changed(self) -> None:
        """Called by the panels after they have changed the state."""
        self._is_stale, self._is_idle = True, False
        self.window.post_redraw()

    # ----------------------------------------------------------------------------------- layout and time

    def _on_layout(self, context) -> None:
        area = self.window.content_rect
        side = _PANEL_EM * self.window.theme.font_size
        self.image.widget.frame = gui.Rect(area.x, area.y, max(area.width - side, 1), area.height)
        self.panel.frame = gui.Rect(area.get_right() - side, area.y, side, area.height)
        size = (self.image.widget.frame.width, self.image.widget.frame.height)
        self._is_stale |= size != self._laid_out_for
        self._laid_out_for = size

    def _on_tick(self) -> bool:
        """Make the next picture if one is due; True where the window must be drawn again."""
        if self.mesh.visible:
            if self._press is None and time.monotonic() - self._moved_at > _STILL_SECONDS:
                self._stand_still()
                return True
            return False
        if self._is_stale:
            self._show_picture()
            return True
        if self._num_redraws > 0:
            self._num_redraws -= 1
            for shown in self.pictures:
                shown.send()
            return True
        if not self._is_idle:
            # What costs as much as a frame waits until nothing else is due, and is done piece by piece.
            page = list(TABS.values())[self.tabs.selected_tab_index]
            shown = [part for part in self.parts if isinstance(part, page)]
            self._is_idle = not any([part.refresh_idle() for part in shown])
            self.window.set_needs_layout()
            return True
        return False

    def _show_picture(self) -> None:
        area = self.image.widget.frame
        picture, box = self.state.display(max(area.width, 1), max(area.height, 1))
        self._box = (box[0] + area.x, box[1] + area.y, box[2], box[3])
        self.image.show(picture)
        self._is_stale, self._num_redraws = False, _REDRAWS
        self.status.text = self.state.cost_lines()[0]
        for part in self.parts:
            part.refresh()
        self.window.set_needs_layout()  # a label is as wide as its first text until then

    # ----------------------------------------------------------------------------------- mouse

    def _on_mouse(self, event) -> object:
        kind = gui.MouseEvent.Type
        if event.type == kind.BUTTON_DOWN:
            self._pressed(event)
        elif event.type == kind.DRAG and self._press is not None:
            self._dragged(event)
        elif event.type == kind.BUTTON_UP and self._press is not None:
            self._released(event)
        elif event.type == kind.WHEEL:
            self.state.zoom(event.wheel_dy)
            self._move_mesh()
        return gui.Widget.EventCallbackResult.CONSUMED

    def _pressed(self, event) -> None:
        x, y = self._in_picture(event)
        state, action = self.state, "orbit"
        if event.is_button_down(gui.MouseButton.RIGHT) or event.is_button_down(gui.MouseButton.MIDDLE):
            action = "pan"
        elif state.shows_gizmo:
            reach = _KNOB_PX * state.camera.width / max(self._box[2], 1)
            picked = state.gizmo.pick([light for light, _ in state.rack.shown], x, y, reach)
            if picked is not None:
                state.rack, action = state.rack.select(picked), "light"
        self._press, self._last = (action, event.x, event.y), (event.x, event.y)

    def _dragged(self, event) -> None:
        assert self._press is not None
        action, x0, y0 = self._press
        if action != "light" and not self.mesh.visible and max(abs(event.x - x0), abs(event.y - y0)) < _CLICK_PX:
            return
        scale = self.state.camera.width / max(self._box[2], 1)
        step = ((event.x - self._last[0]) * scale, (event.y - self._last[1]) * scale)
        self._last = (event.x, event.y)
        if action == "light":
            x, y = self._in_picture(event)
            gizmo = self.state.gizmo
            self.state.rack = self.state.rack.change(lambda light: gizmo.dragged(light, x, y))
            self.changed()
            return
        (self.state.orbit if action == "orbit" else self.state.pan)(*step)
        self._move_mesh()

    def _released(self, event) -> None:
        assert self._press is not None
        action = self._press[0]
        self._press = None
        if action == "orbit" and not self.mesh.visible:
            self.state.inspect(*self._in_picture(event))
            self.open_tab(_INSPECT)
            self.changed()

    def _in_picture(self, event) -> tuple[float, float]:
        left, top, width, height = self._box
        camera = self.state.camera
        return (event.x - left) * camera.width / max(width, 1), (event.y - top) * camera.height / max(height, 1)

    # ----------------------------------------------------------------------------------- while the camera moves

    def _move_mesh(self) -> None:
        """Show the mesh in the colours of the last picture, from where the camera is now."""
        self._moved_at = time.monotonic()
        if not self.mesh.visible:
            self._color_mesh()
            self.mesh.frame = gui.Rect(*self._box)
            self.mesh.visible, self.image.widget.visible = True, False
        intrinsics, pose, (near, far) = opencv_camera(self.state.camera, self.state.model.mesh)
        _, _, width, height = self._box
        scale = np.array([[width / self.state.camera.width], [height / self.state.camera.height], [1.0]])
        eye, turn = -pose[:3, :3].T @ pose[:3, 3], pose[:3, :3]
        camera = self.mesh.scene.camera
        camera.set_projection(intrinsics * scale, near, far, float(width), float(height))
        camera.look_at(*(v.astype(np.float32) for v in (eye + turn[2], eye, -turn[1])))
        self.mesh.force_redraw()
        self.window.post_redraw()

    def _color_mesh(self) -> None:
        state = self.state
        key = (id(state.rack.entries), state.layer_name, state.exposure)
        if key == self._colored_by:
            return
        self._colored_by = key
        mesh = open3d.t.geometry.TriangleMesh(
            open3d.core.Tensor(state.model.mesh.centered_vertices),
            open3d.core.Tensor(np.ascontiguousarray(state.model.mesh.faces)),
        )
        mesh.vertex.colors = open3d.core.Tensor(np.ascontiguousarray(state.quick_colors()))
        mesh.vertex.normals = open3d.core.Tensor(np.ascontiguousarray(state.model.mesh.vertex_normals))
        material = rendering.MaterialRecord()
        material.shader = "defaultUnlit"
        self.mesh.scene.clear_geometry()
        self.mesh.scene.add_geometry("mesh", mesh, material)

    def _stand_still(self) -> None:
        self.mesh.visible, self.image.widget.visible = False, True
        self.changed()

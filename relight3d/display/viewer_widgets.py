"""Open3D's widgets as the viewer's panels want them."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import UInt8

from relight3d.display.open3d_modules import gui, open3d


def row(em: float, *children) -> Any:
    row = gui.Horiz(0.4 * em)
    for child in children:
        row.add_child(child)
    return row


class Slider:
    """A slider that tells of a hand's moves only.

    Open3D's own also calls back when it is drawn with a value that was set outside of its limits, which would move a
    far lamp near.
    """

    def __init__(self, low: float, high: float, value: float, on_change: Callable[[float], None]) -> None:
        self.widget = gui.Slider(gui.Slider.DOUBLE)
        self.widget.set_limits(low, high)
        self._low, self._high, self._on_change = low, high, on_change
        self.show(value)
        self.widget.set_on_value_changed(self._moved)

    @property
    def value(self) -> float:
        return self.widget.double_value

    def show(self, value: float) -> None:
        self._shown = min(max(value, self._low), self._high)
        self.widget.double_value = self._shown

    def _moved(self, value: float) -> None:
        if abs(value - self._shown) > 1e-6 * (self._high - self._low):  # its own rounding is no move
            self._shown = value
            self._on_change(value)


def button(text: str, on_click: Callable[[], None]) -> Any:
    button = gui.Button(text)
    button.vertical_padding_em = 0.1
    button.set_on_clicked(on_click)
    return button


class Picture:
    """An image that is sure to be shown.

    Open3D loses an upload that meets a drawing, and the image before stays, even that of an earlier window; so it is
    sent again a few times (`send`). Open3D also keeps the room that an image takes at first.
    """

    def __init__(self, width: int, height: int) -> None:
        self._image = _image(np.full((height, width, 3), 45, np.uint8))
        self.widget = gui.ImageWidget(self._image)

    def show(self, pixels: UInt8[np.ndarray, "rows columns 3"]) -> None:
        self._image = _image(pixels)
        self.send()

    def send(self) -> None:
        self.widget.update_image(self._image)


def _image(pixels: np.ndarray) -> Any:
    return open3d.geometry.Image(np.ascontiguousarray(pixels))

"""The viewer: a window with the relit scene live, and the same picture without a window."""

import pickle
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

from relight3d.display.child import start_child
from relight3d.display.frames import write_frame
from relight3d.display.layers import paint_layer
from relight3d.display.pixel_figure import pixels_of
from relight3d.display.probe import window_trouble
from relight3d.display.viewer_state import RELIT, ViewerState
from relight3d.errors import DisplayError, InputError
from relight3d.io.images import write_png
from relight3d.lights import Light
from relight3d.records import Capture, RelightModel


def view(model: RelightModel, capture: Capture | None = None, lights: Sequence[Light] | None = None) -> None:
    """Open a window on a model and return when it is closed. With its capture, layers of evidence are there too.

    The window lives in a process of its own: Open3D keeps some 50 MB of each window that it closes, and aborts where
    a driver fails. Raises DisplayError, in one line, where no window can be opened.
    """
    problem, hint = window_trouble()
    if problem:
        raise DisplayError("view", problem, "a screen and a Vulkan driver", hint)
    with TemporaryFile() as said:
        child = start_child("relight3d.display.viewer_child", stdin=subprocess.PIPE, stderr=said)
        try:
            assert child.stdin is not None
            with suppress(BrokenPipeError):  # it is gone already: its exit says why
                pickle.dump((model, capture, lights), child.stdin, protocol=pickle.HIGHEST_PROTOCOL)
                child.stdin.close()
            code = child.wait()
        finally:
            child.kill()  # where the wait was interrupted; nothing to a process that has ended
            child.wait()
        if code != 0:
            said.seek(0)
            lines = said.read().decode("utf-8", "replace").strip().splitlines()
            raise DisplayError("view", f"exit {code}: {lines[-1] if lines else 'no word'}", "a window that stays")


def screenshot(
    model: RelightModel,
    path: str | Path,
    layer: str | None = None,
    lights: Sequence[Light] | None = None,
    capture: Capture | None = None,
) -> Path:
    """Write what the viewer would show, without a screen: the relit frame, or a layer with its title and legend.

    The frame's pixels are the Relighter's own (.png, or .exr for linear radiance). Raises InputError for an unknown
    layer, for one of evidence without the capture, and for a name that is no picture's.
    """
    path, state = Path(path), ViewerState(model, capture, lights)
    if layer is None or layer == RELIT:
        write_frame(path, state.frame())
        return path
    if path.suffix.lower() != ".png":
        raise InputError("screenshot", str(path), "a name that ends in .png")
    shown = paint_layer(state.subject, layer, state.rack.active)
    write_png(path, pixels_of(shown.figure()))
    return path

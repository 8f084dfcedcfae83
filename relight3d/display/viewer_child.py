"""The viewer's process: what to show comes pickled from the parent by standard input; it ends with the window."""

import os
import pickle
import sys


def main() -> None:
    """Show a (model, capture, lights) until the window is closed."""
    # Open3D's engine greets on standard output, which is the parent's.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    model, capture, lights = pickle.load(sys.stdin.buffer)
    from relight3d.display.viewer_state import ViewerState
    from relight3d.display.viewer_window import ViewerWindow

    state = ViewerState(model, capture, lights)
    state.picture()  # what is wrong with the model is said here, not in a callback of the window
    ViewerWindow(state).run()

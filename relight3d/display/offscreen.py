"""Pictures from Open3D's offscreen renderer, made in a child process.

A child, because Open3D aborts its process where two renderers are alive, where another thread draws, or where a driver
fails; and because Debian 12's software driver leaks 2 MB a picture. The child ends with its parent, and is replaced
after `PICTURES_PER_PROCESS`.
"""

import subprocess
import threading
from contextlib import suppress
from functools import cache
from io import BufferedIOBase

import numpy as np
from jaxtyping import UInt8

from relight3d.display.child import start_child
from relight3d.display.offscreen_worker import receive, send
from relight3d.display.probe import vulkan_trouble
from relight3d.errors import DisplayError

PICTURES_PER_PROCESS = 250
_PATIENCE_SECONDS = 180.0  # the first picture compiles shaders: 15 s were seen


class Offscreen:
    """An offscreen renderer. Raises DisplayError where none can be had, in one line."""

    def __init__(self) -> None:
        self._child: subprocess.Popen | None = None
        self._num_pictures = 0
        self._lock = threading.Lock()

    def render(self, **request: np.ndarray) -> UInt8[np.ndarray, "height width 3"]:
        """One picture: of `pixels`, which come back as they are, or of a mesh (offscreen_worker says of what)."""
        problem, hint = vulkan_trouble()
        if problem:
            raise DisplayError("Open3D's renderer", problem, "a Vulkan driver", hint)
        with self._lock:
            if self._num_pictures >= PICTURES_PER_PROCESS:
                self._end()
            child = self._started()
            self._num_pictures += 1
            answer = self._ask(child, request)
            if answer is None or "error" in answer:
                code = self._end()
                got = "an exit in the middle" if answer is None else str(answer["error"])
                raise DisplayError("Open3D's renderer", f"{got} (exit {code})", "a picture")
        return answer["picture"]

    def close(self) -> None:
        """End the child process. The next picture starts another."""
        with self._lock:
            self._end()

    def __enter__(self) -> "Offscreen":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _started(self) -> subprocess.Popen:
        if self._child is not None and self._child.poll() is not None:
            self._end()  # it died between two pictures: its pipes are closed here
        if self._child is None:
            self._child = start_child(
                "relight3d.display.offscreen_worker",
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,  # what Open3D's engine says is nobody's business; errors come as answers
            )
            self._num_pictures = 0
        return self._child

    def _ask(self, child: subprocess.Popen, request: dict[str, np.ndarray]) -> dict[str, np.ndarray] | None:
        assert isinstance(child.stdin, BufferedIOBase) and isinstance(child.stdout, BufferedIOBase)
        watchdog = threading.Timer(_PATIENCE_SECONDS, child.kill)
        watchdog.start()
        try:
            send(child.stdin, **request)
            return receive(child.stdout)
        except OSError:  # the child went while it was spoken to
            return None
        finally:
            watchdog.cancel()

    def _end(self) -> int | None:
        child, self._child, self._num_pictures = self._child, None, 0
        if child is None:
            return None
        assert child.stdin is not None and child.stdout is not None
        with suppress(OSError):  # what was left in the buffer has no reader any more
            child.stdin.close()
        try:
            code = child.wait(timeout=10)
        except subprocess.TimeoutExpired:
            child.kill()
            code = child.wait()
        child.stdout.close()
        return code


@cache
def shared_offscreen() -> Offscreen:
    """The renderer that all of this process share; its child ends when this process does."""
    import atexit

    renderer = Offscreen()
    atexit.register(renderer.close)
    return renderer

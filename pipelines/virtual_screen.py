"""A virtual screen: Xvfb, and its picture read from its framebuffer file. For pictures and tests of the viewer."""

import os
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np

HAS_XVFB = shutil.which("Xvfb") is not None


class XScreen:
    """A running Xvfb with its framebuffer in a folder; `display` is what DISPLAY must be."""

    def __init__(self, folder: Path, size: str = "1000x640x24") -> None:
        read_end, write_end = os.pipe()
        command = ["Xvfb", "-displayfd", str(write_end), "-screen", "0", size, "-fbdir", str(folder)]
        command += ["-ac", "-nolisten", "tcp"]
        self._process = subprocess.Popen(command, pass_fds=[write_end], stderr=subprocess.DEVNULL)
        os.close(write_end)
        with os.fdopen(read_end) as pipe:
            number = pipe.readline().strip()  # Xvfb writes it when it is ready
        assert number, "Xvfb did not start"
        self.display = f":{number}"
        self.framebuffer = folder / "Xvfb_screen0"

    @property
    def process_id(self) -> int:
        return self._process.pid

    def __enter__(self) -> "XScreen":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(timeout=20)


def read_screen(framebuffer: Path) -> np.ndarray:
    """What the screen shows, 8-bit rgb; the file is an X window dump whose header is big-endian."""
    data = framebuffer.read_bytes()
    header = struct.unpack(">25I", data[:100])
    width, height, bytes_per_line, num_colors = header[4], header[5], header[12], header[19]
    start = header[0] + 12 * num_colors
    rows = np.frombuffer(data, np.uint8, height * bytes_per_line, start).reshape(height, bytes_per_line)
    return rows[:, : 4 * width].reshape(height, width, 4)[..., 2::-1].copy()

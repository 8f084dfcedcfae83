"""Can Open3D draw here? Asked before Open3D is: without a Vulkan driver it does not raise, it aborts the interpreter.

The questions are put in a child process (this file, run as a script), since a broken driver may take its process
along. On macOS and Windows drawing needs nothing that could be missing, and nothing is asked.
"""

import ctypes
import ctypes.util
import os
import subprocess
import sys
from functools import cache

_VULKAN_HINT = "install libvulkan1 and a driver (any computer: mesa-vulkan-drivers)"
_SCREEN_HINT = "run it on a desktop, under xvfb-run, or ask for a picture instead (--screenshot)"
_SETTINGS = ("VK_DRIVER_FILES", "VK_ICD_FILENAMES", "VK_ADD_DRIVER_FILES", "XDG_DATA_DIRS", "DISPLAY", "XAUTHORITY")


def vulkan_trouble() -> tuple[str, str]:
    """What keeps Open3D from drawing at all, and what to do about it; two empty strings where nothing does."""
    return _answer("vulkan", _settings())


def window_trouble() -> tuple[str, str]:
    """What keeps Open3D from opening a window, and what to do about it; two empty strings where nothing does."""
    trouble = vulkan_trouble()
    return trouble if trouble[0] else _answer("screen", _settings())


def _settings() -> tuple[str | None, ...]:
    return tuple(os.environ.get(name) for name in _SETTINGS)


@cache
def _answer(question: str, settings: tuple[str | None, ...]) -> tuple[str, str]:
    """The child's answer; asked again when one of the settings that decide it has changed."""
    if not sys.platform.startswith("linux"):
        return "", ""
    hint = _VULKAN_HINT if question == "vulkan" else _SCREEN_HINT
    command = [sys.executable, "-I", __file__, question]
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=60, stdin=subprocess.DEVNULL)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"a {question} that does not answer ({type(error).__name__})", hint
    if child.returncode != 0:
        return f"a {question} driver that crashes (exit {child.returncode})", hint
    return (child.stdout, hint) if child.stdout else ("", "")


# ------------------------------------------------------------------------------------- in the child process


class _InstanceInfo(ctypes.Structure):
    """VkInstanceCreateInfo, all defaults."""

    _fields_ = (
        ("type", ctypes.c_int32),
        ("next", ctypes.c_void_p),
        ("flags", ctypes.c_uint32),
        ("application", ctypes.c_void_p),
        ("num_layers", ctypes.c_uint32),
        ("layers", ctypes.c_void_p),
        ("num_extensions", ctypes.c_uint32),
        ("extensions", ctypes.c_void_p),
    )


def _ask_vulkan() -> str:
    try:
        vulkan = ctypes.CDLL("libvulkan.so.1")
    except OSError:
        return "no Vulkan (libvulkan.so.1)"
    info, instance, count = _InstanceInfo(type=1), ctypes.c_void_p(), ctypes.c_uint32()
    if vulkan.vkCreateInstance(ctypes.byref(info), None, ctypes.byref(instance)) != 0:
        return "no Vulkan driver"
    found = vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    return "" if found == 0 and count.value > 0 else "no Vulkan device"


def _ask_screen() -> str:
    if not os.environ.get("DISPLAY"):
        return "no screen (DISPLAY is not set)"
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError:
        return "no X11 (libX11.so.6)"
    x11.XOpenDisplay.restype = ctypes.c_void_p
    return "" if x11.XOpenDisplay(None) else f"a screen that cannot be opened (DISPLAY={os.environ['DISPLAY']})"


if __name__ == "__main__":
    sys.stdout.write({"vulkan": _ask_vulkan, "screen": _ask_screen}[sys.argv[1]]())

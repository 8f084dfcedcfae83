"""Python in a child process that finds what its parent finds, wherever either was started."""

import subprocess
import sys

_START = (
    "import sys; sys.path[:] = sys.argv[2:]; from importlib import import_module; import_module(sys.argv[1]).main()"
)


def start_child(module: str, **pipes) -> subprocess.Popen:
    """Run `main()` of a module of this library; `pipes` are those of subprocess.Popen."""
    return subprocess.Popen([sys.executable, "-c", _START, module, *sys.path], **pipes)

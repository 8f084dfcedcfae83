"""How the scripts start: arguments from the parameters of `main`, and bad input said in one line, as `relight3d` does."""

import sys
from collections.abc import Callable
from pathlib import Path

import tyro

from relight3d.errors import InputError


def start(main: Callable[..., None], words: str | None) -> None:
    """Run a script; `words`, its own docstring, are its help. Exit status 2 for bad input."""
    try:
        tyro.cli(main, description=words)
    except InputError as error:
        sys.stderr.write(f"{Path(sys.argv[0]).name}: {error}\n")
        raise SystemExit(2) from None

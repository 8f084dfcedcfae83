"""What all commands share."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from relight3d.errors import InputError
from relight3d.progress import shown_log

_CAPTURE = tyro.conf.arg(metavar="CAPTURE", help="a folder with transforms.json")
_MODEL = tyro.conf.arg(metavar="MODEL", help="a model file")
CapturePath = Annotated[Path, tyro.conf.Positional, _CAPTURE]
ModelPath = Annotated[Path, tyro.conf.Positional, _MODEL]
Flag = tyro.conf.FlagCreatePairsOff[bool]


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command and its arguments; `run` does the work and raises InputError for bad input."""

    quiet: Annotated[Flag, tyro.conf.arg(aliases=["-q"])] = False  # no progress bar
    verbose: Annotated[Flag, tyro.conf.arg(aliases=["-v"])] = False  # a log line for each stage instead of a bar

    def start(self) -> None:
        """Run with the log shown."""
        with shown_log(self.verbose):
            self.run()

    def run(self) -> None:
        raise NotImplementedError

    @property
    def hides_bar(self) -> bool:
        return self.quiet or self.verbose


def require_writable(path: Path) -> None:
    """Raises InputError for an output that cannot be written: to be asked before the work, not after it."""
    if path.is_dir():
        raise InputError(str(path), "a folder", "the name of a file")
    place = path.absolute().parent
    while not place.exists():
        place = place.parent
    if not (place.is_dir() and os.access(place, os.W_OK)):
        raise InputError(str(path), f"no place for it in {place}", "a folder that can be written")

"""Sequences of frames as files: numbered frames that a later run continues, and films."""

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from relight3d.display.frames import show_frame_u8
from relight3d.errors import InputError
from relight3d.io.files import atomic_path, write_json
from relight3d.records import Frame

LIST_NAME = "frames.json"  # in a folder of numbered frames: what each was made of


def missing_frames(folder: Path, suffix: str, hashes: Sequence[str]) -> dict[int, Path]:
    """The frames still to be made, by number, with their files; `hashes` say what each of the sequence is made of.

    Frames of another make are removed first, and only then is the new list written: whenever the run is stopped, a
    file that is there and listed is what the list says.
    """
    listed = _listed(folder)
    wanted = {f"frame_{index:04d}.{suffix}": digest for index, digest in enumerate(hashes)}
    for name in {*listed, *wanted}:
        if listed.get(name) != wanted.get(name):
            (folder / name).unlink(missing_ok=True)
    write_json(folder / LIST_NAME, wanted)
    return {
        index: folder / name
        for index, name in enumerate(wanted)
        if listed.get(name) != wanted[name] or not (folder / name).is_file()
    }


def write_film(path: Path, frames: Iterable[Frame], fps: float, exposure: float | None = None) -> None:
    """Write an H.264 film, one frame in memory at a time. Raises InputError where ffmpeg is missing or fails."""
    if not 0 < fps <= 1000:
        raise InputError("fps", fps, "a number above 0 and at most 1000")
    import imageio_ffmpeg

    pictures = (_even(show_frame_u8(frame, exposure)) for frame in frames)
    first = next(pictures)
    size = (first.shape[1], first.shape[0])
    with atomic_path(path) as temporary, _said_by_ffmpeg(path):
        writer = imageio_ffmpeg.write_frames(
            str(temporary), size, fps=fps, quality=8, macro_block_size=1, ffmpeg_log_level="quiet"
        )
        with closing(writer):
            writer.send(None)
            for picture in chain([first], pictures):
                if picture.shape != first.shape:
                    raise InputError("camera", "frames of several sizes", "one size for all frames of a film")
                writer.send(np.ascontiguousarray(picture))


@contextmanager
def _said_by_ffmpeg(path: Path) -> Iterator[None]:
    """What stops ffmpeg, as an InputError: it is missing on this platform, or its pipe breaks when the disk is full."""
    try:
        yield
    except RuntimeError as error:
        hint = "write numbered frames to a folder instead"
        raise InputError(str(path), error, "a system with ffmpeg", hint) from error
    except OSError as error:
        raise InputError(str(path), "ffmpeg stopped in the midst of it", "a disk with room for the film") from error


def _listed(folder: Path) -> dict[str, str]:
    """What the folder's list says of its frames; a list that cannot be read says nothing."""
    try:
        listed = json.loads((folder / LIST_NAME).read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    names = listed if isinstance(listed, dict) else {}
    return {name: digest for name, digest in names.items() if name.startswith("frame_") and "/" not in name}


def _even(picture: UInt8[np.ndarray, "height width 3"]) -> UInt8[np.ndarray, "rows columns 3"]:
    """The picture with its last row and column doubled where a side is odd, for H.264 halves its colours' sides."""
    height, width = picture.shape[:2]
    return np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")

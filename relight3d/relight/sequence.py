"""Frames one after the other: a moving light, a moving camera, or both; in memory one at a time."""

import hashlib
import json
import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import repeat
from pathlib import Path

import numpy as np

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.lights import Light
from relight3d.records import Frame, RelightModel
from relight3d.relight.options import RelightOptions
from relight3d.relight.relighter import Relighter

LIST_NAME = "sequence.json"  # beside the frames: what each was made of

logger = logging.getLogger(__name__)


def frames_of_sequence(
    model: RelightModel | Relighter,
    lights: Sequence[Sequence[Light]],
    cameras: Sequence[Camera] | None = None,
    options: RelightOptions | None = None,
    skip: frozenset[int] = frozenset(),
) -> Iterator[tuple[int, Frame]]:
    """Number and frame of each set of lights, but for those to `skip`; a view is made anew only where the camera moves.

    One camera, or none for the model's own, serves all lights; one set of lights serves all cameras. Raises InputError
    for two sequences of unequal length.
    """
    relighter = model if isinstance(model, Relighter) else None
    for index, (each, camera) in enumerate(_shots(lights, cameras)):
        if index in skip:
            continue
        if relighter is None:
            assert isinstance(model, RelightModel)
            relighter = Relighter(model, camera, options)
        elif camera is not None and not camera.same_as(relighter.camera):
            relighter.set_camera(camera)
        yield index, relighter.render(each)


def render_sequence(
    model: RelightModel | Relighter,
    lights: Sequence[Sequence[Light]],
    out: str | Path,
    cameras: Sequence[Camera] | None = None,
    options: RelightOptions | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Linear EXR frames in a folder, numbered; a later run goes on where this one stopped.

    A frame that is there and was made of the same lights, camera and settings is kept; `progress` is told the frames
    done and to do. Returns the files in order. Films are `relight3d render`'s.
    """
    from relight3d.io.exr import write_exr
    from relight3d.io.files import atomic_path, write_json

    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"frame_{index:04d}.exr" for index in range(len(list(_shots(lights, cameras))))]
    wanted = _digests(model, lights, cameras, options)
    kept = _kept(folder, paths, wanted)
    # The list is written first and lists only what is there: whenever the run stops, a listed file is what it says.
    made = {paths[index].name: wanted[index] for index in kept}
    write_json(folder / LIST_NAME, made)
    for index, frame in frames_of_sequence(model, lights, cameras, options, frozenset(kept)):
        with atomic_path(paths[index]) as temporary:
            write_exr(temporary, frame.radiance)
        made[paths[index].name] = wanted[index]
        write_json(folder / LIST_NAME, made)
        if progress is not None:
            progress(len(made), len(paths))
    logger.info("sequence: %d frames rendered, %d were there", len(paths) - len(kept), len(kept))
    return paths


def _shots(
    lights: Sequence[Sequence[Light]], cameras: Sequence[Camera] | None
) -> Iterable[tuple[Sequence[Light], Camera | None]]:
    if cameras is None:
        return zip(lights, repeat(None))
    if len(lights) > 1 and len(cameras) > 1 and len(lights) != len(cameras):
        raise InputError("cameras", len(cameras), f"1, or one for each of {len(lights)} sets of lights")
    num = 0 if not lights or not cameras else max(len(lights), len(cameras))
    return zip(list(lights) * (num if len(lights) == 1 else 1), list(cameras) * (num if len(cameras) == 1 else 1))


def _digests(
    model: RelightModel | Relighter,
    lights: Sequence[Sequence[Light]],
    cameras: Sequence[Camera] | None,
    options: RelightOptions | None,
) -> list[str]:
    """What each frame is made of; of the model, what a frame shows most of."""
    if isinstance(model, Relighter):
        given, options, own = model.given_model, model.options, model.camera
    else:
        given, options, own = model, options or RelightOptions(), model.camera
    base = hashlib.sha256(repr(options).encode())
    for array in (given.mesh.vertices, given.pixels.albedo, given.pixels.normal, given.albedo_unseen):
        base.update(np.ascontiguousarray(array).tobytes())
    digests = []
    for each, camera in _shots(lights, cameras):
        one = base.copy()
        shot = [[light.to_dict() for light in each], (camera or own).to_dict()]
        one.update(json.dumps(shot, sort_keys=True).encode())
        digests.append(one.hexdigest()[:32])
    return digests


def _kept(folder: Path, paths: list[Path], wanted: list[str]) -> set[int]:
    """The frames that are there and as wanted."""
    try:
        listed = json.loads((folder / LIST_NAME).read_text("utf-8"))
    except (OSError, ValueError):
        return set()
    if not isinstance(listed, dict):
        return set()
    return {k for k, path in enumerate(paths) if listed.get(path.name) == wanted[k] and path.is_file()}

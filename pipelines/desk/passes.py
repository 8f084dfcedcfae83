"""Resumable renders: each pass (one lamp from one view, or the lights-off scene) grows by chunks of samples on disk."""

import logging
import time
from dataclasses import dataclass
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from desk.lamp_paths import LampPaths
from desk.lights import Lamp
from desk.scene import load_scene, mirror_plane
from desk.settings import SceneSettings

log = logging.getLogger("desk")


@dataclass(frozen=True)
class Pass:
    """One picture to be accumulated. Without a lamp it is the lights-off scene."""

    name: str
    camera: np.ndarray
    lamp: Lamp | None
    seed: int


@dataclass(frozen=True)
class Picture:
    """Means over samples, float32 (height, width, 3); the two parts are within the total."""

    total: np.ndarray
    direct: np.ndarray
    thrown: np.ndarray
    samples: int


def picture_path(work: Path, one: Pass) -> Path:
    return work / f"{one.name}.npz"


def read_picture(work: Path, one: Pass) -> Picture | None:
    path = picture_path(work, one)
    if not path.exists():
        return None
    with np.load(path) as held:
        return Picture(held["total"], held["direct"], held["thrown"], int(held["samples"]))


def render_chunk(settings: SceneSettings, mesh_path: Path, one: Pass, work: Path, chunk: int, index: int) -> np.ndarray:
    """One chunk's mean, (height, width, 9): total, direct, thrown."""
    scene = load_scene(settings, mesh_path, one.camera, one.lamp, work)
    if one.lamp is None:
        integrator = mi.load_dict({"type": "path", "max_depth": settings.max_depth + 2})
    else:
        integrator = LampPaths(
            mirror_plane(settings), one.lamp.position, np.array(one.lamp.to_light), settings.max_depth
        )
    values = np.array(mi.render(scene, integrator=integrator, seed=one.seed * 10007 + index, spp=chunk))
    dr.flush_malloc_cache()
    return (
        values if values.shape[-1] == 9 else np.concatenate([values, np.zeros((*values.shape[:2], 6), np.float32)], -1)
    )


def grow(settings: SceneSettings, mesh_path: Path, one: Pass, work: Path, samples: int) -> None:
    """One more chunk, unless the pass has `samples` already."""
    held = read_picture(work, one)
    done = held.samples if held else 0
    if done >= samples:
        return
    start = time.perf_counter()
    fresh = render_chunk(settings, mesh_path, one, work, settings.chunk, done // settings.chunk)
    parts = [fresh[..., 3 * i : 3 * i + 3] for i in range(3)]
    if held:
        share = settings.chunk / (done + settings.chunk)
        parts = [
            old * (1 - share) + new * share
            for old, new in zip((held.total, held.direct, held.thrown), parts, strict=True)
        ]
    names = dict(zip(("total", "direct", "thrown"), (part.astype(np.float32) for part in parts), strict=True))
    half_done = picture_path(work, one).with_suffix(".part.npz")
    np.savez(half_done, samples=done + settings.chunk, **names)
    half_done.replace(picture_path(work, one))
    log.debug("%s: %d of %d samples, %.1f s", one.name, done + settings.chunk, samples, time.perf_counter() - start)


def grow_all(
    settings: SceneSettings, mesh_path: Path, passes: list[Pass], work: Path, level: float, until: float
) -> bool:
    """All passes to `level` (0 to 1) of their samples, in rounds; False where the time `until` came first."""
    goals = [
        max(settings.chunk, round(level * (settings.samples if one.lamp else settings.ambient_samples)))
        for one in passes
    ]
    num_rounds = -(-max(goals) // settings.chunk)
    for i in range(num_rounds):
        log.info("round %d of %d (the lights-off scene needs the most)", i + 1, num_rounds)
        for one, goal in zip(passes, goals, strict=True):
            if time.monotonic() > until:
                return False
            grow(settings, mesh_path, one, work, goal)
    return True

"""The whole: mesh, lamps, passes, photographs, truth, checks (`variant.choose` comes first)."""

import hashlib
import json
import logging
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import mitsuba as mi
import numpy as np

from desk import checks, folder, truth
from desk.lights import RED, WHITE, Lamp, place_lamps, powers
from desk.passes import Pass, grow_all, read_picture
from desk.scene import load_scene, world_from_camera
from desk.settings import SceneSettings
from desk.shapes import build, write_ply

log = logging.getLogger("desk")
DRAFT_LEVEL = 0.125


@dataclass(frozen=True)
class Shot:
    """One photograph: which passes it sums, and in which colours."""

    name: str
    split: str
    group: str
    turn_deg: float
    lamps: tuple[tuple[Lamp, tuple[float, float, float]], ...]


@dataclass(frozen=True)
class Job:
    """One capture being made: what, where, and from which passes."""

    settings: SceneSettings
    out: Path
    work: Path
    shots: list[Shot]
    passes: dict[tuple, Pass]

    def shots_of(self, group: str, split: str) -> list[Shot]:
        return [shot for shot in self.shots if (shot.group, shot.split) == (group, split)]


def plan_shots(settings: SceneSettings, train: list[Lamp], test: list[Lamp]) -> list[Shot]:
    """Every photograph of the capture. A point lamp's intensity makes up for its distance from the target."""
    colors = powers(settings.lamps, len(train) + len(test))

    def power(lamp: Lamp, color) -> tuple[Lamp, tuple[float, float, float]]:
        squared = 1.0 if lamp.position is None else float(np.square(lamp.position).sum())
        return lamp, tuple(round(float(c) * squared, 4) for c in color)

    shots = [Shot(lamp.name, "train", "one_light", 0.0, (power(lamp, c),)) for lamp, c in zip(train, colors)]
    if settings.walls:
        shots.append(Shot("lights_off", "train", "lights_off", 0.0, ()))
    held_out = dict(zip(test, colors[len(train) :]))
    shots += [Shot(lamp.name, "test", "one_light", 0.0, (power(lamp, c),)) for lamp, c in held_out.items()]
    directions = np.array([lamp.to_light for lamp in test])
    for i in range(settings.lamps.num_two_lights):
        red, white = test[2 * i], test[int((directions @ directions[2 * i]).argmin())]
        strength = settings.lamps.strength
        both = power(red, np.array(RED) * strength), power(white, np.array(WHITE) * 0.6 * strength)
        shots.append(Shot(f"pair_{i:02d}", "test", "two_lights", 0.0, both))
    for i, turn_deg in enumerate(settings.lamps.new_view_turns_deg):
        lamp = test[(-3 - 2 * i) % len(test)]
        shots.append(Shot(f"view_{i:02d}", "test", "new_view", turn_deg, (power(lamp, held_out[lamp]),)))
    return shots


def plan_passes(settings: SceneSettings, shots: list[Shot]) -> dict[tuple, Pass]:
    """Each (view, lamp or None) once, by its key; seeds differ everywhere."""
    passes: dict[tuple, Pass] = {}
    for shot in shots:
        for lamp in (None, *(lamp for lamp, _ in shot.lamps)):
            key = pass_key(shot.turn_deg, lamp)
            if key not in passes and (lamp is not None or settings.walls):
                camera = world_from_camera(settings.view, shot.turn_deg)
                passes[key] = Pass("_".join(key), camera, lamp, settings.seed * 1000 + len(passes))
    return passes


def pass_key(turn_deg: float, lamp: Lamp | None) -> tuple[str, str]:
    return f"turn{turn_deg:+.0f}", lamp.name if lamp else "ambient"


def compose(job: Job, shot: Shot, passes: dict[tuple, Pass], part: str = "total") -> np.ndarray:
    """The photograph, or its `direct` or `thrown` part: light adds."""
    image = np.zeros((job.settings.view.height_px, job.settings.view.width_px, 3))
    lights_off = passes.get(pass_key(shot.turn_deg, None))
    if part == "total" and lights_off:
        image += read_picture(job.work, lights_off).total
    for lamp, color in shot.lamps:
        image += getattr(read_picture(job.work, passes[pass_key(shot.turn_deg, lamp)]), part) * np.array(color)
    return image


def write_photographs(job: Job) -> None:
    frames = []
    for shot in job.shots:
        path = f"images/{shot.name}.exr"
        folder.write_exr(job.out / path, compose(job, shot, job.passes))
        frames.append({
            "file_path": path, "split": shot.split, "group": shot.group,
            "transform_matrix": np.round(world_from_camera(job.settings.view, shot.turn_deg), 12).tolist(),
            "lights": [folder.light(lamp, color) for lamp, color in shot.lamps],
        })  # fmt: skip
    folder.write_json(job.out / "transforms.json", folder.transforms(job.settings.view, frames))


def write_truth(job: Job) -> dict:
    """Truth of the captured view, and the parts of three held-out frames; returns what the files measure."""
    camera = world_from_camera(job.settings.view)
    tests = job.shots_of("one_light", "test")
    scene = load_scene(job.settings, job.out / "mesh.ply", camera, tests[0].lamps[0][0], job.work)
    known = truth.measure_truth(job.settings, scene, camera)
    folder.write_png(job.out / "truth/surface_label.png", known.label)
    for name, pixels in (("albedo", known.albedo), ("normals", known.normals), ("depth", known.depth_m)):
        folder.write_exr(job.out / f"truth/{name}.exr", pixels)
    surfaces = {i: {"name": thing.name, **asdict(thing.material)} for i, thing in enumerate(job.settings.things)}
    folder.write_json(job.out / "truth/surfaces.json", surfaces)
    parted = {tests[0].name, max(tests[1:], key=lambda shot: compose(job, shot, job.passes, "thrown").sum()).name}
    for shot in [shot for shot in tests if shot.name in parted] + job.shots_of("new_view", "test")[:1]:
        for part in ("direct", "thrown"):
            folder.write_exr(job.out / f"truth/{part}/{shot.name}.exr", compose(job, shot, job.passes, part))
    units, registration = {}, {}
    for shot in tests:
        ((lamp, color),) = shot.lamps
        is_lit = truth.measure_is_lit(scene, known, lamp)
        folder.write_png(job.out / f"truth/is_lit/{shot.name}.png", is_lit.astype(np.uint8) * 255)
        if shot.name in parted:
            under = checks.Under(job.settings, known, is_lit, lamp, np.array(color), camera[:3, 3])
            direct = folder.read_exr(job.out / f"truth/direct/{shot.name}.exr")
            units[shot.name] = checks.units(under, direct)
            registration[shot.name] = checks.registration_px(under, direct)
    return {
        "units_radiance_over_expected": units, "registration_px": registration,
        "sensor_error_px": truth.sensor_error_px(scene, job.settings.view, camera),
        "surface_error_m": checks.surface_error_m(job.settings, known), **measure_photographs(job, known),
    }  # fmt: skip


def measure_photographs(job: Job, known: truth.Truth) -> dict:
    """Coverage, lights-off level and noise floor, from the written files."""
    is_seen = known.label != truth.NO_SURFACE
    images = {shot.name: folder.read_exr(job.out / f"images/{shot.name}.exr") for shot in job.shots}
    lit = np.mean([images[shot.name][is_seen].mean() for shot in job.shots_of("one_light", "train")])
    off = float(images["lights_off"][is_seen].mean() / lit) if "lights_off" in images else 0.0
    shot = job.shots_of("one_light", "test")[0]
    again = {tuple(one.name.removeprefix("repeat_").split("_", 1)): one for one in repeats(job)}
    other = compose(job, shot, again).astype(np.float16).astype(np.float32)
    white = np.percentile(list(images.values()), checks.WHITE_PERCENTILE)
    return {
        "share_of_pixels_on_mesh": round(float(is_seen.mean()), 4), "lights_off_over_lit": round(off, 4),
        "noise_floor": {
            "frame": shot.name, **checks.noise_floor(images[shot.name], other, white, known, job.settings)
        },
    }  # fmt: skip


def repeats(job: Job) -> list[Pass]:
    """The passes of the first held-out frame once more, with other seeds."""
    shot = job.shots_of("one_light", "test")[0]
    keys = [key for key in (pass_key(0.0, None), pass_key(0.0, shot.lamps[0][0])) if key in job.passes]
    again = [job.passes[key] for key in keys]
    return [replace(one, name=f"repeat_{one.name}", seed=one.seed + 500) for one in again]


def start_job(settings: SceneSettings, out: Path, work: Path) -> Job:
    """Writes the mesh and plans the rest. Other settings (but for more samples) work in another folder."""
    grown = {"samples", "ambient_samples"}
    key = json.dumps({k: v for k, v in asdict(settings).items() if k not in grown}, sort_keys=True)
    work = work / f"{settings.name}_{hashlib.sha256(key.encode()).hexdigest()[:10]}"
    for path in (out, work):
        path.mkdir(parents=True, exist_ok=True)
    parts = [build(thing) for thing in settings.things]
    folder.settle(out / "mesh.ply", lambda path: write_ply(path, parts))
    lamps = place_lamps(settings.lamps, settings.walls, np.concatenate([part.points for part in parts]))
    shots = plan_shots(settings, *lamps)
    return Job(settings, out, work, shots, plan_passes(settings, shots))


def make(settings: SceneSettings, out: Path, work: Path, budget_s: float) -> None:
    """Renders (or goes on rendering) until done or out of time; writes the folder at a draft level and at the end."""
    until = time.monotonic() + budget_s
    job = start_job(settings, out, work)
    todo = [*job.passes.values(), *repeats(job)]
    for level in (DRAFT_LEVEL, 1.0):
        is_done = grow_all(settings, out / "mesh.ply", todo, job.work, level, until)
        pictures = {one.name: read_picture(job.work, one) for one in todo}
        if None in pictures.values():
            log.warning("out of time before every pass had a chunk: nothing written, run again to go on")
            return
        write_photographs(job)
        measured = write_truth(job)
        folder.write_json(out / "truth/noise.json", measured["noise_floor"])
        folder.write_json(out / "truth/settings.json", {
            "made_with": {"mitsuba": mi.__version__, "variant": mi.variant(), "numpy": np.__version__},
            "is_final": is_done and level == 1.0, "measured": measured, "settings": asdict(settings),
            "samples_of_passes": {name: picture.samples for name, picture in pictures.items()},
        })  # fmt: skip
        log.info("written at level %g: %s", level, json.dumps(measured))
        if not is_done:
            return

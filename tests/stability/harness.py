"""What a stability case is, and what every recovery must fulfil whatever it was given.

A case is a function that builds something nasty, asserts what physics says about it, and returns an Outcome. The tests
and the table in docs/stability.md run the same list (`CASES`).
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np

from relight3d.evaluate.scenes import Scene, desk_scene, hemisphere_lights
from relight3d.evaluate.synthetic import synthesize
from relight3d.evaluate.world import World
from relight3d.lights import Light
from relight3d.maths.lafortune import lobe_energy
from relight3d.maths.least_squares import Status
from relight3d.records import Capture, Photograph, RelightModel
from relight3d.recover.mesh import MeshOptions
from relight3d.recover.run import RecoverOptions, recover
from relight3d.relight.relighter import Relighter
from relight3d.shading import points_seen

WIDTH, HEIGHT = 48, 36
SMALL = RecoverOptions(mesh=MeshOptions(target_faces=1200))
# A frame may outshine the brightest photograph under a lamp of equal power: a surface that no photograph shows facing
# its light returns up to 1 / cos(60 deg) = 2 times more when it does. Beyond that, something ran away.
RUNAWAY = 2.0


@dataclass(frozen=True)
class Outcome:
    """One line of the table: what the recovery said of itself, and how far its frames are off."""

    status: str
    error: float | None = None  # relative RMSE against the truth, the well-posed answer's own in `wanted`
    wanted: float | None = None
    condition: float | None = None  # the worst finite one met
    note: str = ""


@dataclass(frozen=True)
class Case:
    group: str
    name: str
    risk: str  # what could break
    check: Callable[[], Outcome]


CASES: list[Case] = []


def case(group: str, name: str, risk: str) -> Callable[[Callable[[], Outcome]], Callable[[], Outcome]]:
    """Put a check on the list."""

    def register(check: Callable[[], Outcome]) -> Callable[[], Outcome]:
        CASES.append(Case(group, name, risk, check))
        return check

    return register


# ------------------------------------------------------------------------------------------- the good case


@cache
def good_capture(num_lights: int = 10, glossy: bool = False, distance: float | None = None) -> Capture:
    """The well-posed desk that the nasty ones are held against; traced bounce light, three held-out lights."""
    return photographed(
        desk_scene(2 * WIDTH, 2 * HEIGHT, glossy=glossy),
        hemisphere_lights(num_lights, distance=distance, seed=1),
        hemisphere_lights(3, 30.0, 75.0, distance=distance, seed=2),
    )


def photographed(
    scene: Scene, lights: Sequence[Sequence[Light]], test_lights: Sequence[Sequence[Light]] = (), num_rays: int = 16
) -> Capture:
    """A synthetic capture of half the scene's picture size: four samples a pixel, as a lens mixes what a pixel covers.

    One sample a pixel would put 8 % of error on outlines and shadow borders, beside which nothing else shows. Pixels
    that see both the mesh and nothing are masked: what lies beyond the mesh is not modelled.
    """
    fine = synthesize(scene, lights, test_lights, num_bounce_rays=num_rays)
    world = World(scene)
    hit = np.zeros(scene.camera.num_pixels, bool)
    hit[points_seen(world.rays, world.mesh, scene.camera).pixel] = True
    share = _halved(hit.reshape(scene.camera.height, scene.camera.width, 1).astype(np.float32))[..., 0]
    camera = scene.camera.resized(scene.camera.width // 2, scene.camera.height // 2)
    photographs = [
        replace(p, camera=camera, pixels=_halved(p.pixels), is_valid=(share == 0) | (share == 1))
        for p in fine.photographs
    ]
    return replace(fine, camera=camera, photographs=tuple(photographs))


def _halved(image: np.ndarray) -> np.ndarray:
    height, width, channels = image.shape
    return image.reshape(height // 2, 2, width // 2, 2, channels).mean(axis=(1, 3))


@cache
def good_model(num_lights: int = 10) -> RelightModel:
    return recover(good_capture(num_lights), SMALL, quiet=True)


@cache
def good_error() -> float:
    return held_out_error(good_model(), good_capture())


# ------------------------------------------------------------------------------------------- what must hold


def checked(capture: Capture, options: RecoverOptions = SMALL, runaway: float = RUNAWAY) -> RelightModel:
    """Recover, and assert what every model must fulfil."""
    model = recover(capture, options, quiet=True)
    assert_sane(model, capture, runaway)
    return model


def assert_sane(model: RelightModel, capture: Capture, runaway: float = RUNAWAY) -> None:
    """Every number finite and in its bounds, every status a known one, every frame finite and not running away."""
    for name, values in numbers_of(model):
        if name.endswith("condition"):
            assert not np.isnan(values).any(), name  # infinite means short of rank
        else:
            assert np.isfinite(values).all(), f"{name} is not finite"
    assert (model.surface_albedo >= 0).all() and (model.pixels.albedo >= 0).all()
    lengths = np.linalg.norm(model.pixels.normal, axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-4)  # float32 and a square root
    for lobes in model.lobes:
        for lobe in lobes:
            assert 1.0 <= lobe.exponent <= 1e4 * (1 + 1e-9) and (lobe.color >= 0).all()
        energy = sum(lobe.color * lobe_energy(lobe.axes, lobe.exponent) for lobe in lobes)
        assert np.max(energy, initial=0.0) <= 1.01  # lobe_energy is exact to 1 %
    for family, health in model.health.items():
        assert set(np.unique(health.status)) <= {int(s) for s in Status}, family
        assert (health.rank >= 0).all(), family
    limit = runaway * brightest(capture)
    for photograph in capture.photographs:
        if photograph.camera.same_as(capture.camera):
            radiance = frame(model, *photograph.lights)
            assert np.isfinite(radiance).all() and (radiance >= 0).all()
            assert radiance.max() <= limit, f"{photograph.name}: {radiance.max():.3g} beyond {limit:.3g}"


def numbers_of(value: object, name: str = "model") -> Iterator[tuple[str, np.ndarray]]:
    """All floating arrays and numbers in nested records, with dotted names."""
    if isinstance(value, np.ndarray | np.floating | float):
        if np.asarray(value).dtype.kind == "f":
            yield name, np.asarray(value)
    elif dataclasses.is_dataclass(value):
        for f in dataclasses.fields(value):
            yield from numbers_of(getattr(value, f.name), f"{name}.{f.name}")
    elif isinstance(value, dict):
        for key, entry in value.items():
            yield from numbers_of(entry, f"{name}.{key}")
    elif isinstance(value, tuple | list):
        for index, entry in enumerate(value):
            yield from numbers_of(entry, f"{name}.{index}")


def brightest(capture: Capture) -> float:
    """The largest finite radiance of any photograph."""
    return max(float(np.max(p.pixels[np.isfinite(p.pixels)], initial=0.0)) for p in capture.photographs)


# ------------------------------------------------------------------------------------------- measures


@lru_cache(maxsize=6)
def relighter_of(model: RelightModel) -> Relighter:
    return Relighter(model)


def frame(model: RelightModel, *lights: Light) -> np.ndarray:
    """Radiance of the captured view."""
    return relighter_of(model).render(list(lights)).radiance.copy()


def relative(got: np.ndarray, wanted: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Root mean square difference over root mean square."""
    mask = np.ones(wanted.shape[:2], bool) if mask is None else mask
    size = np.sqrt(np.mean(np.square(wanted[mask], dtype=np.float64)))
    return float(np.sqrt(np.mean(np.square(got[mask] - wanted[mask], dtype=np.float64))) / max(size, 1e-30))


def error_on(model: RelightModel, photographs: tuple[Photograph, ...]) -> float:
    """Mean relative RMSE over the valid pixels of photographs."""
    errors = [relative(frame(model, *p.lights), p.pixels, p.is_valid) for p in photographs]
    return float(np.mean(errors))


def held_out_error(model: RelightModel, truth: Capture) -> float:
    """Mean relative RMSE over the truth's held-out photographs."""
    return error_on(model, truth.split("test"))


def statuses(model: RelightModel) -> str:
    """The worst status of each family of solves that is not OK, and how many share it."""
    parts = []
    for family, health in model.health.items():
        worst = int(health.status.max(initial=0))
        if worst:
            share = int((health.status == worst).sum())
            parts.append(f"{family} {Status(worst).name.lower()} ({share}/{len(health.status)})")
    return "; ".join(parts) or "ok"


def worst_condition(model: RelightModel) -> float:
    finite = [h.condition[np.isfinite(h.condition)] for h in model.health.values()]
    return float(np.max(np.concatenate(finite), initial=0.0))


def outcome(model: RelightModel, error: float, note: str = "") -> Outcome:
    """The line of a recovery, against the well-posed one's error."""
    return Outcome(statuses(model), error, good_error(), worst_condition(model), note)

"""The order of the stages: from a capture to a RelightModel.

mesh -> points and visibility -> surfaces -> mirrors' edges -> albedo and indirect light, alternating -> rounds of lobes,
detail and mirrors, each followed by the alternation again -> background and residual -> evidence. The rounds are in
rounds.py, the model is put together in assemble.py; the stages themselves do not know each other.
"""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from relight3d.camera import Camera
from relight3d.effects import parse_force
from relight3d.errors import InputError
from relight3d.records import (
    Capture,
    Mirror,
    Observations,
    PatchMesh,
    RelightModel,
    ShadingPoints,
    Surfaces,
    TriangleMesh,
)
from relight3d.recover import visibility
from relight3d.recover.assemble import assemble, summary
from relight3d.recover.bounce import BounceOptions
from relight3d.recover.candidates import accepted_mirrors, find_surfaces, test_mirrors
from relight3d.recover.conventions import ConventionOptions, doubts
from relight3d.recover.detail import DetailOptions
from relight3d.recover.diffuse import DiffuseOptions
from relight3d.recover.indirect import IndirectOptions
from relight3d.recover.leftover import with_residual
from relight3d.recover.mesh import MeshOptions, prepare_mesh
from relight3d.recover.mirror import EdgeTest, MirrorOptions
from relight3d.recover.registration import Misplacement, Placed, RegistrationOptions, misplacement, place
from relight3d.recover.residual import ResidualOptions
from relight3d.recover.rounds.alternation import alternate
from relight3d.recover.rounds.gloss import fit_gloss
from relight3d.recover.rounds.reflections import fit_mirrors, proven_mirrors
from relight3d.recover.rounds.relief import fit_detail
from relight3d.recover.rounds.state import Fitted, Stage, set_stage, start, without_blocked
from relight3d.recover.specular import SpecularOptions
from relight3d.recover.surfaces import SurfaceOptions
from relight3d.recover.texture import TextureOptions
from relight3d.recover.training import Training, read_training
from relight3d.recover.visibility import VisibilityOptions
from relight3d.recover.visible import display_error, visible_step_db
from relight3d.shading import points_seen, ray_scene
from relight3d.tracing import RayScene

log = logging.getLogger("relight3d")
FIRST_FIT = "diffuse and indirect"
PRICES_SHARE = 0.1  # of the stages' seconds: what the price list after them is expected to take


@dataclass(frozen=True)
class RecoverOptions:
    """One Options per stage; the defaults are what `relight3d recover` runs."""

    mesh: MeshOptions = field(default_factory=MeshOptions)
    registration: RegistrationOptions = field(default_factory=RegistrationOptions)
    conventions: ConventionOptions = field(default_factory=ConventionOptions)
    visibility: VisibilityOptions = field(default_factory=VisibilityOptions)
    surfaces: SurfaceOptions = field(default_factory=SurfaceOptions)
    texture: TextureOptions = field(default_factory=TextureOptions)
    mirror: MirrorOptions = field(default_factory=MirrorOptions)
    diffuse: DiffuseOptions = field(default_factory=DiffuseOptions)
    indirect: IndirectOptions = field(default_factory=IndirectOptions)
    bounce: BounceOptions = field(default_factory=BounceOptions)
    specular: SpecularOptions = field(default_factory=SpecularOptions)
    detail: DetailOptions = field(default_factory=DetailOptions)
    residual: ResidualOptions = field(default_factory=ResidualOptions)
    use_labels: bool = True  # the mesh's own surface labels, when it has them
    num_alternations: int = 4  # of albedo and indirect light (trap 3)
    num_rounds: int = 4  # of lobes and detail against the diffuse fits, at most
    force: tuple[str, ...] = ()  # effect=on or off, or effect:surface=off, whatever the evidence says
    prices: bool = True  # measure what cheaper frames lose: budgets and presets choose by it
    budget_s: float | None = None  # begin no round, residual or price list that would not be done after so many seconds
    max_error_db: float | None = 0.5  # no further round after one that lowered the photographs' error by less; None: all

    def __post_init__(self) -> None:
        if not 1 <= self.num_alternations <= 50:
            raise InputError("num_alternations", self.num_alternations, "1 to 50")
        if not 0 <= self.num_rounds <= 10:
            raise InputError("num_rounds", self.num_rounds, "0 to 10")
        parse_force(self.force)
        if self.budget_s is not None and not self.budget_s > 0:
            raise InputError("budget_s", self.budget_s, "a positive number of seconds")
        if self.max_error_db is not None and not self.max_error_db >= 0:
            raise InputError("max_error_db", self.max_error_db, "a number of dB, 0 or more")


def recover(
    capture: Capture,
    options: RecoverOptions | None = None,
    quiet: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> RelightModel:
    """Recover a scene from a capture: mesh, photographs and lights in, a RelightModel out.

    `progress(stage, fraction)` is called as the stages begin and end; `quiet` keeps it and the log silent. Deterministic:
    the same capture and options give the same model whatever the number of threads. Raises InputError for a capture
    that cannot be recovered: no training photograph, a mesh that the camera misses, no valid pixel on it.
    """
    options = options or RecoverOptions()
    clock = Clock(None if quiet else progress, 7 + 3 * options.num_rounds)
    placed = register(capture, options, clock)
    (stage, observed, mirrors, fitted), tests, photographs, doubtful = placed.fit
    fitted, mirrors, lost = _fit(stage, observed, mirrors, fitted, clock)
    observed = without_blocked(observed, fitted)
    with clock.stage("residual"):
        model = assemble(stage, observed, mirrors, fitted, tests, photographs.exposure)
        if options.residual.max_modes > 0 and not clock.has_time(options.budget_s, clock.latest[FIRST_FIT]):
            lost.append("the residual")
            stage = replace(stage, options=replace(options, residual=replace(options.residual, max_modes=0)))
        model = with_residual(stage, observed, model)
    log.info("recover: %s", summary(model))
    notes = (*doubtful, *placed.notes, *model.warnings, *given_up(options.budget_s, lost))
    return replace(model, seconds=clock.seconds, warnings=notes)


class FirstFit(NamedTuple):
    """The first alternation, and the mirrors that it has proven."""

    stage: Stage
    observed: Observations
    mirrors: tuple[Mirror, ...]
    fitted: Fitted


class Begun(NamedTuple):
    """All up to the first fit, for a mesh in its place."""

    first: FirstFit
    tests: list[EdgeTest]
    photographs: Training
    doubts: tuple[str, ...]  # what the photographs speak against in the capture


def register(capture: Capture, options: RecoverOptions, clock: "Clock") -> Placed[Begun]:
    """The first fit, with the mesh where the photographs show it."""

    def fit(mesh: TriangleMesh) -> Begun:
        # What the capture as given was not refused for is no reason to stop at a place that is tried.
        trust = options.conventions if mesh is capture.mesh else ConventionOptions(trust=True)
        return begin(replace(capture, mesh=mesh), options, clock, trust)

    def measure(begun: Begun, scale: float | None) -> Misplacement | None:
        if not clock.has_time(options.budget_s, sum(clock.latest.values())):
            return None
        with clock.stage("registration"):
            return misplacement(*begun.first, options.registration, scale)

    return place(capture.mesh, capture.camera, fit, measure, options.registration)


def begin(
    capture: Capture, options: RecoverOptions, clock: "Clock", conventions: ConventionOptions | None = None
) -> Begun:
    """Mesh, photographs, surfaces, mirrors, visibility and the first alternation."""
    with clock.stage("mesh"):
        mesh = prepare_mesh(capture.mesh, options.mesh)
        rays = ray_scene(mesh)
    with clock.stage("photographs"):
        points = points_seen(rays, mesh, capture.camera)
        photographs = read_training(capture, mesh, points)
        doubtful = doubts(capture, mesh, rays, points, photographs, conventions or options.conventions)
    with clock.stage("surfaces"):
        found = find_surfaces(capture, mesh, rays, points, photographs, options)
    with clock.stage("mirrors"):
        tests = test_mirrors(capture, mesh, rays, points, found, photographs, options)
        mirrors = accepted_mirrors(mesh, points, found, tests, options)
    first = first_fit(options, capture.camera, mesh, rays, points, found, photographs, mirrors, tests, clock)
    return Begun(first, tests, photographs, doubtful)


def first_fit(
    options: RecoverOptions,
    camera: Camera,
    mesh: PatchMesh,
    rays: RayScene,
    points: ShadingPoints,
    found: Surfaces,
    photographs: Training,
    mirrors: tuple[Mirror, ...],
    tests: list[EdgeTest],
    clock: "Clock",
) -> FirstFit:
    """Visibility and the first alternation; once more where something that was taken for a mirror turns out to be none."""
    while True:
        with clock.stage("visibility"):
            observed = visibility.observe(
                rays, mesh, points, camera, photographs.radiance, photographs.is_valid, photographs.lights,
                options.visibility, mirrors, found.surface_of_face, found.surface_of_face[points.face],
            )  # fmt: skip
        stage = set_stage(options, mesh, rays, camera, points, found, mirrors, observed, photographs.exposure)
        with clock.stage(FIRST_FIT):
            fitted = alternate(stage, observed, mirrors, start(stage, observed))
            proven = proven_mirrors(stage, observed, mirrors, fitted, tests)
        if len(proven) == len(mirrors):
            return FirstFit(stage, observed, mirrors, fitted)
        mirrors = proven


def _fit(
    stage: Stage, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted, clock: "Clock"
) -> tuple[Fitted, tuple[Mirror, ...], list[str]]:
    """The rounds after the first fit, as far as time and error ask for them; and what there was no time for."""
    options, error, observed = stage.options, None, without_blocked(observed, fitted)
    if mirrors:  # the lobes hear of what they throw: how much that is must be known before
        with clock.stage("mirrors"):
            mirrors, fitted = fit_mirrors(stage, observed, mirrors, fitted)
    # A round is lobes, detail and an alternation: until one is timed, it is taken for two alternations. The last stage
    # takes about one.
    last_s = clock.latest[FIRST_FIT]
    round_s = 2 * last_s
    for number in range(1, options.num_rounds + 1):
        if not clock.has_time(options.budget_s, round_s + last_s):
            lost = [f"round {k} of lobes and detail" for k in range(number, options.num_rounds + 1)]
            return fitted, mirrors, lost
        if options.max_error_db is not None:
            before, error = error, display_error(stage, observed, mirrors, fitted)
            if before is not None and visible_step_db(before, error) < options.max_error_db:
                log.info("no round %d: the one before gained less than %g dB", number, options.max_error_db)
                clock.skip(3 * (options.num_rounds + 1 - number))
                break
        begin = time.perf_counter()
        with clock.stage(f"lobes, round {number}"):
            fitted = fit_gloss(stage, observed, mirrors, fitted)
        with clock.stage(f"detail, round {number}"):
            fitted = fit_detail(stage, observed, mirrors, fitted)
            mirrors, fitted = fit_mirrors(stage, observed, mirrors, fitted)
        with clock.stage(f"{FIRST_FIT}, round {number}"):
            fitted = alternate(stage, observed, mirrors, fitted)
        round_s = time.perf_counter() - begin
    return fitted, mirrors, []


def given_up(budget_s: float | None, lost: list[str]) -> tuple[str, ...]:
    """The warning that names what a time budget had no room for; none where nothing was lost."""
    return (f"within the budget of {budget_s:g} s there was no time for {', '.join(lost)}",) if lost else ()


class Clock:
    """Keeps each stage's seconds, logs them, and tells how far the whole has come."""

    def __init__(self, progress: Callable[[str, float], None] | None, num_stages: int) -> None:
        self.seconds: dict[str, float] = {}  # of a stage that ran more than once, all together
        self.latest: dict[str, float] = {}  # of its last run
        self._progress, self._num_stages = progress, num_stages
        self._start = time.perf_counter()

    def has_time(self, budget_s: float | None, expected_s: float) -> bool:
        """Whether work of so many seconds would end within the budget; always, without one."""
        return budget_s is None or time.perf_counter() - self._start + expected_s <= budget_s

    def skip(self, num_stages: int) -> None:
        """So many stages will not come."""
        self._num_stages -= num_stages

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time a stage; its start and its end are reported."""
        begin = time.perf_counter()
        if self._progress is not None:
            self._progress(name, len(self.seconds) / self._num_stages)
        yield
        self.latest[name] = time.perf_counter() - begin
        self.seconds[name] = self.seconds.get(name, 0.0) + self.latest[name]
        log.info("%s: %.2f s", name, self.latest[name])
        if self._progress is not None:
            self._progress(name, min(1.0, len(self.seconds) / self._num_stages))

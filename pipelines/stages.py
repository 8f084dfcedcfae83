"""Recovery stage by stage, for the scripts beside this file: each stage's record is kept in a file of its own.

A stage asks those before it, and runs again only when its own inputs, its Options or the library's code have changed.
The order is that of relight3d.recover.run; a test holds the two together.
"""

from dataclasses import replace
from functools import cached_property, wraps
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from relight3d.io.capture import load_capture
from relight3d.io.stage_file import kept
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
from relight3d.recover import assemble, leftover, visibility
from relight3d.recover.candidates import accepted_mirrors, find_surfaces, test_mirrors
from relight3d.recover.mesh import prepare_mesh
from relight3d.recover.mirror import EdgeTest, doubtful
from relight3d.recover.rounds.alternation import alternate
from relight3d.recover.rounds.gloss import fit_gloss
from relight3d.recover.rounds.reflections import fit_mirrors
from relight3d.recover.rounds.relief import fit_detail
from relight3d.recover.rounds.state import Fitted, Stage, set_stage, start, without_blocked
from relight3d.recover.run import Clock, RecoverOptions, first_fit, register
from relight3d.recover.training import Training, read_training
from relight3d.recover.visible import display_error, visible_step_db
from relight3d.shading import points_seen, ray_scene
from relight3d.tracing import RayScene

CapturePath = Annotated[Path, tyro.conf.Positional]
Options = Annotated[RecoverOptions, tyro.conf.arg(name="")]  # their flags have no prefix


def once(method):
    """The method, asked once for each number; a second question gets the same record."""

    @wraps(method)
    def ask(self, number: int):
        answers = self.__dict__.setdefault(f"{method.__name__}()", {})
        if number not in answers:
            answers[number] = method(self, number)
        return answers[number]

    return ask


class Stages:
    """The stages of one capture; their files are in `folder`."""

    def __init__(self, capture: Path, folder: Path, options: RecoverOptions | None = None) -> None:
        self.capture: Capture = load_capture(capture)
        self.folder, self.options = folder, options or RecoverOptions()

    def _kept(self, name: str, make, *made_of: object):
        return kept(self.folder / f"{name}.npz", make, *made_of)

    @cached_property
    def placed(self) -> tuple[TriangleMesh, tuple[str, ...]]:
        """The mesh where the photographs show it, and a line for a person where it was moved."""

        def make() -> tuple[TriangleMesh, tuple[str, ...]]:
            found = register(self.capture, self.options, Clock(None, 1))
            return found.mesh, found.notes

        return self._kept("placed", make, self.capture, self.options)

    @cached_property
    def mesh(self) -> PatchMesh:
        given, options = self.placed[0], self.options.mesh
        return self._kept("mesh", lambda: prepare_mesh(given, options), given, options)

    @cached_property
    def rays(self) -> RayScene:
        return ray_scene(self.mesh)  # a held resource, quicker to make than to read

    @cached_property
    def points(self) -> ShadingPoints:
        camera = self.capture.camera
        return self._kept("points", lambda: points_seen(self.rays, self.mesh, camera), self.mesh, camera)

    @cached_property
    def photographs(self) -> Training:
        return read_training(self.capture, self.mesh, self.points)  # its file would be the photographs over again

    @cached_property
    def surfaces(self) -> Surfaces:
        options = self.options
        return self._kept(
            "surfaces",
            lambda: find_surfaces(self.capture, self.mesh, self.rays, self.points, self.photographs, options),
            *(self.capture.camera, self.mesh, self.points, self.photographs),
            *(options.surfaces, options.visibility, options.use_labels),
        )

    @cached_property
    def mirror_tests(self) -> list[EdgeTest]:
        given = (self.capture, self.mesh, self.rays, self.points, self.surfaces, self.photographs, self.options)
        return self._kept(
            "mirror_tests",
            lambda: test_mirrors(*given),
            *(self.capture.camera, self.mesh, self.points, self.surfaces, self.photographs, self.options.mirror),
        )

    @cached_property
    def mirrors_found(self) -> tuple[Mirror, ...]:
        """The surfaces accepted as mirrors, before their reflectance is known."""
        likely = accepted_mirrors(self.mesh, self.points, self.surfaces, self.mirror_tests, self.options)
        if not doubtful(likely, self.mirror_tests, self.options.mirror):
            return likely
        given = (self.capture.camera, self.mesh, self.rays, self.points, self.surfaces, self.photographs)
        return first_fit(self.options, *given, likely, self.mirror_tests, Clock(None, 1)).mirrors

    @cached_property
    def observed(self) -> Observations:
        photographs, of_face, options = self.photographs, self.surfaces.surface_of_face, self.options.visibility
        return self._kept(
            "visibility",
            lambda: visibility.observe(
                self.rays, self.mesh, self.points, self.capture.camera, photographs.radiance, photographs.is_valid,
                photographs.lights, options, self.mirrors_found, of_face, of_face[self.points.face],
            ),
            *(self.capture.camera, self.mesh, self.points, photographs, options, self.mirrors_found, of_face),
        )  # fmt: skip

    @cached_property
    def common(self) -> Stage:
        """What stays the same through all rounds; it holds the rays, and is made anew."""
        return set_stage(
            self.options, self.mesh, self.rays, self.capture.camera, self.points, self.surfaces, self.mirrors_found,
            self.observed, self.photographs.exposure,
        )  # fmt: skip

    @once
    def diffuse(self, number: int) -> Fitted:
        """Albedo and indirect light: `number` 0 is the first alternation, 1 the one after the first lobes."""
        before = start(self.common, self.observed) if number == 0 else self.detail(number)[0]
        mirrors = self.mirrors_found if number == 0 else self.detail(number)[1]
        observed = self.observed if number == 0 else self.trusted
        options = (self.options.texture, self.options.diffuse, self.options.indirect, self.options.num_alternations)
        return self._round(
            f"diffuse_{number}", lambda: alternate(self.common, observed, mirrors, before), before, options
        )

    @cached_property
    def trusted(self) -> Observations:
        """The photographs without those that the first alternation found spoilt."""
        return without_blocked(self.observed, self.diffuse(0))

    @cached_property
    def reflecting(self) -> tuple[tuple[Mirror, ...], Fitted]:
        """The mirrors with their first reflectances: the lobes hear of what they throw."""
        before = self.diffuse(0)
        if not self.mirrors_found:
            return (), before
        return self._round(
            "mirrors_0",
            lambda: fit_mirrors(self.common, self.trusted, self.mirrors_found, before),
            *(before, self.options.indirect),
        )

    def fitted_before(self, number: int) -> Fitted:
        """What round `number` begins with."""
        return self.reflecting[1] if number == 1 else self.diffuse(number - 1)

    @once
    def lobes(self, number: int) -> Fitted:
        """Which surfaces are glossy and their lobes, in round `number`, counted from 1."""
        before, mirrors = self.fitted_before(number), self.mirrors_before(number)
        return self._round(
            f"lobes_{number}",
            lambda: fit_gloss(self.common, self.trusted, mirrors, before),
            *(before, mirrors, self.options.specular),
        )

    @once
    def detail(self, number: int) -> tuple[Fitted, tuple[Mirror, ...]]:
        """Normals and lobe gains per pixel, then the mirrors' reflectance, which the evidence lists with them."""
        before, mirrors = self.lobes(number), self.mirrors_before(number)

        def make() -> tuple[Fitted, tuple[Mirror, ...]]:
            fitted = fit_detail(self.common, self.trusted, mirrors, before)
            reflecting, fitted = fit_mirrors(self.common, self.trusted, mirrors, fitted)
            return fitted, reflecting

        return self._round(f"detail_{number}", make, before, mirrors, self.options.detail, self.options.indirect)

    def mirrors_before(self, number: int) -> tuple[Mirror, ...]:
        """The mirrors as round `number` finds them."""
        return self.reflecting[0] if number == 1 else self.detail(number - 1)[1]

    @cached_property
    def num_rounds(self) -> int:
        """The rounds that recover would go: until one explains the photographs hardly better than the one before."""
        error, enough_db = None, self.options.max_error_db
        for number in range(1, self.options.num_rounds + 1 if enough_db is not None else 1):
            now = self.mirrors_before(number), self.fitted_before(number)
            before, error = error, display_error(self.common, self.trusted, *now)
            if before is not None and visible_step_db(before, error) < enough_db:
                return number - 1
        return self.options.num_rounds

    @cached_property
    def model(self) -> RelightModel:
        """The last stage: the surroundings in mirrors, and the residual."""
        last = self.num_rounds
        fitted, mirrors = self.fitted_before(last + 1), self.mirrors_before(last + 1)

        def make() -> RelightModel:
            exposure, observed = self.photographs.exposure, without_blocked(self.observed, fitted)
            model = assemble.assemble(self.common, observed, mirrors, fitted, self.mirror_tests, exposure)
            model = leftover.with_residual(self.common, observed, model)
            return replace(model, warnings=(*self.placed[1], *model.warnings))

        return self._round("model", make, fitted, mirrors, self.mirror_tests, self.placed[1], self.options)

    def _round(self, name: str, make, *made_of: object):
        common = (self.mesh, self.capture.camera, self.points, self.surfaces, self.mirrors_found, self.observed)
        shared = (self.photographs.exposure, self.options.indirect, self.options.force)
        return self._kept(name, make, *common, *shared, *made_of)

    def picture(self, values: np.ndarray) -> np.ndarray:
        """Values of the points (rgb or one) as a picture, black where no point is."""
        camera = self.capture.camera
        picture = np.zeros((camera.num_pixels, 3), np.float32)
        picture[self.points.pixel] = values if values.ndim == 2 else values[:, None]
        return picture.reshape(camera.height, camera.width, 3)

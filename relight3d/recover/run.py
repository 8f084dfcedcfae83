"""The order of the stages: from a capture to a RelightModel. The only module that knows it.

points and visibility -> surfaces -> mirrors' edges -> albedo and indirect light, alternating -> gloss and lobes ->
detail -> mirrors' reflectance and background -> residual. Lobes and detail feed back: what they explain is taken out of
the photographs before the next alternation.
"""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from relight3d.errors import InputError
from relight3d.maths.color import exposure_of
from relight3d.records import (
    Background,
    Capture,
    Mirror,
    Observations,
    PatchMesh,
    PixelMap,
    RelightModel,
    ShadingPoints,
    Surfaces,
)
from relight3d.recover import detail, diffuse, indirect, mirror, residual, specular, surfaces, texture, visibility
from relight3d.recover.detail import DetailOptions
from relight3d.recover.diffuse import DiffuseOptions
from relight3d.recover.indirect import IndirectOptions
from relight3d.recover.mesh import MeshOptions, prepare_mesh
from relight3d.recover.mirror import MirrorOptions
from relight3d.recover.residual import ResidualOptions
from relight3d.recover.specular import SpecularOptions
from relight3d.recover.surfaces import SurfaceOptions
from relight3d.recover.texture import TextureOptions
from relight3d.recover.visibility import VisibilityOptions
from relight3d.shading import points_seen, ray_scene
from relight3d.tracing import RayScene

log = logging.getLogger("relight3d")


@dataclass(frozen=True)
class RecoverOptions:
    """One Options per stage; the defaults are what `relight3d recover` runs."""

    mesh: MeshOptions = field(default_factory=MeshOptions)
    visibility: VisibilityOptions = field(default_factory=VisibilityOptions)
    surfaces: SurfaceOptions = field(default_factory=SurfaceOptions)
    texture: TextureOptions = field(default_factory=TextureOptions)
    mirror: MirrorOptions = field(default_factory=MirrorOptions)
    diffuse: DiffuseOptions = field(default_factory=DiffuseOptions)
    indirect: IndirectOptions = field(default_factory=IndirectOptions)
    specular: SpecularOptions = field(default_factory=SpecularOptions)
    detail: DetailOptions = field(default_factory=DetailOptions)
    residual: ResidualOptions = field(default_factory=ResidualOptions)
    use_labels: bool = True  # the mesh's own surface labels, when it has them
    num_alternations: int = 4  # of albedo and indirect light (trap 3)
    num_rounds: int = 2  # of lobes and detail against the diffuse fits

    def __post_init__(self) -> None:
        if not 1 <= self.num_alternations <= 50:
            raise InputError("num_alternations", self.num_alternations, "1 to 50")
        if not 0 <= self.num_rounds <= 10:
            raise InputError("num_rounds", self.num_rounds, "0 to 10")


@dataclass(frozen=True, eq=False)
class Fitted:
    """What the rounds pass on: each is a new one, nothing is edited in place. Arrays per photograph are normalised."""

    albedo: np.ndarray  # point x 3
    surface_albedo: np.ndarray  # surface x 3
    irradiance: np.ndarray  # photo x point x 3: indirect and ambient
    specular: np.ndarray | None  # photo x point x 3: lobes; None while there are none
    normal: np.ndarray  # point x 3
    lobe_gain: np.ndarray  # point
    lobes: tuple
    is_textured: np.ndarray  # surface
    design: object = None
    solution: object = None
    trust: np.ndarray | None = None  # photo x point: robust weights
    albedo_words: tuple[str, ...] = ()
    border: object = None
    joint: object = None


@dataclass(frozen=True, eq=False)
class Scene:
    """What stays the same through all rounds."""

    options: RecoverOptions
    mesh: PatchMesh
    rays: RayScene
    camera: object
    points: ShadingPoints
    surfaces: Surfaces
    surface: np.ndarray  # of each point
    is_matte: np.ndarray  # point: not on a mirror
    binding: object  # vertices or faces hear points
    evaluate: object  # points read vertices or faces
    anchors: np.ndarray
    softening: float
    white: float  # the radiance that shows as white, for normalised photographs


def recover(
    capture: Capture,
    options: RecoverOptions | None = None,
    quiet: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> RelightModel:
    """Recover a scene from a capture: mesh, photographs and lights in, a RelightModel out.

    `progress(stage, fraction)` is called as stages end; without it, and unless `quiet`, a progress bar is shown.
    Raises InputError for a capture that cannot be recovered: no training photograph, a mesh that the camera misses.
    """
    options = options or RecoverOptions()
    clock = _Clock(progress, quiet)
    with clock.stage("mesh"):
        mesh = prepare_mesh(capture.mesh, options.mesh)
        rays = ray_scene(mesh)
    with clock.stage("photographs"):
        points = points_seen(rays, mesh, capture.camera)
        if len(points) == 0:
            raise InputError(
                "mesh_path",
                "a mesh that no pixel sees",
                "a mesh in front of the camera",
                "check transform_matrix (world_from_camera, OpenGL axes) and the mesh's unit",
            )
        radiance, is_valid, lights = _photographs(capture, mesh, points)
        exposure = exposure_of(radiance[is_valid])
    with clock.stage("surfaces"):
        surfaces_ = _surfaces(capture, mesh, rays, points, radiance, is_valid, lights, options)
        surface = surfaces_.surface_of_face[points.face]
    with clock.stage("mirrors"):
        tests = _edge_tests(rays, mesh, points, surface, surfaces_, capture, radiance, options)
        mirrors = tuple(
            mirror.mirror_of(
                mesh, surfaces_.surface_of_face, t.surface, points.take(surface == t.surface), t.score, options.mirror
            )
            for t in tests
            if t.passes(options.mirror)
        )
    with clock.stage("visibility"):
        observed = visibility.observe(
            rays,
            mesh,
            points,
            capture.camera,
            radiance,
            is_valid,
            lights,
            options.visibility,
            mirrors,
            surfaces_.surface_of_face,
        )
        del radiance
    scene = _scene(options, mesh, rays, capture, points, surfaces_, surface, mirrors, observed, exposure)
    fitted = _start(scene, observed)
    with clock.stage("diffuse and indirect"):
        fitted = _alternate(scene, observed, mirrors, fitted)
    for round_ in range(options.num_rounds):
        with clock.stage(f"lobes {round_ + 1}"):
            fitted = _fit_gloss(scene, observed, mirrors, fitted)
        with clock.stage(f"detail {round_ + 1}"):
            fitted, detail_choice = _fit_detail(scene, observed, mirrors, fitted)
        with clock.stage(f"mirrors {round_ + 1}"):
            mirrors = _fit_mirrors(scene, observed, mirrors, fitted, lights)
        with clock.stage(f"diffuse and indirect {round_ + 2}"):
            fitted = _alternate(scene, observed, mirrors, fitted)
    with clock.stage("residual"):
        model = _assemble(scene, observed, mirrors, fitted, capture, exposure, tests)
        model = _with_residual(scene, observed, model, lights)
    log.info("recover: %s", _summary(model))
    return replace(model, seconds=clock.seconds)


class _Clock:
    """Logs each stage's seconds and moves the progress bar."""

    def __init__(self, progress: Callable[[str, float], None] | None, quiet: bool) -> None:
        self.seconds: dict[str, float] = {}
        self._progress, self._quiet, self._bar = progress, quiet, None

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        log.info("%s ...", name)
        yield
        self.seconds[name] = time.perf_counter() - start
        log.info("%s: %.2f s", name, self.seconds[name])
        if self._progress is not None:
            self._progress(name, self.seconds[name])


def _photographs(capture: Capture, mesh: PatchMesh, points: ShadingPoints) -> tuple[np.ndarray, np.ndarray, tuple]:
    """Radiance and validity of the training photographs at the points, and their lights in centred coordinates."""
    from relight3d.io.capture import read_photograph

    training = capture.split("train")
    if not training:
        raise InputError("transforms.json frames", 'none of split "train"', "at least one training photograph")
    radiance = np.empty((len(training), len(points), 3), np.float32)
    is_valid = np.empty((len(training), len(points)), bool)
    for index, photograph in enumerate(training):
        picture, valid = read_photograph(capture, photograph)
        radiance[index] = picture.reshape(-1, 3)[points.pixel]
        is_valid[index] = valid.ravel()[points.pixel] & ~_saturated(picture).ravel()[points.pixel]
    if not is_valid.any():
        raise InputError("photographs", "no valid pixel on the mesh", "a mask that leaves some of the mesh")
    radiance[~is_valid] = 0.0
    lights = tuple(tuple(light.translated(-mesh.center) for light in p.lights) for p in training)
    return radiance, is_valid, lights


def _saturated(picture: np.ndarray) -> np.ndarray:
    """Pixels at a ceiling: a value that no other exceeds and that many share exactly is a sensor's limit."""
    top = picture.max()
    at_top = (picture >= top * 0.9995) & (picture > 0)
    exact = int((picture == top).sum())
    return at_top.any(axis=2) if exact > 3 else np.zeros(picture.shape[:2], bool)


def _surfaces(capture, mesh, rays, points, radiance, is_valid, lights, options) -> Surfaces:
    found = surfaces.surfaces_from_labels(mesh) if options.use_labels else None
    if found is not None:
        return found
    rough = visibility.observe(rays, mesh, points, capture.camera, radiance, is_valid, lights, options.visibility)
    weight = rough.weight * rough.is_safe * ~rough.is_highlight
    guess, information = diffuse.pixel_albedo(rough, rough.radiance, weight, rough.form, None)
    return surfaces.surfaces_from_photographs(mesh, points, capture.camera, guess, information, options.surfaces)


def _edge_tests(rays, mesh, points, surface, surfaces_, capture, radiance, options) -> list:
    tests = [
        mirror.edge_test(
            rays, mesh, points, surface, surfaces_.surface_of_face, capture.camera, radiance, s, options.mirror
        )
        for s in range(surfaces_.num_surfaces)
    ]
    return [t for t in tests if t is not None]


def _scene(options, mesh, rays, capture, points, surfaces_, surface, mirrors, observed, exposure) -> Scene:
    on_mirror = np.isin(surface, [m.surface for m in mirrors])
    site = options.indirect.site
    evaluate = indirect.site_binding(mesh, points, site)
    matte = evaluate.copy().tocsc()
    matte.data *= np.repeat(~on_mirror, np.diff(matte.indptr))
    wide = indirect.spread_over_neighbours(mesh, matte.tocsr(), site, options.indirect.smoothing_px)
    anchors = indirect.light_anchors(observed)
    mean_scale = observed.scale.mean()
    return Scene(
        options,
        mesh,
        rays,
        capture.camera,
        points,
        surfaces_,
        surface,
        ~on_mirror,
        wide,
        evaluate.T.tocsr(),
        anchors,
        0.5 * mesh.radius,
        1.0 / (exposure * mean_scale),
    )


def _start(scene: Scene, observed: Observations) -> Fitted:
    num = len(scene.points)
    return Fitted(
        albedo=np.full((num, 3), 0.5, np.float32),
        surface_albedo=np.full((scene.surfaces.num_surfaces, 3), 0.5),
        irradiance=np.zeros_like(observed.radiance),
        specular=None,
        normal=scene.points.normal,
        lobe_gain=np.ones(num, np.float32),
        lobes=((),) * scene.surfaces.num_surfaces,
        is_textured=np.ones(scene.surfaces.num_surfaces, bool),
    )


def _direct(observed: Observations, mirrors: tuple[Mirror, ...], scene: Scene, fitted: Fitted) -> np.ndarray:
    """Direct irradiance for normalised photographs: the lights' own, with detail, and what mirrors throw."""
    total = observed.form
    if fitted.normal is not scene.points.normal:
        total = total * _cosine_change(observed, scene, fitted.normal)[..., None]
    if observed.thrown is None:
        return total
    throwing = [m for m in mirrors if m.throws_light]
    total = np.broadcast_to(total, observed.radiance.shape).copy()
    for one, form in zip(throwing, observed.thrown, strict=True):
        total += form * one.reflectance.astype(np.float32)
    return total


def _cosine_change(observed: Observations, scene: Scene, normal: np.ndarray) -> np.ndarray:
    """cos with detail over cos without, per photograph and point (several lights: of the strongest)."""
    out = np.ones(observed.is_lit.shape, np.float32)
    for photo, each in enumerate(observed.lights):
        if each:
            light = max(each, key=lambda one: float(one.power.sum()))
            to_light = light.incident(scene.points.position)[0]
            before = np.maximum(np.einsum("pi,pi->p", scene.points.normal, to_light), 0.02)
            after = np.maximum(np.einsum("pi,pi->p", normal, to_light), 0.0)
            out[photo] = np.clip(after / before, 0.0, 20.0)
    return out


def _weights(scene: Scene, observed: Observations, fitted: Fitted) -> np.ndarray:
    """What the diffuse fits believe: safe of borders, off the highlights of glossy surfaces, robustly trusted."""
    weight = observed.weight * observed.is_safe * scene.is_matte
    if observed.thrown is not None and fitted.solution is None:
        weight = weight * ~(observed.thrown.max(axis=(0, 3)) > 0)
    if fitted.specular is None:
        weight = weight * ~observed.is_highlight
    else:
        # Where a lobe shines, its error is as large as it is: the fits hear less of it, smoothly.
        glare = fitted.specular.mean(axis=2) / np.maximum(0.25 * scene.white, 1e-12)
        weight = weight / (1.0 + glare) ** 2
    return weight if fitted.trust is None else weight * fitted.trust


def _alternate(scene: Scene, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> Fitted:
    """Albedo and indirect light in turn (trap 3), the albedo's scale held by the shadow borders (eq. 1)."""
    options, num = scene.options, scene.surfaces.num_surfaces
    direct = _direct(observed, mirrors, scene, fitted)
    target = observed.radiance if fitted.specular is None else observed.radiance - fitted.specular
    weight = _weights(scene, observed, fitted).astype(np.float32)
    pairs = diffuse.border_pairs(observed, scene.points, scene.surface, scene.camera, options.diffuse)
    # An error in the dark shows more than the same error in the light: the indirect light is fitted as it is seen.
    calm = _calm(observed.radiance, scene.white)
    first = fitted.solution is None
    irradiance = None if first else fitted.irradiance
    lit_design, solution, is_textured = fitted.design, fitted.solution, fitted.is_textured
    for step in range(options.num_alternations if first else max(2, options.num_alternations // 2)):
        albedo, information = diffuse.pixel_albedo(observed, target, weight, direct, irradiance)
        mean = _surface_means(albedo, information, scene.surface, num)
        if step == 0:
            measured = texture.difference_measure(
                observed, scene.points, scene.surface, albedo, scene.camera, num, options.texture
            )
            is_textured = np.array([m.is_textured(options.texture) for m in measured])
        relative = np.where(
            is_textured[scene.surface][:, None] & (information > 0), albedo / np.maximum(mean[scene.surface], 1e-6), 1.0
        ).astype(np.float32)
        border = diffuse.border_albedo(pairs, observed, target, direct, relative, scene.surface, num, options.diffuse)
        joint = _joint(scene, observed, target, weight, direct, relative)
        scale, _, words = diffuse.surface_scale(border, joint, mean)
        albedo = (relative * scale[scene.surface]).astype(np.float32)
        sums = indirect.gather(scene.binding, weight * calm, albedo, target, direct)
        if lit_design is None:
            sites = indirect.site_positions(scene.mesh, scene.points, options.indirect.site)
            lit_design = indirect.choose_basis(sums, observed, sites, scene.anchors, scene.softening, options.indirect)
        solution = indirect.solve_sites(sums, lit_design)
        at_sites = np.maximum(indirect.predict(solution, lit_design), 0.0)
        irradiance = np.stack([scene.evaluate @ at_sites[:, photo] for photo in range(at_sites.shape[1])])
        trust = _trust(albedo, direct, irradiance, target, observed)
        weight = (_weights(scene, observed, replace(fitted, trust=trust, solution=solution))).astype(np.float32)
    return replace(
        fitted,
        albedo=albedo,
        surface_albedo=scale,
        irradiance=irradiance,
        is_textured=is_textured,
        design=lit_design,
        solution=solution,
        trust=trust,
        albedo_words=words,
        border=border,
        joint=joint,
    )


def _calm(radiance: np.ndarray, white: float) -> np.ndarray:
    """Squared slope of a logarithm with a floor, at most 1: what a display shows of a difference."""
    gray = np.maximum(radiance.mean(axis=2), 0.0)
    return ((0.05 * white) ** 2 / (gray + np.float32(0.05 * white)) ** 2).astype(np.float32)


def _surface_means(albedo, information, surface, num) -> np.ndarray:
    out = np.zeros((num, 3))
    for s in range(num):
        mine = (surface == s) & (information.min(axis=1) > 0)
        if mine.any():
            out[s] = np.median(albedo[mine], axis=0)
    return out


def _joint(scene, observed, target, weight, direct, relative):
    """Reflectance and indirect light at once, for surfaces that no shadow border crosses."""
    rows = indirect.design(
        "linear" if len(observed.lights) >= 6 else "constant",
        observed,
        np.zeros((1, 3), np.float32),
        scene.anchors,
        scene.softening,
        scene.options.indirect,
    ).rows
    owner = _site_surface(scene)
    return diffuse.joint_albedo(
        scene.binding,
        owner,
        scene.surfaces.num_surfaces,
        relative,
        target,
        weight * observed.is_facing,
        direct,
        rows[0, :, 0],
    )


def _site_surface(scene: Scene) -> np.ndarray:
    site = scene.options.indirect.site
    if site == "pixel":
        return scene.surface
    if site == "face":
        return scene.surfaces.surface_of_face
    owner = np.zeros(len(scene.mesh.vertices), np.int32)
    owner[scene.mesh.faces.ravel()] = np.repeat(scene.surfaces.surface_of_face, 3)
    return owner


def _trust(albedo, direct, irradiance, target, observed) -> np.ndarray:
    """Huber's weights by each point's own scatter and its predicted radiance (trap 13)."""
    from relight3d.maths.least_squares import robust_weights

    predicted = (albedo / np.pi * (direct + irradiance)).mean(axis=2)
    miss = target.mean(axis=2) - predicted
    used = observed.is_safe & (observed.weight > 0)
    own = 1.4826 * np.median(np.where(used, np.abs(miss), 0.0), axis=0)
    scale = np.maximum(own, 0.02 * predicted.mean(axis=0)) + 1e-9
    return robust_weights(miss, scale[None], 2.0).astype(np.float32)


def _fit_gloss(scene: Scene, observed: Observations, mirrors: tuple[Mirror, ...], fitted: Fitted) -> Fitted:
    """Which surfaces are glossy, and their lobes."""
    matte = fitted.albedo / np.float32(np.pi) * (_direct(observed, mirrors, scene, fitted) + fitted.irradiance)
    lobes, specular_ = [], None
    for s in range(scene.surfaces.num_surfaces):
        mine = np.flatnonzero((scene.surface == s) & scene.is_matte)
        samples = _lobe_samples(scene, observed, fitted, matte, mine)
        excess, _ = specular.glossy_excess(samples, scene.white)
        found = ()
        if excess > scene.options.specular.excess_sigmas or fitted.lobes[s]:
            tangent = _tangent_of(scene, s)
            found, _, gain = specular.fit_lobes(samples, scene.white, tangent, scene.options.specular)
            log.info("surface %s: excess %.1f, %d lobes, %.2f dB", scene.surfaces.names[s], excess, len(found), gain)
        lobes.append(found)
        if found:
            specular_ = np.zeros_like(observed.radiance) if specular_ is None else specular_
            _add_specular(scene, observed, fitted, found, mine, specular_)
    return replace(fitted, lobes=tuple(lobes), specular=specular_)


def _add_specular(scene, observed, fitted, lobes, mine, out) -> None:
    points = scene.points
    change = _cosine_change(observed, scene, fitted.normal) if fitted.normal is not points.normal else None
    for photo, each in enumerate(observed.lights):
        for light in each:
            share = (light.power / observed.scale[photo]).astype(np.float32) if len(each) > 1 else np.float32(1)
            to_light = np.asarray(light.incident(points.position[mine])[0], np.float32)
            form = observed.form[photo, mine] * share
            if change is not None:
                form = form * change[photo, mine, None]
            value = specular.specular_radiance(lobes, fitted.normal[mine], to_light, points.to_viewer[mine], form)
            out[photo, mine] += value * fitted.lobe_gain[mine, None]


def _lobe_samples(scene, observed, fitted, matte, mine) -> specular.LobeSamples:
    """Samples of a surface: those near the mirror direction evenly over their angle, and as many from elsewhere."""
    rng = np.random.default_rng(7)
    photo, point = np.nonzero((observed.is_lit & observed.is_safe & (observed.weight > 0))[:, mine])
    point = mine[point]
    single = np.array([len(each) == 1 for each in observed.lights])
    keep = single[photo]
    photo, point = photo[keep], point[keep]
    lights = np.stack([_directions(observed, scene, p, point[photo == p]) for p in []]) if False else None
    to_light = np.zeros((len(photo), 3))
    for p in np.unique(photo):
        here = photo == p
        to_light[here] = observed.lights[p][0].incident(scene.points.position[point[here]])[0]
    normal = fitted.normal[point].astype(np.float64)
    viewer = scene.points.to_viewer[point].astype(np.float64)
    n_l, n_v = (np.einsum("si,si->s", normal, d) for d in (to_light, viewer))
    angle = np.arccos(np.clip(2 * n_l * n_v - np.einsum("si,si->s", to_light, viewer), -1, 1))
    # Inverse density over the angle: the narrow peak is heard as much as the wide rest.
    bins = np.minimum((np.degrees(angle) / 3).astype(int), 39)
    count = np.bincount(bins, minlength=40)
    probability = 1.0 / count[bins] if len(bins) else np.zeros(0)
    num = min(scene.options.specular.num_samples, len(photo))
    chosen = (
        np.sort(rng.choice(len(photo), num, replace=False, p=probability / probability.sum()))
        if num
        else np.zeros(0, int)
    )
    photo, point = photo[chosen], point[chosen]
    change = 1.0
    form = observed.form[photo, point].astype(np.float64) * change
    before = np.maximum(np.einsum("si,si->s", scene.points.normal[point], to_light[chosen]), 0.02)
    form = form * np.clip(np.maximum(n_l[chosen], 0) / before, 0, 20)[:, None]
    return specular.LobeSamples(
        photo,
        normal[chosen],
        to_light[chosen],
        viewer[chosen],
        form,
        observed.radiance[photo, point].astype(np.float64),
        matte[photo, point].astype(np.float64),
        np.ones(len(photo)),
    )


def _tangent_of(scene: Scene, s: int) -> np.ndarray:
    """The surface's longest direction: where brushed metal is usually brushed along, and a fixed frame for the fit."""
    places = scene.points.position[scene.surface == s].astype(np.float64)
    if len(places) < 3:
        return np.array([1.0, 0.0, 0.0])
    _, vectors = np.linalg.eigh(np.cov((places - places.mean(axis=0)).T))
    return vectors[:, -1] * np.sign(vectors[np.argmax(np.abs(vectors[:, -1])), -1])


def _fit_detail(scene, observed, mirrors, fitted) -> tuple[Fitted, dict]:
    """Normals or lobe gains per pixel, surface by surface, when left-out photographs ask for them."""
    options = scene.options.detail
    normal = scene.points.normal.copy()
    gain = np.ones(len(scene.points), np.float32)
    choice: dict[int, tuple[str, float]] = {}
    for s in range(scene.surfaces.num_surfaces):
        mine = np.flatnonzero((scene.surface == s) & scene.is_matte)
        if len(mine) < 30 or options.mode == "off":
            continue
        data = _detail_data(scene, observed, mirrors, fitted, mine)
        mode, damping, gain_db = detail.choose_detail(data, fitted.lobes[s], scene.white, options)
        log.info("surface %s: detail %s damping %.3f %.2f dB", scene.surfaces.names[s], mode, damping, gain_db)
        if gain_db < 0.1:
            continue
        choice[s] = (mode, gain_db)
        if mode == "normal":
            normal[mine] = detail.perturb_normals(data, fitted.lobes[s], scene.white, options, damping)
        elif mode == "lobe":
            gain[mine] = detail.lobe_gains(data, fitted.lobes[s], scene.white, options)
    if not choice:
        normal = scene.points.normal
    fitted = replace(fitted, normal=normal, lobe_gain=gain)
    if fitted.specular is not None:
        specular_ = np.zeros_like(fitted.specular)
        for s, lobes in enumerate(fitted.lobes):
            if lobes:
                mine = np.flatnonzero((scene.surface == s) & scene.is_matte)
                _add_specular(scene, observed, fitted, lobes, mine, specular_)
        fitted = replace(fitted, specular=specular_)
    return fitted, choice


def _detail_data(scene, observed, mirrors, fitted, mine) -> detail.DetailData:
    points = scene.points
    num_photos = len(observed.lights)
    directional = all(light.kind == "directional" for each in observed.lights for light in each)
    to_light = np.zeros((num_photos, 1 if directional else len(mine), 3), np.float32)
    falloff = np.array(observed.form[:, mine])
    for photo, each in enumerate(observed.lights):
        if each:
            light = max(each, key=lambda one: float(one.power.sum()))
            way = light.incident(points.position[mine])[0]
            to_light[photo] = way[:1] if directional else way
            falloff[photo] /= np.maximum(np.einsum("pi,pi->p", points.normal[mine], way), 0.02)[:, None]
    matte = fitted.albedo[mine] / np.float32(np.pi)
    other = matte * fitted.irradiance[:, mine]
    if observed.thrown is not None:
        throwing = [m for m in mirrors if m.throws_light]
        for one, form in zip(throwing, observed.thrown, strict=True):
            other = other + matte * form[:, mine] * one.reflectance.astype(np.float32)
    usable = observed.is_safe[:, mine] & observed.is_lit[:, mine]
    trust = 1.0
    return detail.DetailData(
        to_light,
        falloff,
        observed.radiance[:, mine],
        other.astype(np.float32),
        (observed.weight[:, mine] * usable * trust).astype(np.float32),
        fitted.albedo[mine],
        points.normal[mine],
        points.to_viewer[mine],
    )


def _fit_mirrors(scene, observed, mirrors, fitted, lights) -> tuple[Mirror, ...]:
    """Each mirror's reflectance, from what it shows of the scene recovered so far."""
    if not mirrors:
        return mirrors
    from relight3d.forward import shade_points
    from relight3d.views import ViewOptions, build_view

    unit = tuple(replace(m, reflectance=np.ones(3)) for m in mirrors)
    model = _provisional(scene, observed, unit, fitted)
    view = build_view(scene.rays, model, scene.camera, ViewOptions(edge_samples=1))
    at = np.full(scene.camera.num_pixels, -1)
    at[view.points.pixel] = np.arange(len(view.points))
    out = []
    for one in mirrors:
        mine = np.flatnonzero(scene.surface == one.surface)
        shown_at = at[scene.points.pixel[mine]]
        mine, shown_at = mine[shown_at >= 0], shown_at[shown_at >= 0]
        part = _view_part(view, shown_at)
        shown = np.empty((len(lights), len(mine), 3), np.float32)
        for photo, each in enumerate(lights):
            true = replace(model, mirrors=mirrors)
            s = shade_points(scene.rays, true, part, list(each))
            shown[photo] = (s.direct + s.specular + s.indirect) / observed.scale[photo]
        value, explained = mirror.fit_reflectance(shown, observed.radiance[:, mine], observed.weight[:, mine])
        log.info(
            "mirror %s: reflectance %s explains %.2f", scene.surfaces.names[one.surface], value.round(3), explained
        )
        out.append(replace(one, reflectance=value))
    return tuple(out)


def _view_part(view, index):
    return replace(
        view,
        points=view.points.take(index),
        surface=view.surface[index],
        albedo=view.albedo[index],
        normal=view.normal[index],
        lobe_gain=view.lobe_gain[index],
        throughput=view.throughput[index],
        is_mirrored=view.is_mirrored[index],
        step=view.step[index],
        neighbour=np.full((len(index), 4), -1, np.int32),
        source=view.source[index],
        share=view.share[index],
    )


def _provisional(scene, observed, mirrors, fitted) -> RelightModel:
    """The model so far, without residual and background."""
    found, health = indirect.indirect_of(
        fitted.solution, fitted.design, observed, scene.options.indirect.site, scene.anchors, scene.softening
    )
    found, health = indirect.fill_unseen(scene.mesh, found, health)
    pixels = PixelMap(
        scene.points,
        scene.surface,
        fitted.albedo,
        fitted.normal,
        fitted.lobe_gain,
        observed.is_lit.sum(axis=0).astype(np.int32),
    )
    return RelightModel(
        camera=scene.camera,
        mesh=scene.mesh,
        surfaces=scene.surfaces,
        pixels=pixels,
        surface_albedo=fitted.surface_albedo,
        indirect=found,
        residual=None,
        background=None,
        lobes=fitted.lobes,
        mirrors=mirrors,
        lights=tuple(tuple(one.translated(scene.mesh.center) for one in each) for each in observed.lights),
        exposure=1.0,
        decisions=(),
        health={"indirect": health},
    )


def _assemble(scene, observed, mirrors, fitted, capture, exposure, tests) -> RelightModel:
    kinds = []
    mirror_surfaces = {m.surface for m in mirrors}
    for s in range(scene.surfaces.num_surfaces):
        words = []
        if s in mirror_surfaces:
            words = ["mirror"]
        else:
            words += ["textured"] if fitted.is_textured[s] else []
            words += ["glossy"] if fitted.lobes[s] else []
        kinds.append(tuple(words) or ("diffuse",))
    model = _provisional(scene, observed, mirrors, fitted)
    return replace(model, surfaces=replace(scene.surfaces, kinds=tuple(kinds)), exposure=exposure)


def _with_residual(scene, observed, model, lights) -> RelightModel:
    """The background in mirrors, then the interpolated misfit, each if left-out photographs get better."""
    from relight3d.forward import gather_pixels, shade_points
    from relight3d.shading import reflected
    from relight3d.views import build_view

    view = build_view(scene.rays, model, scene.camera)
    index = np.full(scene.camera.num_pixels, -1)
    index[scene.points.pixel] = np.arange(len(scene.points))
    if len(view.miss_pixel):
        rows = index[np.unique(view.miss_pixel)]
        model = replace(model, background=_background(scene, observed, model, rows[rows >= 0], reflected))
        view = build_view(scene.rays, model, scene.camera)
    counts = np.maximum(np.bincount(view.points.pixel, minlength=scene.camera.num_pixels), 1)
    misfit = np.empty_like(observed.radiance)
    seen = np.zeros(observed.is_lit.shape, np.float32)
    for photo, each in enumerate(lights):
        shaded = shade_points(scene.rays, model, view, list(each))
        picture = sum(gather_pixels(model, view, list(each), shaded))[scene.points.pixel]
        misfit[photo] = observed.radiance[photo] - picture / observed.scale[photo]
        if each:
            share = np.bincount(view.points.pixel, shaded.seen.max(axis=0), scene.camera.num_pixels) / counts
            seen[photo] = share[scene.points.pixel]
    options = scene.options.residual
    bright = ~observed.is_dark
    anchors = np.array([each[0].incident(np.zeros((1, 3)))[0][0] for each in lights if each])
    if options.max_modes == 0 or bright.sum() < 3:
        return model
    known = (observed.weight > 0)[bright]
    misfit, seen = misfit[bright], seen[bright]
    slope = 1.0 / (observed.radiance[bright] ** 2 + (0.1 * scene.white) ** 2)
    states = {"lit": known & (seen > 0.999), "dark": known & (seen < 0.001)}
    chosen = {n: residual.choose_kernel(misfit, k, slope, anchors, options) for n, k in states.items()}
    log.info("residual: %s", chosen)
    if max(c.gain_db for c in chosen.values()) < 0.1:
        return model
    return replace(model, residual=residual.fit_residual(misfit, states, anchors, chosen, options))


def _background(scene, observed, model, rows, reflected) -> Background:
    """Low-order functions of the light, per pixel whose mirror shows the surroundings."""
    found = model.indirect
    lit = indirect.design(
        found.basis, observed, np.zeros((1, 3), np.float32), scene.anchors, scene.softening, scene.options.indirect
    )
    count = len(rows)
    sums = indirect.SiteSums(
        np.repeat(observed.weight[:, rows].T[:, :, None], 3, axis=2).astype(np.float64),
        (observed.weight[:, rows, None] * observed.radiance[:, rows]).transpose(1, 0, 2).astype(np.float64),
    )
    solution = indirect.solve_sites(sums, lit)
    record, _ = indirect.indirect_of(solution, lit, observed, "pixel", scene.anchors, scene.softening)
    points = scene.points.take(rows)
    return Background(points.pixel, reflected(points).astype(np.float32), record.coefficients, record.ambient)


def _summary(model: RelightModel) -> str:
    from relight3d.maths.least_squares import Status

    parts = []
    for name, health in model.health.items():
        counts = ", ".join(
            f"{int((health.status == s).sum())} {s.name.lower()}" for s in Status if (health.status == s).any()
        )
        parts.append(f"{name}: {counts}")
    return "; ".join(parts)

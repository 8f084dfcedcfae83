"""Whether a capture means what it says: lights' frame and order, units, focal length, exposures, linear or sRGB files.

A slip in one of these leaves every file readable and the recovery at work on nonsense. The photographs tell: the shading
that mesh and lights predict is held against them (readings.py), and where it fails, against other readings of the same
capture. What is hopeless as given is an InputError, what is doubtful a line in the model's warnings. Costs one ray
a light at 1500 points; other readings are looked at only where the given one fails. Below four lit photographs no verdict.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from relight3d.errors import InputError
from relight3d.io.images import image_bits, image_format
from relight3d.records import Capture, PatchMesh, ShadingPoints
from relight3d.recover.mesh import MeshOptions, prepare_mesh
from relight3d.recover.readings import MIN_PHOTOS, Reading, Sample, best_reading
from relight3d.recover.response import exposure_gains, matte_light, other_curve
from relight3d.recover.training import Training, read_training, under_same_lights
from relight3d.shading import points_seen, ray_scene
from relight3d.tracing import RayScene

NUM_POINTS = 1500
ENOUGH_PHOTOS = 6  # for an error, and for all that is told from the photographs' differences
# Scores of agreement. Good captures, from matte ones to a room of mirrors, have 0.88 to 0.99.
FAILS = 0.8  # below it other readings are looked at
FITS, FAR_BETTER = 0.8, 0.15  # what another reading must have, and have more
FAR_BETTER_FEW = 0.3  # of fewer than ENOUGH_PHOTOS
HOPELESS = 0.5  # below it a capture that another reading fits is refused
NONSENSE, NONSENSE_QUARTILE = 0.6, 0.8  # below both nothing is explained; the upper quartile spares rooms of mirrors
UNIT_LEFT = 0.3  # of what is missing to an agreement of 1: what another unit may leave
EVENED_LEFT = 0.85  # and what evened photographs may, where exposures are the cause; a shifted camera leaves 0.9
MAX_GAIN_SPREAD = 0.15  # robust, of the logarithms; good captures have 0.00 to 0.07
# Share of points that follow their light better under the other curve. Good captures of 12 photographs and more have 0.0
# to 0.55, of 8 on small pictures up to 0.75; linear 8-bit files are the rarer.
OTHER_CURVE, OTHER_CURVE_8_BIT, CURVE_PHOTOS = 0.8, 0.65, 10
FAR_AWAY, FEW_PIXELS = 15.0, 0.01  # radii from the camera, share of the picture
NEAR = 0.5  # radii within which a camera is amid the mesh
FITS_AROUND = 0.9  # below it a camera amid the mesh is asked whether the mesh has its unit
RARE = (
    'color_space: "linear" for 8-bit files is rare: what a camera or phone develops is "srgb"; develop linear photographs'
    " to 16 bits"
)


@dataclass(frozen=True)
class ConventionOptions:
    """Whether the capture's conventions are held against its photographs."""

    trust: bool = False  # recover even where another reading of the capture explains the photographs far better


def doubts_of(capture: Capture, options: ConventionOptions | None = None) -> tuple[str, ...]:
    """`doubts` of a capture of which nothing is prepared yet."""
    mesh = prepare_mesh(capture.mesh, MeshOptions())
    rays = ray_scene(mesh)
    points = points_seen(rays, mesh, capture.camera)
    return doubts(capture, mesh, rays, points, read_training(capture, mesh, points), options or ConventionOptions())


def doubts(
    capture: Capture,
    mesh: PatchMesh,
    rays: RayScene,
    points: ShadingPoints,
    photographs: Training,
    options: ConventionOptions,
) -> tuple[str, ...]:
    """One line for each thing about the capture that its photographs speak against; most often none.

    Raises InputError where it is hopeless as given and another reading fits, unless that is trusted.
    """
    sample, chosen = _sample(capture, mesh, rays, points, photographs)
    far = _far_mesh(capture, mesh, points)
    form = None if sample is None else sample.forms(sample.lights, sample.points)
    score = None if sample is None or form is None else sample.score(form)
    if sample is None or form is None or score is None:
        return (*far, *_files_line(capture, None))
    found = _other_reading(sample, score, _is_around(capture, mesh, points))
    if found is not None:
        return (_reading_line(sample, form, score, *found, options), *_files_line(capture, None))
    matte, num = matte_light(sample, form), len(sample.lights)
    curve = other_curve(sample, form, matte, capture.color_space) if num >= CURVE_PHOTOS and score >= FAILS else None
    lines = (*far, *_files_line(capture, curve))
    if lines == far and num >= ENOUGH_PHOTOS:  # under a wrong curve exposures would seem to differ
        gains = exposure_gains(sample, form, matte)
        evened = replace(sample, radiance=sample.radiance / np.where(np.isfinite(gains), gains, 1.0)[:, None])
        if 1.0 - (evened.score(form) or 0.0) <= EVENED_LEFT * (1.0 - score):
            exposures = _gain_lines(gains, _names(capture, photographs, chosen))
            if exposures:
                return (*far, *exposures)
    return (*lines, *_nonsense_line(sample, form, score))


def _sample(
    capture: Capture, mesh: PatchMesh, rays: RayScene, points: ShadingPoints, photographs: Training
) -> tuple[Sample | None, list[int]]:
    """Some of the points in the photographs whose lamps have the commonest channel, and which photographs these are."""
    power = np.array([np.sum([x.power for x in each], axis=0) if each else np.zeros(3) for each in photographs.lights])
    channel = int(np.argmax((power > 0).sum(axis=0) + power.sum(axis=0) / max(power.sum(), 1e-30)))
    chosen = [k for k, own in enumerate(power) if own[channel] > 0]
    if len(chosen) < MIN_PHOTOS:
        return None, chosen
    index = np.sort(np.random.default_rng(0).permutation(len(points))[:NUM_POINTS])
    radiance = photographs.radiance[chosen][:, index, channel] / power[chosen, channel][:, None]
    lights = tuple(photographs.lights[k] for k in chosen)
    sample = Sample(
        rays,
        mesh,
        capture.camera,
        points.take(index),
        lights,
        radiance,
        photographs.is_valid[chosen][:, index],
        channel,
    )
    return sample, chosen


def _distance(capture: Capture, mesh: PatchMesh) -> float:
    """From the camera to the mesh's middle, in radii of the mesh."""
    return float(np.linalg.norm(capture.camera.center - mesh.center)) / max(mesh.radius, 1e-30)


def _far_mesh(capture: Capture, mesh: PatchMesh, points: ShadingPoints) -> tuple[str, ...]:
    """A mesh that is a speck far away has most likely another unit than the camera."""
    distance = _distance(capture, mesh)
    if distance < FAR_AWAY or len(points) > FEW_PIXELS * capture.camera.num_pixels:
        return ()
    seen = (
        f"seen by {len(points)} of {capture.camera.num_pixels} pixels, {distance:.0f} times its radius from the camera"
    )
    return (f"mesh_path: a mesh {seen}: check that mesh, camera and lights have one unit",)


def _is_around(capture: Capture, mesh: PatchMesh, points: ShadingPoints) -> bool:
    """Whether the camera is amid the mesh and sees it everywhere: a room, or a mesh of another unit."""
    return _distance(capture, mesh) < NEAR and len(points) == capture.camera.num_pixels


def _other_reading(sample: Sample, score: float, is_around: bool) -> tuple[Reading, float] | None:
    """A reading of the capture that fits far better than the given one, and its score.

    From amid a mesh of another unit one sees a single surface, on which lights without shadows go a long way.
    """
    if score >= (FITS_AROUND if is_around else FAILS):
        return None
    found = best_reading(sample)
    if found is None or found[1] < FITS:
        return None
    if is_around and found[0].field == "mesh_path":
        return found if 1.0 - found[1] <= UNIT_LEFT * (1.0 - score) else None
    margin = FAR_BETTER if len(sample.lights) >= ENOUGH_PHOTOS else FAR_BETTER_FEW
    return found if score < FAILS and found[1] >= score + margin else None


def _agreement(form: np.ndarray, score: float) -> str:
    unlit = float(np.mean((form == 0).all(axis=0)))
    dark = f" ({100 * unlit:.0f} % of the seen points are lit in none)" if unlit > 0.5 else ""
    return f"shading that agrees with the photographs by {score:.2f} of 1{dark}"


def _reading_line(
    sample: Sample, form: np.ndarray, score: float, reading: Reading, better: float, options: ConventionOptions
) -> str:
    """What the photographs speak for; raises InputError where the capture as given is hopeless and not trusted."""
    got, wanted = _agreement(form, score), f"about {better:.2f}, as with {reading.words}"
    is_hopeless = score < HOPELESS or reading.field == "mesh_path"
    if is_hopeless and len(sample.lights) >= ENOUGH_PHOTOS and not options.trust:
        hint = f"{reading.hint} (or recover with --conventions.trust if it is right as it is)"
        raise InputError(f"transforms.json {reading.field}", got, wanted, hint)
    return f"{reading.field}: {got}, but by {wanted}: {reading.hint}"


def _nonsense_line(sample: Sample, form: np.ndarray, score: float) -> tuple[str, ...]:
    """Where no reading fits."""
    agreement = sample.agreement(form)
    if agreement is None or len(agreement) == 0 or len(sample.lights) < ENOUGH_PHOTOS or score >= NONSENSE:
        return ()
    if np.percentile(agreement, 75) >= NONSENSE_QUARTILE:
        return ()
    check = "check the lights' frame and order, the camera and its focal length, and the mesh's unit and place"
    return (f"lights: {_agreement(form, score)}: {check}",)


# ------------------------------------------------------------------------------------------- exposures


def _gain_lines(gains: Float[np.ndarray, " photo"], names: Sequence[str]) -> tuple[str, ...]:
    known = np.flatnonzero(np.isfinite(gains))
    size = np.abs(np.log(gains[known]))  # of the logarithms, whose median is 0
    spread = 1.4826 * float(np.median(size)) if len(known) >= ENOUGH_PHOTOS else 0.0
    if spread <= MAX_GAIN_SPREAD:
        return ()
    farthest = sorted(known[np.argsort(-size)[:8]])
    which = ", ".join(f"{names[k]} x{gains[k]:.2f}" for k in farthest) + (", ..." if len(known) > 8 else "")
    return (
        f"photographs: exposures differ by some {100 * spread:.0f} % ({which}): take all with one exposure, gain and"
        " white balance, or multiply each light's power by its photograph's figure",
    )


def _names(capture: Capture, photographs: Training, chosen: list[int]) -> list[str]:
    training = capture.split("train")
    groups = under_same_lights(tuple(tuple(x for x in p.lights if x.power.any()) for p in training))
    firsts = [training[group[0]].name for group in groups]
    if len(firsts) != len(photographs.lights):
        firsts = [str(k) for k in range(len(photographs.lights))]
    return [firsts[k] for k in chosen]


# ------------------------------------------------------------------------------------------- linear or sRGB


def _files_line(capture: Capture, curve: float | None) -> tuple[str, ...]:
    """What to say of the colour space; `curve` is the share of points that speak for the other one, if known."""
    paths = [p.image_path for p in capture.split("train") if p.image_path is not None]
    if not paths or image_format(paths[0]) == "exr":
        return ()
    is_8_bit = image_bits(paths[0]) <= 8
    told = "" if curve is None else f"{100 * curve:.0f} % of the points follow their light better so"
    if capture.color_space == "srgb":
        wrong = curve is not None and curve > OTHER_CURVE
        return (f'color_space: "srgb", but the photographs look linear: set it to "linear" ({told})',) if wrong else ()
    if curve is not None and curve > (OTHER_CURVE_8_BIT if is_8_bit else OTHER_CURVE):
        return (f'color_space: "linear", but the photographs look sRGB encoded: set it to "srgb" ({told})',)
    if is_8_bit and (curve is None or curve > 0.5):
        return (RARE,)
    return ()

"""Where the mesh sits in the photographs, to a fraction of a pixel: a rigid motion that the photographs ask for.

A scan is laid into the photographs by marks or by hand, and a pixel of error smears every shadow border and crease into
albedo. A photograph that is displaced by d shows prediction(x - d), so what the fits miss is -gradient . d. Most of that
the fits take up themselves: whatever is constant over the lights goes into a pixel's albedo. So of both, miss and
gradient, the part that an albedo explains is taken out of every pixel first (the variable projection of Golub and Pereyra,
1973), and the motion is solved from the rest, over all photographs at once (Lucas and Kanade, 1981, with the mesh's own
depth for the six freedoms of a rigid motion). Indirect light takes up a part as well; so it is done again where the motion
led, with steps lengthened by what the one before left of its own motion.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Generic, TypeVar

import numpy as np
from jaxtyping import Float, Float64
from scipy import ndimage
from scipy.spatial.transform import Rotation

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.maths.blur import blur_known
from relight3d.maths.decibels import gain_db
from relight3d.maths.least_squares import robust_scale, robust_weights
from relight3d.records import Mirror, Observations, TriangleMesh
from relight3d.recover.rounds.alternation import dark_weights
from relight3d.recover.rounds.light import direct_irradiance
from relight3d.recover.rounds.state import Fitted, Stage
from relight3d.recover.visible import display_error

log = logging.getLogger("relight3d")
BLURS_PX = (1.0, 2.0, 4.0)  # of photographs and predictions: a gradient says what a shift of about so much does
REACH = 0.75  # of the blur: a larger shift is asked for again, of pictures that are blurred more
MAX_POINTS = 200_000  # that are listened to, evenly spread: 24 bytes each and photograph
MIN_PHOTOGRAPHS = 4  # under different lights: leaving one out of fewer says nothing of the rest
MIN_PIXELS = 100  # of all photographs
MARGIN_PX = 2  # to pixels that tell nothing
NUM_REWEIGHTS = 5
RIDGE = 1e-3  # of the best known direction: turning and shifting look alike through a long lens
MIN_SHARE = 0.15  # of a motion, that its estimate is taken to show at least


@dataclass(frozen=True)
class RegistrationOptions:
    """When the mesh is moved to where the photographs show it."""

    method: str = "auto"  # off: the mesh stays where the capture has it
    min_shift_px: float = 0.12  # root mean square over the picture: nearer is not worth another fit
    settled_px: float = 0.05  # still to go, of a mesh that is being moved, where the steps end
    min_certainty: float = 4.0  # times its own standard error
    max_shift_px: float = 8.0  # further is not believed: pixels would be compared with strangers
    min_gain_db: float = 0.05  # of the misfit, for a mesh to stay where it was moved
    max_loss_db: float = 0.5  # of all that photographs are missed by, which may hide a small motion
    max_steps: int = 5  # fits, each after another motion

    def __post_init__(self) -> None:
        if self.method not in ("auto", "off"):
            raise InputError("registration.method", self.method, "auto or off")
        if not 0 < self.min_shift_px < self.max_shift_px:
            raise InputError("registration.min_shift_px", self.min_shift_px, "more than 0, less than max_shift_px")
        if not self.max_shift_px <= 100:
            raise InputError("registration.max_shift_px", self.max_shift_px, "100 at most")
        for name in ("settled_px", "min_certainty", "min_gain_db", "max_loss_db"):
            if not 0 <= getattr(self, name) < np.inf:
                raise InputError(f"registration.{name}", getattr(self, name), "a number of 0 or more")
        if not 1 <= self.max_steps <= 50:
            raise InputError("registration.max_steps", self.max_steps, "1 to 50")


@dataclass(frozen=True, eq=False)
class Misplacement:
    """The motion of the mesh that would bring it to where the photographs show it, to first order.

    A turn about the pinhole, then a shift, each along the camera's own axes; units make each of the six move the
    picture by one pixel (root mean square), so `motion` is in pixels, and `overlap` tells what two of them have in
    common: the picture moves by sqrt(motion . overlap . motion).
    """

    motion: Float64[np.ndarray, "6"]  # turns about x, y, z, then shifts
    covariance: Float64[np.ndarray, "6 6"]  # by leaving out photographs
    overlap: Float64[np.ndarray, "6 6"]
    unit: Float64[np.ndarray, "6"]  # radians and lengths of one pixel
    misfit: float  # mean square of what is missed, as far as no albedo explains it; relative radiance
    scale: float  # the size of an ordinary miss
    missed: float = 0.0  # of the photographs, by all that is fitted, as a display shows it

    @property
    def shift_px(self) -> float:
        return self.length(self.motion)

    @property
    def error_px(self) -> float:
        """The standard error of the shift, over the picture."""
        return float(np.sqrt(max(np.sum(self.covariance * self.overlap), 0.0)))

    def is_clear(self, options: RegistrationOptions) -> bool:
        """Whether it is large enough to matter, and no chance."""
        return self.shift_px >= max(options.min_shift_px, options.min_certainty * self.error_px)

    def length(self, motion: Float64[np.ndarray, "6"]) -> float:
        return float(np.sqrt(max(motion @ self.overlap @ motion, 0.0)))

    def share_shown(self, before: "Misplacement", moved: Float64[np.ndarray, "6"]) -> float:
        """Of a motion, the share that its estimate shows: what a move of known size took off the estimate."""
        size = moved @ self.overlap @ moved
        share = (before.motion - self.motion) @ self.overlap @ moved / max(size, 1e-12)
        return float(np.clip(share, MIN_SHARE, 1.0))


Fit = TypeVar("Fit")


@dataclass(frozen=True, eq=False)
class Placed(Generic[Fit]):
    """The mesh where it was left, what was fitted there, and a line for a person where it was moved."""

    mesh: TriangleMesh
    fit: Fit
    notes: tuple[str, ...] = ()


def place(
    mesh: TriangleMesh,
    camera: Camera,
    fit: Callable[[TriangleMesh], Fit],
    measure: Callable[[Fit, float | None], Misplacement | None],
    options: RegistrationOptions,
) -> Placed[Fit]:
    """Fit, see where the photographs show the mesh, move it there and fit again, while that helps.

    `measure` is told the ordinary size of the first fit's misses, so that misfits compare. The best of the fits is
    kept, the first unless another misses by less what no albedo explains (`min_gain_db`), and not by more all in all.
    """
    first = fit(mesh)
    found = None if options.method == "off" else measure(first, None)
    if found is None or not found.is_clear(options):
        return Placed(mesh, first)
    if found.shift_px > options.max_shift_px:
        far = f"the photographs seem to show the mesh {found.shift_px:.0f} pixels off its place: check its pose"
        return Placed(mesh, first, (far,))
    begin, best, least = found, Placed(mesh, first), found.misfit
    here, share, to_go = mesh, 1.0, [found.shift_px]
    for _ in range(options.max_steps):
        step = found.motion / share
        step *= min(1.0, options.max_shift_px / max(found.length(step), 1e-12))
        here = moved(here, camera, step * found.unit)
        fitted = fit(here)
        now = measure(fitted, begin.scale)
        if now is None:
            break
        to_go.append(now.shift_px)
        # What no albedo explains is not all that is missed: at a wrong place albedos take up more, and badly.
        is_worse = gain_db(begin.missed, now.missed) < -options.max_loss_db
        if now.misfit < least and not is_worse:
            best, least = Placed(here, fitted), now.misfit
        share, is_nearer = now.share_shown(found, step), now.shift_px < found.shift_px
        found = now
        if found.shift_px < options.settled_px * share or not is_nearer:
            break
    gain = gain_db(begin.misfit, least)
    log.info("registration: %s px to go; %.2f dB", ", ".join(f"{px:.2f}" for px in to_go), gain)
    if best.mesh is mesh or gain < options.min_gain_db:
        return Placed(mesh, first)
    right, down = _mean_shift(mesh, best.mesh, camera)
    note = (
        f"the photographs show the mesh {right:+.2f} pixels right and {down:+.2f} down of its place: it was moved there"
    )
    return replace(best, notes=(note,))


def moved(mesh: TriangleMesh, camera: Camera, motion: Float64[np.ndarray, "6"]) -> TriangleMesh:
    """The mesh turned about the camera's pinhole (radians) and then shifted, both along the camera's axes."""
    axes = camera.world_from_camera[:3, :3]
    turn = Rotation.from_rotvec(axes @ motion[:3]).as_matrix()
    vertices = (mesh.vertices - camera.center) @ turn.T + camera.center + axes @ motion[3:]
    normals = mesh.vertex_normals
    return replace(
        mesh, vertices=vertices, vertex_normals=None if normals is None else (normals @ turn.T).astype(np.float32)
    )


def _mean_shift(before: TriangleMesh, after: TriangleMesh, camera: Camera) -> Float64[np.ndarray, "2"]:
    """Pixels right and down that the vertices in the picture moved by, on average."""
    (old, depth), (new, _) = camera.project(before.vertices), camera.project(after.vertices)
    inside = (depth > 0) & (old >= 0).all(axis=1) & (old <= (camera.width, camera.height)).all(axis=1)
    return (new - old)[inside].mean(axis=0) if inside.any() else np.zeros(2)


# ------------------------------------------------------------------------------------------- the estimate


def misplacement(
    stage: Stage,
    observed: Observations,
    mirrors: tuple[Mirror, ...],
    fitted: Fitted,
    options: RegistrationOptions,
    scale: float | None = None,
) -> Misplacement | None:
    """How the photographs ask for the mesh to be moved; None where they cannot tell.

    `scale` is the ordinary size of a miss, of another fit, with which this one is to be compared.
    """
    if min(stage.camera.height, stage.camera.width) <= 2 * MARGIN_PX:
        return None
    chosen = np.linspace(0, len(stage.points) - 1, min(len(stage.points), MAX_POINTS)).astype(np.int64)
    fields, unit = _fields(stage, chosen)
    light = direct_irradiance(stage, observed, mirrors, fitted) + fitted.irradiance
    sharp = found = _estimate(_told(stage, observed, fitted, light, chosen, BLURS_PX[0]), fields, unit, scale)
    for blur, coarser in pairwise(BLURS_PX):
        if found is None or sharp is None or found.shift_px <= REACH * blur:
            break
        again = _estimate(_told(stage, observed, fitted, light, chosen, coarser), fields, unit, None)
        if again is None or again.shift_px < found.shift_px or not again.is_clear(options):
            break
        found = replace(again, misfit=sharp.misfit, scale=sharp.scale)
    return found and replace(found, missed=display_error(stage, observed, mirrors, fitted))


def _estimate(
    told: "_Told", fields: np.ndarray, unit: Float64[np.ndarray, "6"], scale: float | None
) -> Misplacement | None:
    """The motion by robust least squares, and how sure it is."""
    used = told.weight > 0
    if used.any(axis=1).sum() < MIN_PHOTOGRAPHS or used.sum() < MIN_PIXELS:
        return None
    root = np.sqrt(told.weight)
    size = scale or float(robust_scale(root[used] * told.miss[used]))
    misfit = told.weight * told.miss**2 * robust_weights(root * told.miss, size)
    motion, gram, moment = np.zeros(6), np.zeros(0), np.zeros(0)
    for _ in range(NUM_REWEIGHTS):
        left = told.miss - (told.right * (fields[:, 0] @ motion) + told.down * (fields[:, 1] @ motion))
        gram, moment = _normal_equations(told, told.weight * robust_weights(root * left, size), fields)
        motion = _solve(gram.sum(axis=0), moment.sum(axis=0))
    if not np.isfinite(motion).all() or not motion.any():
        return None
    return Misplacement(
        motion=motion,
        covariance=_covariance(gram, moment),
        overlap=np.einsum("pai,paj->ij", fields, fields) / len(fields),
        unit=unit,
        misfit=float(misfit[used].mean(dtype=np.float64)),
        scale=size,
    )


@dataclass(frozen=True, eq=False)
class _Told:
    """What photographs say, less what an albedo explains; photographs first, then points. Gray radiance, in whites."""

    miss: np.ndarray
    right: np.ndarray  # by how much it would change if the mesh moved a pixel right
    down: np.ndarray
    weight: np.ndarray


def _told(
    stage: Stage, observed: Observations, fitted: Fitted, light: np.ndarray, chosen: np.ndarray, blur_px: float
) -> _Told:
    """The chosen points' part of the photographs; `light` is the irradiance of all points in each."""
    calm, white = dark_weights(stage, observed), np.float32(stage.white)
    shape, pixel = (stage.camera.height, stage.camera.width), stage.points.pixel
    layers = np.zeros((4, len(observed.lights), len(chosen)), np.float32)
    weight = np.zeros(layers.shape[1:], np.float32)
    can_tell = (observed.weight > 0) & stage.is_matte & ~observed.is_highlight
    can_tell[list(fitted.blocked)] = False
    for photo in np.flatnonzero(can_tell.any(axis=1)):
        predicted = fitted.albedo / np.float32(np.pi) * light[photo]
        values = np.stack([observed.radiance[photo].mean(axis=1) / white, predicted.mean(axis=1) / white], axis=1)
        taken, shown = blur_known(values, can_tell[photo], pixel, shape, blur_px)
        down, right = np.gradient(shown)
        for layer, picture in zip(layers, (taken - shown, -right, -down, shown)):
            layer[photo] = picture.ravel()[pixel[chosen]]
        mask = np.zeros(shape, bool)
        mask.ravel()[pixel] = can_tell[photo]
        is_whole = ndimage.binary_erosion(mask, iterations=MARGIN_PX)
        weight[photo] = (is_whole.ravel()[pixel] * calm[photo])[chosen]
    predicted = layers[3]
    power = np.maximum((weight * predicted**2).sum(axis=0), np.finfo(np.float32).tiny)
    for layer in layers[:3]:
        layer -= predicted * ((weight * predicted * layer).sum(axis=0) / power)
    return _Told(layers[0], layers[1], layers[2], weight)


def _fields(stage: Stage, chosen: np.ndarray) -> tuple[Float[np.ndarray, "point 2 6"], Float64[np.ndarray, "6"]]:
    """Where each motion takes a point's image (right, down), in pixels, each one pixel over the picture; and its unit."""
    camera, axes = stage.camera, stage.camera.world_from_camera[:3, :3]
    place = stage.points.position[chosen].astype(np.float64) + stage.mesh.center
    arm = place - camera.center
    small = 1e-4 * np.array([1.0] * 3 + [float(np.linalg.norm(arm, axis=1).mean())] * 3)
    ways = [np.cross(axes[:, k], arm) for k in range(3)] + [np.broadcast_to(axes[:, k], arm.shape) for k in range(3)]
    here = camera.project(place)[0]
    fields = np.stack([(camera.project(place + s * way)[0] - here) / s for s, way in zip(small, ways)], axis=2)
    fields[~np.isfinite(fields).all(axis=(1, 2))] = 0.0
    size = np.sqrt((fields**2).sum(axis=1).mean(axis=0))
    unit = 1.0 / np.maximum(size, 1e-12)
    return fields * unit, unit


def _normal_equations(
    told: _Told, weight: np.ndarray, fields: np.ndarray
) -> tuple[Float64[np.ndarray, "photo 6 6"], Float64[np.ndarray, "photo 6"]]:
    gram, moment = [], []
    for right, down, miss, trust in zip(told.right, told.down, told.miss, weight):
        rows = right[:, None] * fields[:, 0] + down[:, None] * fields[:, 1]
        weighted = rows * trust[:, None]
        gram.append(weighted.T @ rows)
        moment.append(weighted.T @ miss.astype(np.float64))
    return np.array(gram), np.array(moment)


def _solve(gram: np.ndarray, moment: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(gram)
    if not values[-1] > 0:
        return np.zeros(len(moment))
    return vectors @ ((vectors.T @ moment) / (np.maximum(values, 0.0) + RIDGE * values[-1]))


def _covariance(gram: np.ndarray, moment: np.ndarray) -> Float64[np.ndarray, "6 6"]:
    """Of the motion, by leaving each photograph out in turn (the jackknife)."""
    whole, num = (gram.sum(axis=0), moment.sum(axis=0)), len(gram)
    without = np.array([_solve(whole[0] - g, whole[1] - m) for g, m in zip(gram, moment)])
    away = without - without.mean(axis=0)
    return (num - 1) / num * away.T @ away

"""What a user has without a mesh: interpolation of each pixel over the lights, fitted on the same photographs.

PTM (Malzbender et al. 2001), hemispherical harmonics of order 2 and 3 (Gautron et al. 2004, as RTI viewers use them)
and radial basis functions with a linear kernel. All are linear in the photographs, so one small operator, from a
light's features to a weight for each photograph, serves every pixel. All work on linear radiance divided by the
irradiance that faces the light at the scene's centre: lights of other colours and distances cost nothing, and several
lights add up. None can change the viewpoint.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32
from scipy.spatial.distance import cdist

from relight3d.errors import InputError
from relight3d.lights import Light
from relight3d.maths.least_squares import Solution, solve_rows
from relight3d.maths.light_basis import evaluate_basis

BASELINES = ("ptm", "hsh2", "hsh3", "rbf")

# Plain least squares runs wild where the lights leave a gap: 16 harmonics on 24 lights lose 1.2 dB by it on a glazed
# figure (DiLiGenT reading). The fits get this share of their mean column power as a ridge, so that we beat them at
# their best. With 0 they are minimum-norm.
RIDGE = 2.5e-3

FAINT = 1e-3  # a channel that gets less than this share of the median irradiance has nothing to say


@dataclass(frozen=True, eq=False)
class LightFrame:
    """How lights are written as coordinates: directions from `centre`, with the mean light as z, and nearness.

    The mean direction makes the hemisphere independent of the world's axes. Nearness is `reference_distance` over the
    distance: 0 for a light at infinity.
    """

    centre: Float64[np.ndarray, "3"]
    axes: Float64[np.ndarray, "3 3"]
    reference_distance: float

    def describe(
        self, lights: Sequence[Light]
    ) -> tuple[Float64[np.ndarray, "light 4"], Float64[np.ndarray, "light 3"]]:
        """Coordinates (direction, nearness) of each light, and its facing irradiance at the centre."""
        to_light, irradiance, distance = _at(self.centre, lights)
        return np.column_stack([to_light @ self.axes.T, self.reference_distance / distance]), irradiance


@dataclass(frozen=True, eq=False)
class Baseline:
    """A fitted interpolator: its operator, and the photographs that its predictions are weighted sums of."""

    name: str
    frame: LightFrame
    anchors: Float64[np.ndarray, "light 4"]  # the photographed lights, the centres of radial functions
    operator: Float64[np.ndarray, "3 feature photograph"]
    photographs: Float32[np.ndarray, "3 photograph pixel"]  # a unit of irradiance each, ambient taken off
    ambient: Float32[np.ndarray, "pixel 3"]
    rank: Int32[np.ndarray, "3"]
    condition: Float64[np.ndarray, "3"]

    def weights(self, lights: Sequence[Light]) -> Float64[np.ndarray, "3 photograph"]:
        """The weight of each photograph, per channel, in the picture under these lights."""
        coordinates, irradiance = self.frame.describe(lights)
        features = _features(self.name, coordinates, self.anchors)
        return np.einsum("lc,lf,cfp->cp", irradiance, features, self.operator)

    def predict(self, lights: Sequence[Light]) -> Float32[np.ndarray, "pixel 3"]:
        """Radiance of each pixel under lights that add up, with the ambient light once; never below 0."""
        if not lights:
            return self.ambient.copy()
        lit = (self.weights(lights).astype(np.float32)[:, None, :] @ self.photographs)[:, 0].T
        return np.maximum(self.ambient + lit, 0.0)


def fit_baseline(
    name: str,
    lights: Sequence[Sequence[Light]],
    radiance: Float[np.ndarray, "photograph pixel 3"],
    centre: Float[np.ndarray, "3"],
    ridge: float = RIDGE,
) -> Baseline:
    """Fit one of BASELINES to photographs under `lights`; a photograph without any is the ambient light.

    NaN marks a pixel that a photograph does not have: it takes the mean of the others. Fewer lights than functions
    leave a weak answer that is finite (`rank` and `condition` tell). Raises InputError for an unknown name, counts
    that differ, or no photograph with a light.
    """
    if name not in BASELINES:
        raise InputError("baseline", name, f"one of {', '.join(BASELINES)}")
    if len(lights) != len(radiance):
        raise InputError("photographs", f"{len(radiance)} for {len(lights)} sets of lights", "one each")
    is_lit = np.array([len(each) > 0 for each in lights], bool)
    if not is_lit.any():
        raise InputError("photographs", "none with a light", "at least one to interpolate from")
    ambient = _mean_of_known(radiance[~is_lit]) if not is_lit.all() else np.zeros(radiance.shape[1:], np.float32)

    every_light = [light for each in lights for light in each]
    frame = _light_frame(every_light, centre)
    anchors, irradiance = frame.describe(every_light)
    photograph_of_light = np.repeat(np.arange(is_lit.sum()), [len(each) for each in lights if len(each)])
    share, total = _shares(irradiance, photograph_of_light)
    unit = (radiance[is_lit] - ambient) / np.where(total > 0, total, np.inf)[:, None, :].astype(np.float32)
    if np.isnan(unit).any():
        unit = np.where(np.isnan(unit), _mean_of_known(unit), unit)

    solution = _solve(name, share, anchors, ridge)
    return Baseline(
        name=name,
        frame=frame,
        anchors=anchors,
        operator=solution.value,
        photographs=np.ascontiguousarray(np.moveaxis(unit, -1, 0), np.float32),
        ambient=ambient,
        rank=solution.rank,
        condition=solution.condition,
    )


def _features(
    name: str, coordinates: Float[np.ndarray, "light 4"], anchors: Float[np.ndarray, "anchor 4"]
) -> Float64[np.ndarray, "light feature"]:
    x, y, z = coordinates[:, :3].T
    if name == "ptm":
        return np.stack([x * x, y * y, x * y, x, y, np.ones_like(x)], axis=1)
    if name == "rbf":
        return np.column_stack([-cdist(coordinates, anchors), np.ones_like(x)])
    return evaluate_basis(name, coordinates[:, :3])


def _solve(
    name: str,
    share: Float[np.ndarray, "3 photograph light"],
    anchors: Float[np.ndarray, "light 4"],
    ridge: float,
) -> Solution:
    """The operator from a light's features to the photographs' weights, per channel."""
    num = share.shape[1]
    rows = share @ _features(name, anchors, anchors)
    if name != "rbf":
        return solve_rows(rows, np.broadcast_to(np.eye(num), (3, num, num)), damping=ridge)
    # A photograph under several lights is their weighted sum, so the kernel is summed over both of its sides. The last
    # row asks that weights sum to 0 beside the constant (Wendland 2004, generalised interpolation).
    constant = rows[:, :, -1:]
    kernel = rows[:, :, :-1] @ share.swapaxes(1, 2)
    system = np.block([[kernel, constant], [constant.swapaxes(1, 2), np.zeros((3, 1, 1))]])
    solution = solve_rows(system, np.broadcast_to(np.eye(num + 1, num), (3, num + 1, num)))
    to_lights = share.swapaxes(1, 2) @ solution.value[:, :-1]
    operator = np.concatenate([to_lights, solution.value[:, -1:]], axis=1)
    return Solution(operator, solution.status, solution.rank, solution.condition, solution.residual)


def _shares(
    irradiance: Float[np.ndarray, "light 3"], photograph_of_light: np.ndarray
) -> tuple[Float64[np.ndarray, "3 photograph light"], Float64[np.ndarray, "photograph 3"]]:
    """Each light's share of its photograph's irradiance, and that total; both 0 where a channel is too faint."""
    num = photograph_of_light[-1] + 1
    belongs = photograph_of_light == np.arange(num)[:, None]
    total = belongs @ irradiance
    positive = total[total > 0]
    total = np.where(total > FAINT * (np.median(positive) if positive.size else 1.0), total, 0.0)
    inverse = np.where(total > 0, 1.0 / np.where(total > 0, total, 1.0), 0.0)
    return np.einsum("pl,lc,pc->cpl", belongs, irradiance, inverse), total


def _light_frame(lights: Sequence[Light], centre: np.ndarray) -> LightFrame:
    centre = np.asarray(centre, np.float64)
    to_light, _, distance = _at(centre, lights)
    mean = to_light.mean(axis=0)
    # Lights all around have no mean direction: the world's z then.
    z = mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 1e-3 else np.array([0.0, 0.0, 1.0])
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    near = distance[[light.kind != "directional" for light in lights]]
    return LightFrame(centre, np.stack([x, np.cross(z, x), z]), float(np.median(near)) if near.size else 0.0)


def _at(
    point: np.ndarray, lights: Sequence[Light]
) -> tuple[Float64[np.ndarray, "light 3"], Float64[np.ndarray, "light 3"], Float64[np.ndarray, " light"]]:
    """Direction, facing irradiance and distance of each light at one point."""
    incident = [light.incident(point[None]) for light in lights]
    to_light, irradiance, distance = (np.concatenate(part) for part in zip(*incident))
    return to_light, irradiance, np.maximum(distance, np.finfo(np.float64).tiny)


def _mean_of_known(radiance: Float[np.ndarray, "photograph pixel 3"]) -> Float32[np.ndarray, "pixel 3"]:
    """The mean over photographs without their NaN; 0 where there is nothing else."""
    is_known = ~np.isnan(radiance)
    total = np.where(is_known, radiance, 0.0).sum(axis=0)
    return (total / np.maximum(is_known.sum(axis=0), 1)).astype(np.float32)

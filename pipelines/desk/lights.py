"""Where the lamps stand: well spread, none blocked by the surroundings, the held-out ones between the others."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, Delaunay

from desk.settings import LampSettings, Wall

TINTS = ((1.0, 1.0, 1.0), (1.0, 0.93, 0.82), (0.86, 0.95, 1.08))  # most frames are white, some warm, some cool
CLEARANCE_M = 0.6
RED, WHITE = (1.0, 0.12, 0.10), (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Lamp:
    """One place of a lamp of unit power. `to_light` is a unit vector; a point lamp stands at `position`."""

    name: str
    to_light: tuple[float, float, float]
    position: tuple[float, float, float] | None = None


def blocked(points: np.ndarray, lamps: np.ndarray, is_point: bool, walls: tuple[Wall, ...]) -> np.ndarray:
    """For each lamp (a direction, or a position): whether any point's ray to it meets a wall."""
    is_blocked = np.zeros(len(lamps), bool)
    for i, lamp in enumerate(lamps):
        rays = lamp - points if is_point else np.broadcast_to(lamp, points.shape)
        for wall in walls:
            half_u, half_v = np.array(wall.half_u, float), np.array(wall.half_v, float)
            normal = np.cross(half_u, half_v)
            along = rays @ normal
            distance = ((np.array(wall.middle) - points) @ normal) / np.where(np.abs(along) < 1e-12, 1e-12, along)
            offset = points + distance[:, None] * rays - wall.middle
            inside = (np.abs(offset @ half_u) <= half_u @ half_u) & (np.abs(offset @ half_v) <= half_v @ half_v)
            is_blocked[i] |= bool((inside & (distance > 0) & (distance < (1.0 if is_point else np.inf))).any())
    return is_blocked


def near_walls(places: np.ndarray, walls: tuple[Wall, ...]) -> np.ndarray:
    """Whether each point lamp is close enough to a wall to make a burning spot of noise there."""
    is_near = np.zeros(len(places), bool)
    for wall in walls:
        halves = np.array([wall.half_u, wall.half_v], float)
        along = (places - wall.middle) @ halves.T / (halves**2).sum(1)
        nearest = np.clip(along, -1, 1) @ halves + wall.middle
        is_near |= np.linalg.norm(places - nearest, axis=1) < CLEARANCE_M
    return is_near


def cap_directions(count: int, lowest_deg: float, highest_deg: float) -> np.ndarray:
    """Fibonacci spiral between two elevations."""
    index = np.arange(count) + 0.5
    low, high = np.sin(np.deg2rad([lowest_deg, highest_deg]))
    z = high + (low - high) * index / count
    azimuth = index * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], 1)


def farthest(candidates: np.ndarray, taken: list[np.ndarray], count: int) -> list[np.ndarray]:
    """`count` more directions, each the candidate farthest from all taken so far."""
    chosen: list[np.ndarray] = []
    for _ in range(count):
        nearest = np.max(candidates @ np.array(taken + chosen).T, axis=1)
        chosen.append(candidates[int(nearest.argmin())])
    return chosen


def place_lamps(
    settings: LampSettings, walls: tuple[Wall, ...], mesh_points: np.ndarray
) -> tuple[list[Lamp], list[Lamp]]:
    """Training and held-out lamps. Raises ValueError where a wall blocks one of them."""
    is_point = settings.kind == "point"
    rng = np.random.default_rng(settings.seed)
    directions = cap_directions(1500, settings.lowest_deg, settings.highest_deg)
    distances = rng.uniform(*settings.distances_m, len(directions)) if is_point else np.ones(len(directions))
    sparse = np.union1d(ConvexHull(mesh_points).vertices, np.arange(0, len(mesh_points), 16))
    is_free = ~blocked(mesh_points[sparse], directions * distances[:, None], is_point, walls)
    if is_point:
        is_free &= ~near_walls(directions * distances[:, None], walls)
    directions, distances = directions[is_free], distances[is_free]
    first = directions[rng.integers(len(directions))]
    train = [first, *farthest(directions, [first], settings.num_train - 1)]
    hull = Delaunay(np.array(train)[:, :2])
    is_between = (hull.find_simplex(directions[:, :2]) >= 0) & (
        directions[:, 2] > np.sin(np.deg2rad(settings.lowest_test_deg))
    )
    test = farthest(directions[is_between], train, settings.num_test)
    rng.shuffle(train)

    def lamp(name: str, direction: np.ndarray) -> Lamp:
        place = direction * distances[int((directions @ direction).argmax())]
        return Lamp(name, tuple(map(float, direction)), tuple(map(float, place)) if is_point else None)

    lamps = (
        [lamp(f"train_{i:02d}", d) for i, d in enumerate(train)],
        [lamp(f"test_{i:02d}", d) for i, d in enumerate(test)],
    )
    places = np.array([one.position or one.to_light for group in lamps for one in group])
    if blocked(mesh_points, places, is_point, walls).any():
        raise ValueError("walls: expected none to block a lamp, got one that does: lower it, or move it away")
    return lamps


def powers(settings: LampSettings, count: int) -> np.ndarray:
    """Irradiance at the target of each frame's lamp (count, 3): 0.7 to 1.3 of the strength, some tinted."""
    rng = np.random.default_rng(settings.seed + 1)
    factor = rng.permutation(np.linspace(0.7, 1.3, count))
    tint = np.array(TINTS)[np.where(np.arange(count) % 5 == 3, 1 + np.arange(count) % 2, 0)]
    return np.round(settings.strength * factor[:, None] * tint, 3)

"""The pinhole camera and its conventions, written once.

Arrays are row-column; the centre of pixel (row 0, column 0) lies at image coordinates (0.5, 0.5), x right and
y down. The camera's own axes are OpenGL's: x right, y up, looking down -z. Distances are in the capture's unit.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from relight3d.errors import InputError


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole with the radial-tangential distortion of OpenCV (k1 k2 p1 p2), as transforms.json gives it.

    Raises InputError where a size or focal length is not positive or the pose is not a rigid 4x4 matrix.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    world_from_camera: np.ndarray = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise InputError("camera w, h", f"{self.width} x {self.height}", "at least 1 x 1 pixel")
        if not (np.isfinite([self.fx, self.fy]).all() and self.fx > 0 and self.fy > 0):
            raise InputError("camera fl_x, fl_y", (self.fx, self.fy), "positive focal lengths in pixels")
        pose = np.asarray(self.world_from_camera, dtype=np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise InputError("transform_matrix", pose.tolist(), "a finite 4x4 matrix, world_from_camera")
        rotation = pose[:3, :3]
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) or np.linalg.det(rotation) < 0:
            raise InputError(
                "transform_matrix",
                rotation.tolist(),
                "a rotation in its upper left 3x3",
                "divide the scale out, and do not mirror the axes",
            )
        object.__setattr__(self, "world_from_camera", pose)

    @staticmethod
    def from_transform(matrix: np.ndarray, like: "Camera") -> "Camera":
        """A camera at another pose (world_from_camera, 4x4) with the intrinsics of `like`."""
        return replace(like, world_from_camera=np.asarray(matrix, dtype=np.float64))

    @property
    def center(self) -> Float[np.ndarray, "3"]:
        """The pinhole, in world coordinates."""
        return self.world_from_camera[:3, 3]

    @property
    def num_pixels(self) -> int:
        return self.width * self.height

    def same_as(self, other: "Camera") -> bool:
        """Whether both see the same picture: equal intrinsics and, to 1e-9, equal pose."""
        return self.intrinsics == other.intrinsics and np.allclose(
            self.world_from_camera, other.world_from_camera, rtol=1e-9, atol=1e-9
        )

    @property
    def intrinsics(self) -> tuple[float | int, ...]:
        return (self.width, self.height, self.fx, self.fy, self.cx, self.cy, self.k1, self.k2, self.p1, self.p2)

    def resized(self, width: int, height: int) -> "Camera":
        """The same view with another number of pixels."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self, width=width, height=height, fx=self.fx * sx, fy=self.fy * sy, cx=self.cx * sx, cy=self.cy * sy
        )

    def translated(self, offset: np.ndarray) -> "Camera":
        """The camera moved by `offset` in world coordinates."""
        pose = self.world_from_camera.copy()
        pose[:3, 3] += offset
        return replace(self, world_from_camera=pose)

    def directions(self, image_points: Float[np.ndarray, "pixel 2"]) -> Float[np.ndarray, "pixel 3"]:
        """Unit viewing directions in world coordinates through image points (x, y), distortion undone."""
        distorted = (np.asarray(image_points, np.float64) - (self.cx, self.cy)) / (self.fx, self.fy)
        ideal = self._undistort(distorted)
        in_camera = np.stack([ideal[:, 0], -ideal[:, 1], -np.ones(len(ideal))], axis=1)
        in_camera /= np.linalg.norm(in_camera, axis=1, keepdims=True)
        return in_camera @ self.world_from_camera[:3, :3].T

    def pixel_directions(self) -> Float[np.ndarray, "pixel 3"]:
        """Unit viewing directions through every pixel centre, row by row."""
        rows, columns = np.mgrid[0 : self.height, 0 : self.width]
        return self.directions(np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5], axis=1))

    def project(
        self, points: Float[np.ndarray, "point 3"]
    ) -> tuple[Float[np.ndarray, "point 2"], Float[np.ndarray, " point"]]:
        """Image points (x, y) and depths along the axis; behind the camera the depth is <= 0 and the point NaN."""
        in_camera = (np.asarray(points, np.float64) - self.center) @ self.world_from_camera[:3, :3]
        depth = -in_camera[:, 2]
        safe = np.where(depth > 0, depth, np.nan)
        ideal = np.stack([in_camera[:, 0] / safe, -in_camera[:, 1] / safe], axis=1)
        return self._distort(ideal) * (self.fx, self.fy) + (self.cx, self.cy), depth

    def _distort(self, ideal: np.ndarray) -> np.ndarray:
        if not any((self.k1, self.k2, self.p1, self.p2)):
            return ideal
        x, y = ideal[:, 0], ideal[:, 1]
        r2 = x * x + y * y
        radial = 1.0 + r2 * (self.k1 + r2 * self.k2)
        return np.stack(
            [
                x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x),
                y * radial + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y,
            ],
            axis=1,
        )

    def _undistort(self, distorted: np.ndarray) -> np.ndarray:
        # Fixed-point iteration: it contracts for every lens mild enough to be called a pinhole.
        ideal = distorted
        for _ in range(20 if any((self.k1, self.k2, self.p1, self.p2)) else 0):
            ideal = distorted - (self._distort(ideal) - ideal)
        return ideal

    def to_dict(self) -> dict:
        """The keys of transforms.json."""
        return {
            "w": self.width,
            "h": self.height,
            "fl_x": self.fx,
            "fl_y": self.fy,
            "cx": self.cx,
            "cy": self.cy,
            "k1": self.k1,
            "k2": self.k2,
            "p1": self.p1,
            "p2": self.p2,
            "transform_matrix": self.world_from_camera.tolist(),
        }


def look_at(
    eye: np.ndarray, target: np.ndarray, up: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 1.0)
) -> Float[np.ndarray, "4 4"]:
    """world_from_camera of a camera at `eye` that looks at `target`."""
    eye = np.asarray(eye, np.float64)
    backward = eye - np.asarray(target, np.float64)
    backward /= np.linalg.norm(backward)
    right = np.cross(np.asarray(up, np.float64), backward)
    if np.linalg.norm(right) < 1e-9:  # looking along `up`: any right will do
        right = np.cross(np.eye(3)[int(np.argmin(np.abs(backward)))], backward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, np.cross(backward, right), backward, eye
    return pose

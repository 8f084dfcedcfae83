"""Open3D's offscreen renderer in a process of its own: requests come by standard input, pictures leave by output.

One renderer lives at a time: two abort the process, and so does one that is used from another thread. Messages are an
8-byte length and an .npz of arrays, which can carry nothing but numbers and text.
"""

import io
import os
import struct
import sys
from typing import Any

import numpy as np

_LENGTH = struct.Struct("<q")


def send(pipe: io.BufferedIOBase, **arrays: np.ndarray | float | str) -> None:
    """Write one message."""
    stream = io.BytesIO()
    contents: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items()}
    np.savez(stream, **contents)
    data = stream.getvalue()
    pipe.write(_LENGTH.pack(len(data)))
    pipe.write(data)
    pipe.flush()


def receive(pipe: io.BufferedIOBase) -> dict[str, np.ndarray] | None:
    """Read one message; None where the other side is gone."""
    head = pipe.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack(head)
    data = pipe.read(length)
    if len(data) < length:
        return None
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


class _Stage:
    """The one renderer, kept while requests are of one kind and size."""

    def __init__(self) -> None:
        self._renderer: Any = None
        self._made_for: tuple[str, int, int] | None = None

    def renderer(self, kind: str, width: int, height: int) -> Any:
        """A renderer for pictures of a kind: one that showed a background image cannot show a plain colour again."""
        if self._made_for != (kind, width, height):
            from relight3d.display.open3d_modules import rendering

            self._renderer = None  # the old one goes before the new one comes
            self._renderer = rendering.OffscreenRenderer(width, height)
            # Post-processing maps tones and dithers; smoothing would mix pixels.
            self._renderer.scene.view.set_post_processing(False)
            self._renderer.scene.view.set_antialiasing(False, False)
            self._renderer.scene.view.set_sample_count(1)
            self._made_for = (kind, width, height)
        return self._renderer

    def picture(self, pixels: np.ndarray) -> np.ndarray:
        """A picture shown as the background of an empty scene: every value comes back as it went in."""
        from relight3d.display.open3d_modules import open3d

        renderer = self.renderer("picture", pixels.shape[1], pixels.shape[0])
        # Float images are not decoded from sRGB, 8-bit ones would be.
        image = open3d.geometry.Image(np.ascontiguousarray(pixels.astype(np.float32) / 255))
        renderer.scene.set_background([0, 0, 0, 1], image)
        return np.asarray(renderer.render_to_image()).copy()

    def mesh(self, request: dict[str, np.ndarray]) -> np.ndarray:
        """A mesh with display-encoded vertex colours, from a camera given by K and camera_from_world (OpenCV axes)."""
        from relight3d.display.open3d_modules import open3d, rendering

        width, height = (int(n) for n in request["size"])
        renderer = self.renderer("mesh", width, height)
        mesh = open3d.t.geometry.TriangleMesh(
            open3d.core.Tensor(np.ascontiguousarray(request["vertices"], np.float32)),
            open3d.core.Tensor(np.ascontiguousarray(request["faces"], np.int32)),
        )
        mesh.vertex.colors = open3d.core.Tensor(np.ascontiguousarray(request["colors"], np.float32))
        mesh.vertex.normals = open3d.core.Tensor(np.ascontiguousarray(request["normals"], np.float32))
        material = rendering.MaterialRecord()
        material.shader = "defaultUnlit"
        scene = renderer.scene
        scene.clear_geometry()
        scene.set_background([0, 0, 0, 1])
        scene.add_geometry("mesh", mesh, material)
        pose, (near, far) = request["pose"], request["clip"]
        rotation = pose[:3, :3]
        eye = -rotation.T @ pose[:3, 3]
        # setup_camera would fix the near plane at 0.1, which hides a small object.
        scene.camera.set_projection(request["intrinsics"], near, far, float(width), float(height))
        look = [(eye + rotation[2]), eye, -rotation[1]]
        scene.camera.look_at(*(vector.astype(np.float32) for vector in look))
        return np.asarray(renderer.render_to_image()).copy()

    def answer(self, request: dict[str, np.ndarray]) -> np.ndarray:
        return self.picture(request["pixels"]) if "pixels" in request else self.mesh(request)


def main() -> None:
    """Answer requests until the input ends. An exception is answered with its text and ends the process."""
    # Open3D's engine greets on standard output: the pipe moves out of its way.
    pipe = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    requests: Any = sys.stdin.buffer
    stage = _Stage()
    while (request := receive(requests)) is not None:
        try:
            send(pipe, picture=stage.answer(request))
        except Exception as error:
            send(pipe, error=f"{type(error).__name__}: {error}")
            raise

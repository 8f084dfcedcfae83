"""One size of mesh and picture: every contender, in turns."""

import json
import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from bench.enlarge import with_faces
from bench.measure import Took, bare_embreex, frames, interpolators, open3d_rays, side_by_side
from relight3d.camera import Camera
from relight3d.records import RelightModel
from relight3d.tracing import RayScene

# What the frames are held to (issue 7): name, over which sum of others, at most.
TARGETS = (
    ("frame, exact", ("bare occlusion",), {400: 1.3, 1920: 1.25}),
    ("frame, balanced", ("bare occlusion",), {}),
    ("frame, fast", ("bare occlusion",), {}),
    ("frame, baked", ("bare occlusion",), {400: 0.35}),
    ("frame, new colour", ("bare occlusion",), {}),
    ("frame, three lights", ("frame, exact",), {400: 2.8}),
    ("new viewpoint", ("bare first hit", "bare occlusion"), {400: 1.35}),
    ("new viewpoint, no outlines", ("bare first hit", "bare occlusion"), {400: 1.35}),
    ("frame, exact", ("Mitsuba direct, 1 samples",), {400: 0.4}),
    ("frame, balanced", ("Mitsuba direct, 1 samples",), {400: 0.4}),
)


def run_case(model: RelightModel, num_faces: int, size: tuple[int, int], rounds: int, mitsuba: Path | None) -> dict:
    """Medians in milliseconds, ratios, and the targets they are held to."""
    model = with_faces(model, num_faces)
    camera = model.camera if size == (model.camera.width, model.camera.height) else model.camera.resized(*size)
    exact, contenders = frames(model, camera)
    single_rays = {"RELIGHT3D_SINGLE_RAYS": "1"}
    os.environ.update(single_rays)
    bare = RayScene(model.mesh.centered_vertices, model.mesh.faces)
    del os.environ["RELIGHT3D_SINGLE_RAYS"]
    contenders = {**bare_embreex(bare, exact), **open3d_rays(exact), **contenders}
    took = side_by_side(contenders, rounds)
    if camera is model.camera:
        # By themselves: their matrix products leave threads awake that would slow whoever comes next.
        took |= side_by_side(interpolators(model), rounds)
    if mitsuba is not None:
        took |= mitsuba_times(mitsuba, model, camera, rounds)
    medians = {name: float(np.median(times.wall)) for name, times in took.items()}
    return {
        "faces": len(model.mesh.faces),
        "size": f"{size[0]}x{size[1]}",
        "rounds": rounds,
        "buffers_mb": exact._engine.num_bytes / 1e6,
        "milliseconds": medians,
        "spread": {name: float(np.subtract(*np.percentile(t.wall, [75, 25]))) for name, t in took.items()},
        "ratios": ratios(took, size[0]),
    }


def ratios(took: dict[str, Took], width: int) -> dict[str, dict]:
    """Each target's ratio: the median over rounds of times taken in the same round, by the clock and by the cores."""
    out = {}
    for name, others, limits in TARGETS:
        if not {name, *others} <= set(took):  # Mitsuba is not everywhere
            continue
        entry: dict = {"at most": limits.get(width)}
        for clock in Took._fields:
            over = np.sum([getattr(took[other], clock) for other in others], axis=0)
            entry[clock] = float(np.median(getattr(took[name], clock) / over))
        out[f"{name} / ({' + '.join(others)})"] = entry
    return out


def mitsuba_times(python: Path, model: RelightModel, camera: Camera, rounds: int) -> dict[str, Took]:
    """Mitsuba in its own process and environment, on the same mesh, camera and one light."""
    flip = np.diag([-1.0, 1.0, -1.0, 1.0])  # Mitsuba looks down +z with x to the left
    pose = camera.translated(-model.mesh.center).world_from_camera @ flip
    fov = float(np.rad2deg(2 * np.arctan(camera.width / (2 * camera.fx))))
    settings = {"w": camera.width, "h": camera.height, "fov": fov, "to_world": pose.tolist()}
    settings |= {"direction": [-0.3, -0.2, -0.9], "llvm": "DRJIT_LIBLLVM_PATH" in os.environ}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.ply"
        write_ply(path, model.mesh.centered_vertices, model.mesh.faces)
        script = Path(__file__).with_name("mitsuba_frame.py")
        command = [str(python), str(script), str(path), json.dumps(settings), str(rounds)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    times = json.loads(done.stdout.strip().splitlines()[-1])
    return {name: Took(**clocks) for name, clocks in times.items()}


def write_ply(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """A binary PLY of positions and triangles."""
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.zeros(len(faces), [("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, faces
    path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + rows.tobytes())

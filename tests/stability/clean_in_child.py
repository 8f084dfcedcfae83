"""Read and prepare meshes, one JSON line each; run as a process, so that a crash of native code is seen as one."""

import json
import os
import sys

import numpy as np

from relight3d.errors import MeshError
from relight3d.io.meshes import read_mesh
from relight3d.maths import topology
from relight3d.records import PatchMesh, TriangleMesh
from relight3d.recover.mesh import MeshOptions, prepare_mesh


def check_invariants(given: TriangleMesh, patch: PatchMesh, target_faces: int) -> None:
    """What every later stage may rely on, whatever the mesh was."""
    vertices, faces, normals = patch.vertices, patch.faces, patch.vertex_normals
    welded = patch.welded_vertex[faces]
    assert np.isfinite(vertices).all() and np.isfinite(normals).all()
    assert len(faces) >= max(target_faces, 1) and len(faces) == patch.report.num_faces_out
    assert np.array_equal(np.unique(faces), np.arange(len(vertices))), "an index out of range, or an unused vertex"
    assert patch.face_areas.min() > 0 and np.isfinite(patch.face_normals).all()
    assert np.abs(np.linalg.norm(patch.face_normals, axis=1) - 1).max() < 1e-5
    assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-5
    assert not topology.repeated_faces(welded).any(), "a duplicate face"
    assert (welded != np.roll(welded, -1, axis=1)).all(), "a face with two corners at one place"
    assert topology.shared_edges(faces).num_non_manifold == 0
    # One number a place, and one place a number.
    order = np.argsort(patch.welded_vertex, kind="stable")
    same = np.diff(patch.welded_vertex[order]) == 0
    assert (vertices[order][1:][same] == vertices[order][:-1][same]).all()
    assert len(np.unique(vertices, axis=0)) == patch.welded_vertex.max() + 1
    assert patch.parent_face.min() >= 0 and patch.parent_face.max() < len(given.faces)
    if given.object_id is not None:
        assert np.array_equal(patch.object_id, given.object_id[patch.parent_face])
    if given.corner_uvs is not None:
        assert np.isfinite(patch.corner_uvs).all()


def main(paths: list[str]) -> None:
    """Print `{"path", "faces"}` or `{"path", "error"}` for each file, as soon as it is known."""
    for path in paths:
        line: dict[str, object] = {"path": path}
        if path == "abort":
            os.abort()  # so that the test can be seen to notice
        try:
            mesh = read_mesh(path)
            for target_faces in (0, 20_000):
                patch = prepare_mesh(mesh, MeshOptions(target_faces=target_faces))
                check_invariants(mesh, patch, target_faces)
                line |= {"faces": len(patch.faces), "changes": dict(patch.report.changes)}
        except MeshError as error:
            line["error"] = str(error)
        sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])

"""From a mesh as a file gives it to one that can be traced and fitted: clean, coherent, evenly subdivided."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64, Int32

from relight3d.errors import InputError
from relight3d.io.meshes import check_mesh
from relight3d.maths.topology import first_equal_row, repeated_faces, shared_edges, split_non_manifold
from relight3d.records import MeshReport, PatchMesh, TriangleMesh
from relight3d.recover.mesh_filters import Subdivision, subdivide
from relight3d.recover.mesh_normals import ShadingVertices, shading_vertices
from relight3d.recover.mesh_repair import CleanFaces, clean_faces


@dataclass(frozen=True)
class MeshOptions:
    """How a mesh is cleaned and how finely it is cut. Fractions are of the bounding box's diagonal."""

    target_faces: int = 30_000  # split the longest edges until there are at least so many faces; 0: only clean
    max_edge_length: float | None = None  # in the mesh's unit; edges longer than this are split as well
    max_faces: int = 4_000_000  # where max_edge_length would give more, splitting stops and the report says so
    crease_angle_deg: float = 40.0  # a mesh without normals is smooth over edges that bend less
    weld_tolerance: float = 1e-6  # fraction; vertices nearer than this are at one place
    min_face_height: float = 1e-7  # fraction; lower faces are dropped: rays in float32 could not hit them
    orient: bool = True  # turn faces over so that neighbours agree
    unfold: bool = True  # unfold single faces that lie back on a neighbour

    def __post_init__(self) -> None:
        edge = self.max_edge_length
        checks = (
            ("max_faces", self.max_faces, 1 <= self.max_faces <= 100_000_000, "1 to 100,000,000"),
            ("target_faces", self.target_faces, 0 <= self.target_faces <= self.max_faces, "0 to max_faces"),
            ("max_edge_length", edge, edge is None or 0 < edge < np.inf, "a positive length"),
            ("crease_angle_deg", self.crease_angle_deg, 0 <= self.crease_angle_deg <= 180, "0 to 180 degrees"),
            ("weld_tolerance", self.weld_tolerance, 0 <= self.weld_tolerance < 0.01, "0 to 0.01 of the diagonal"),
            ("min_face_height", self.min_face_height, 0 <= self.min_face_height < 0.01, "0 to 0.01 of the diagonal"),
        )
        for name, got, is_good, expected in checks:
            if not is_good:
                raise InputError(f"MeshOptions.{name}", got, expected)


def prepare_mesh(mesh: TriangleMesh, options: MeshOptions = MeshOptions()) -> PatchMesh:
    """Clean, orient, shade and subdivide a mesh. Deterministic; labels and parents are exact.

    A good mesh keeps its vertices, faces and normals as they are, apart from subdivision; `report` counts what was
    done to another. Raises MeshError for indices out of range, or where no face with an area is left.
    """
    check_mesh(mesh, "mesh")
    clean = clean_faces(mesh, options.weld_tolerance, options.min_face_height, options.orient, options.unfold)
    shading = shading_vertices(clean, mesh, np.deg2rad(options.crease_angle_deg))
    faces, source = split_non_manifold(shading.faces)
    vertex_in, normals = shading.vertex_in[source], shading.normals[source]
    max_edge = np.inf if options.max_edge_length is None else options.max_edge_length / clean.scale
    plan = _SplitPlan(options.target_faces, max_edge, options.max_faces)
    points = clean.points[vertex_in]
    cut = _cut(points, faces, plan, options.target_faces)
    longest = clean.scale * _longest_edge(points, faces), clean.scale * _longest_edge(cut.points, cut.faces)
    report = _report(mesh, clean, shading, longest, len(cut.faces), options)
    return _assemble(mesh, clean, vertex_in, normals[faces], cut, report)


@dataclass(frozen=True)
class _SplitPlan:
    """Which edges a pass splits: the longest, so that faces even out, and no more than are wanted. Unit frame."""

    target_faces: int
    max_edge: float
    max_faces: int

    def next_threshold(self, lengths: Float64[np.ndarray, "face 3"]) -> float | None:
        """Edges longer than this are halved; None: enough."""
        num_faces, longest = len(lengths), float(lengths.max())
        # Halving all above half the longest: after it nothing is much longer than half. Equal edges, told apart by
        # rounding only, must share one fate, hence the margins.
        half = longest / 2 * (1 + 1e-6)
        missing = self.target_faces - num_faces  # each side that is split adds a face
        if missing > 0:
            ranked = lengths.ravel()
            wanted = np.partition(ranked, ranked.size - missing)[ranked.size - missing] if missing <= ranked.size else 0
            return max(half, float(wanted) * (1 - 1e-6))
        if longest <= self.max_edge:
            return None
        threshold = max(half, self.max_edge)
        return threshold if num_faces + int((lengths > threshold).sum()) <= self.max_faces else None


def _cut(
    points: Float64[np.ndarray, "vertex 3"], faces: Int32[np.ndarray, "face 3"], plan: _SplitPlan, wanted: int
) -> Subdivision:
    """Subdivide, and again finer where too few parts are left: of parts that coincide only the first stays.

    They do where faces of different size overlap in one plane.
    """
    cut = subdivide(points, faces, plan.next_threshold)
    is_repeated = repeated_faces(first_equal_row(cut.points)[cut.faces])
    num_kept = int((~is_repeated).sum())
    if num_kept < wanted:
        finer = replace(plan, target_faces=int(1.1 * plan.target_faces * wanted / num_kept))
        return _cut(points, faces, finer, wanted)
    if not is_repeated.any():
        return cut
    used, kept = np.unique(cut.faces[~is_repeated], return_inverse=True)
    return Subdivision(
        points=cut.points[used],
        given=cut.given[used],
        faces=kept.reshape(-1, 3).astype(np.int32),
        row=cut.row[~is_repeated],
        weights=cut.weights[~is_repeated],
    )


def _assemble(
    mesh: TriangleMesh,
    clean: CleanFaces,
    vertex_in: Int32[np.ndarray, " vertex"],
    corner_normals: Float64[np.ndarray, "row 3 3"],
    cut: Subdivision,
    report: MeshReport,
) -> PatchMesh:
    vertices = clean.center + clean.scale * cut.points
    is_given = cut.given >= 0
    vertices[is_given] = mesh.vertices[clean.twin[vertex_in[cut.given[is_given]]]]  # the input's own digits
    face_normals = _unit(np.cross(*np.moveaxis(np.diff(cut.points[cut.faces], axis=1), 1, 0)))
    blended = np.einsum("fck,fkd->fcd", cut.weights, corner_normals[cut.row])
    normals = np.empty_like(vertices)
    normals[cut.faces] = _unit(blended, face_normals[:, None, :])
    corner, parent = clean.corner[cut.row], clean.parent[cut.row]
    uvs = None
    if mesh.corner_uvs is not None:
        given = mesh.corner_uvs.reshape(-1, 2)[corner].astype(np.float64)
        uvs = np.einsum("fck,fkd->fcd", cut.weights, given).astype(np.float32)
    # Halves of equal edges are equal to the last bit, so the places of new vertices can be compared exactly.
    _, welded = np.unique(first_equal_row(cut.points), return_inverse=True)
    return PatchMesh(
        vertices=vertices,
        faces=cut.faces,
        vertex_normals=normals.astype(np.float32),
        welded_vertex=welded.astype(np.int32),
        parent_face=parent,
        object_id=None if mesh.object_id is None else mesh.object_id[parent],
        corner_uvs=uvs,
        object_names=mesh.object_names,
        report=report,
    )


def _unit(vectors: Float[np.ndarray, "*axes 3"], otherwise: Float[np.ndarray, "*#axes 3"] | None = None) -> np.ndarray:
    """At unit length; where a vector has cancelled, the other one."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit = vectors / np.where(length > 0, length, 1.0)
    near_unit = np.where(np.abs(length - 1) < 1e-6, vectors, unit)  # corners that were there keep their bits
    return near_unit if otherwise is None else np.where(length > 1e-3, near_unit, otherwise)


def _longest_edge(points: Float64[np.ndarray, "vertex 3"], faces: Int32[np.ndarray, "face 3"]) -> float:
    place = points[faces]
    return float(np.linalg.norm(np.roll(place, -1, axis=1) - place, axis=2).max())


def _report(
    mesh: TriangleMesh,
    clean: CleanFaces,
    shading: ShadingVertices,
    longest: tuple[float, float],
    num_faces: int,
    options: MeshOptions,
) -> MeshReport:
    """What was done. `longest` is the longest edge before and after subdivision."""
    edges = shared_edges(clean.faces)
    counts = {
        **clean.changes,
        "edges_non_manifold": edges.num_non_manifold,
        "vertices_merged": shading.num_merged,
        "vertices_unused": shading.num_unused,
        "normals_repaired": shading.num_bad_normals,
        "faces_added": num_faces - len(clean.parent),
    }
    notes = list(clean.notes)
    if mesh.vertex_normals is None:
        notes.append(f"vertex normals computed: {len(shading.vertex_in)} vertices after splitting at creases")
    if edges.num_non_manifold:
        notes.append(f"{edges.num_non_manifold} edges have three faces or more: faces kept, vertices split there")
    if counts["faces_added"]:
        lengths = f"longest edge {longest[0]:.4g} to {longest[1]:.4g}"
        notes.append(f"{len(clean.parent)} faces cut into {num_faces}: {lengths}")
    if longest[1] > (options.max_edge_length or np.inf):
        notes.append(f"max_edge_length is not reached: it needs more than {options.max_faces} faces (max_faces)")
    return MeshReport(len(mesh.faces), num_faces, {k: v for k, v in counts.items() if v}, tuple(notes))

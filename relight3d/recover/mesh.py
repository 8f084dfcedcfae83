"""From a mesh as a file gives it to one that can be traced and fitted: clean, coherent, evenly subdivided."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64, Int32

from relight3d.errors import InputError
from relight3d.io.meshes import check_mesh
from relight3d.maths.topology import first_equal_row, repeated_faces, shared_edges, split_non_manifold
from relight3d.records import MeshReport, PatchMesh, TriangleMesh
from relight3d.recover.mesh_filters import Subdivision, subdivide, without_high_frequencies
from relight3d.recover.mesh_normals import ShadingVertices, shading_vertices
from relight3d.recover.mesh_repair import CleanFaces, clean_faces

DENOISE_STEPS = 5
LEAST_SCAN = 2000  # faces: a mesh of fewer was made by hand, and its corners are meant
ROUGH = 0.05  # of an edge: DiLiGenT's scans and rendered meshes have 0.003 to 0.02, noise of 0.1 of an edge has 0.05
ALIKE = 0.06  # correlation of neighbours: of noise at most 0, of things 0.1 and more
MOST_OUT = 0.3  # of an edge: what is moved by more counts as so much


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
    denoise_steps: int | None = None  # of Taubin's smoothing; None: where a scan is rough from face to face; 0: never

    def __post_init__(self) -> None:
        edge = self.max_edge_length
        checks = (
            ("max_faces", self.max_faces, 1 <= self.max_faces <= 100_000_000, "1 to 100,000,000"),
            ("target_faces", self.target_faces, 0 <= self.target_faces <= self.max_faces, "0 to max_faces"),
            ("max_edge_length", edge, edge is None or 0 < edge < np.inf, "a positive length"),
            ("crease_angle_deg", self.crease_angle_deg, 0 <= self.crease_angle_deg <= 180, "0 to 180 degrees"),
            ("weld_tolerance", self.weld_tolerance, 0 <= self.weld_tolerance < 0.01, "0 to 0.01 of the diagonal"),
            ("denoise_steps", self.denoise_steps, 0 <= (self.denoise_steps or 0) <= 1000, "0 to 1000"),
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
    clean = _cleaned(mesh, options)
    quiet = _denoised(mesh, clean, options)
    if quiet is not None:
        mesh, clean = quiet, _cleaned(quiet, options)
    shading = shading_vertices(clean, mesh, np.deg2rad(options.crease_angle_deg))
    faces, source = split_non_manifold(shading.faces)
    vertex_in, normals = shading.vertex_in[source], shading.normals[source]
    max_edge = np.inf if options.max_edge_length is None else options.max_edge_length / clean.scale
    plan = _SplitPlan(options.target_faces, max_edge, options.max_faces)
    points = clean.points[vertex_in]
    cut = _cut(points, faces, plan, options.target_faces)
    longest = clean.scale * _longest_edge(points, faces), clean.scale * _longest_edge(cut.points, cut.faces)
    report = _report(mesh, clean, shading, longest, len(cut.faces), options)
    if quiet is not None:
        report = replace(report, notes=("a scan, rough from face to face: its vertices were smoothed", *report.notes))
    return _assemble(mesh, clean, vertex_in, normals[faces], cut, report)


def _cleaned(mesh: TriangleMesh, options: MeshOptions) -> CleanFaces:
    return clean_faces(mesh, options.weld_tolerance, options.min_face_height, options.orient, options.unfold)


def _denoised(mesh: TriangleMesh, clean: CleanFaces, options: MeshOptions) -> TriangleMesh | None:
    """The mesh smoothed, where it is a scan that is rough from face to face, or smoothing is asked for.

    A scan's noise turns each face its own way: near the terminator half of them are dark, and cast shadows.
    """
    if options.denoise_steps == 0 or (options.denoise_steps is None and len(clean.faces) < LEAST_SCAN):
        return None
    used, faces = np.unique(clean.faces, return_inverse=True)
    points, faces = clean.points[used], faces.reshape(-1, 3).astype(np.int32)
    smooth = without_high_frequencies(points, faces, options.denoise_steps or DENOISE_STEPS)
    if options.denoise_steps is None and not _is_noise(points, faces, smooth - points):
        return None
    places, row = mesh.vertices.copy(), np.full(len(clean.points), -1)
    row[used] = np.arange(len(used))
    row = row[clean.twin]
    places[row >= 0] = clean.center + clean.scale * smooth[row[row >= 0]]
    return replace(mesh, vertices=places)


def _is_noise(
    points: Float64[np.ndarray, "vertex 3"], faces: Int32[np.ndarray, "face 3"], moved: Float64[np.ndarray, "vertex 3"]
) -> bool:
    """Whether what smoothing takes away is noise: much of an edge nearly everywhere, and no two neighbours' alike.

    Where things are flat most vertices stay; where they bend, at a corner as on a ball, neighbours go the same way.
    """
    one, other = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)]).T
    one, other = np.concatenate([one, other]), np.concatenate([other, one])
    length = np.linalg.norm(points[one] - points[other], axis=1)
    edge = np.bincount(one, length) / np.bincount(one)
    if np.quantile(np.linalg.norm(moved, axis=1) / edge, 0.25) < ROUGH:
        return False
    across = np.cross(*np.moveaxis(np.diff(points[faces], axis=1), 1, 0))
    normal = np.zeros_like(points)
    for k in range(3):
        np.add.at(normal, faces[:, k], across)
    out = np.clip(np.einsum("vi,vi->v", moved, _unit(normal)) / edge, -MOST_OUT, MOST_OUT)
    together = float((out[one] * out[other]).sum()) / max(float((out[one] ** 2).sum()), 1e-30)
    return together < ALIKE


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

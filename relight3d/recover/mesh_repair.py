"""Cleaning by reference: which of a mesh's faces stay, how they turn, and which of its vertices are one.

Nothing is copied or averaged: a face is three numbers of corners of the input (3 * face + slot), so that its normals,
UVs and label stay exact. Lengths are measured in a frame about the mesh's middle and of about unit size, so that
neither a scene's unit nor its distance from the origin changes what is done.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float64, Int32, Int64

from relight3d.errors import MeshError
from relight3d.maths.topology import (
    coherent_flips,
    dihedral_angles,
    repeated_faces,
    shared_edges,
    split_non_manifold,
    weld,
)
from relight3d.records import TriangleMesh
from relight3d.recover.mesh_filters import flip_folds

MAX_EXTENT = 1e12  # beyond, and below the inverse, products of four lengths leave the range of float32
FOLD_RAD = np.deg2rad(174.0)  # the filter's own limit is 175 degrees


@dataclass(frozen=True, eq=False)
class CleanFaces:
    """The faces that stay, as references into the input mesh, and what was done to get them."""

    center: Float64[np.ndarray, "3"]
    scale: float  # a power of two: world = center + scale * point
    diagonal: float  # of the bounding box, in the unit frame
    points: Float64[np.ndarray, "vertex 3"]  # the input's vertices in the unit frame, each at its twin's place
    twin: Int32[np.ndarray, " vertex"]  # the lowest-numbered vertex at the same place
    corner: Int64[np.ndarray, "face 3"]
    parent: Int32[np.ndarray, " face"]
    faces_in: Int32[np.ndarray, "input_face 3"]
    changes: dict[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def vertex(self) -> Int32[np.ndarray, "face 3"]:
        """The input's vertex at each corner."""
        return self.faces_in.ravel()[self.corner]

    @property
    def faces(self) -> Int32[np.ndarray, "face 3"]:
        """The place at each corner, by the number of its first vertex."""
        return self.twin[self.vertex]

    def keep(self, is_kept: Bool[np.ndarray, " face"], kind: str) -> "CleanFaces":
        """The faces marked True; the others are counted as `kind`."""
        changes = self.count(kind, len(is_kept) - int(is_kept.sum()))
        return replace(self, corner=self.corner[is_kept], parent=self.parent[is_kept], changes=changes)

    def count(self, kind: str, number: int) -> dict[str, int]:
        """The changes with `number` more of a kind; 0 makes no entry."""
        return {**self.changes, kind: self.changes.get(kind, 0) + number} if number else self.changes


def clean_faces(
    mesh: TriangleMesh, weld_tolerance: float, min_face_height: float, orient: bool, unfold: bool
) -> CleanFaces:
    """Weld vertices, drop faces that cannot be used, turn the others coherently. A good mesh passes as it is.

    The lengths are fractions of the bounding box's diagonal. Raises MeshError where no face is left.
    """
    clean = _drop_useless(_weld(mesh, weld_tolerance), min_face_height)
    if orient:
        clean = _orient(clean, mesh)
    if unfold:
        clean = _drop_useless(_unfold(clean, mesh), min_face_height)
    return clean


def face_normals(points: Float64[np.ndarray, "vertex 3"], faces: Int32[np.ndarray, "face 3"]) -> np.ndarray:
    """The cross product of two sides: normal to the face, as long as twice its area."""
    a, b, c = np.moveaxis(points[faces], 1, 0)
    return np.cross(b - a, c - a)


def _weld(mesh: TriangleMesh, tolerance: float) -> CleanFaces:
    """All faces with finite corners, in the unit frame, vertices within the tolerance put at one place."""
    num_faces = len(mesh.faces)
    is_finite = np.asarray(np.isfinite(mesh.vertices).all(axis=1)[mesh.faces].all(axis=1))
    is_used = np.zeros(len(mesh.vertices), dtype=bool)
    is_used[mesh.faces[is_finite]] = True
    used = np.flatnonzero(is_used)
    center, scale = _unit_frame(mesh.vertices[used])
    with np.errstate(over="ignore", invalid="ignore"):  # only at vertices that no finite face has
        points = (mesh.vertices - center) / scale
    diagonal = float(np.linalg.norm(np.ptp(points[used], axis=0)))
    twin = np.arange(len(points), dtype=np.int32)
    twin[used] = used[weld(points[used], tolerance * diagonal)]
    moved = (points[used] != points[twin[used]]).any(axis=1).sum()
    clean = CleanFaces(
        center=center,
        scale=scale,
        diagonal=diagonal,
        points=points[twin],
        twin=twin,
        corner=np.arange(3 * num_faces).reshape(-1, 3),
        parent=np.arange(num_faces, dtype=np.int32),
        faces_in=mesh.faces,
    )
    clean = clean.keep(is_finite, "faces_not_finite")
    return replace(clean, changes=clean.count("vertices_moved_to_twin", int(moved)))


def _drop_useless(clean: CleanFaces, min_height: float) -> CleanFaces:
    """Drop faces without height, and those on the same three places as an earlier one."""
    clean = clean.keep(_heights(clean.points, clean.faces) > min_height * clean.diagonal, "faces_zero_area")
    if len(clean.parent) == 0:
        raise MeshError("mesh", f"{len(clean.faces_in)} faces without area", "at least one face with an area")
    return clean.keep(~repeated_faces(clean.faces), "faces_duplicate")


def _unit_frame(place: Float64[np.ndarray, "vertex 3"]) -> tuple[Float64[np.ndarray, "3"], float]:
    """The middle of the bounding box, and the power of two that takes its longest side to 0.5 to 1."""
    low, high = place.min(axis=0), place.max(axis=0)
    half = float((high / 2 - low / 2).max())  # halves first: the largest doubles must not overflow
    if not half <= MAX_EXTENT or 0 < half < 1 / MAX_EXTENT:
        raise MeshError("mesh vertices", f"an extent of {half:.3g}", f"one of {1 / MAX_EXTENT:g} to {MAX_EXTENT:g}")
    return low / 2 + high / 2, float(2.0 ** (np.ceil(np.log2(half)) + 1)) if half > 0 else 1.0


def _heights(points: np.ndarray, faces: np.ndarray) -> Float64[np.ndarray, " face"]:
    """The shortest altitude of each face; 0 where corners coincide."""
    place = points[faces]
    longest = np.linalg.norm(np.roll(place, -1, axis=1) - place, axis=2).max(axis=1)
    height = np.linalg.norm(face_normals(points, faces), axis=1) / np.where(longest > 0, longest, 1.0)
    has_repeat = (faces == np.roll(faces, -1, axis=1)).any(axis=1)  # rounding can leave a tiny area there
    return np.where(has_repeat, 0.0, height)


def _orient(clean: CleanFaces, mesh: TriangleMesh) -> CleanFaces:
    """Turn faces over so that neighbours agree, the way most of each component's area faces already.

    Where the mesh brings vertex normals they vote instead, and no face that its own normals confirm is turned.
    A component that cannot be oriented stays as it is and is named in the notes.
    """
    normals = face_normals(clean.points, clean.faces)
    vote = np.linalg.norm(normals, axis=1)
    confirmed = np.zeros(len(vote), dtype=bool)
    if mesh.vertex_normals is not None:
        given = np.nan_to_num(mesh.vertex_normals.astype(np.float64), posinf=0.0, neginf=0.0)[clean.vertex].sum(axis=1)
        agreement = np.sign((normals * given).sum(axis=1))
        confirmed = agreement > 0
        vote = np.where(agreement == 0, 1e-3, agreement) * vote  # mute faces go with their neighbours
    flips, component, is_orientable = coherent_flips(len(vote), shared_edges(clean.faces))
    for_flips = np.bincount(component, vote * np.where(flips, -1.0, 1.0), minlength=len(is_orientable))
    flips = (flips ^ (for_flips < 0)[component]) & is_orientable[component] & ~confirmed
    corner = clean.corner.copy()
    corner[flips] = corner[flips][:, [0, 2, 1]]
    changes = clean.count("faces_flipped", int(flips.sum()))
    notes = clean.notes
    for lowest in np.flatnonzero(~is_orientable)[:3]:
        size = int((component == lowest).sum())
        notes += (f"{size} connected faces cannot be oriented (one-sided, as a Moebius strip): left as they are",)
    clean = replace(clean, corner=corner, changes=changes, notes=notes)
    return replace(clean, changes=clean.count("components_not_orientable", int((~is_orientable).sum())))


def _unfold(clean: CleanFaces, mesh: TriangleMesh) -> CleanFaces:
    """Unfold faces that lie back on a neighbour of the same label. Only the two faces of a fold change."""
    edges, normals = shared_edges(clean.faces), face_normals(clean.points, clean.faces)
    if not (dihedral_angles(normals, edges.pairs)[edges.is_coherent] >= FOLD_RAD).any():
        return clean
    label = np.zeros(len(clean.parent), np.int64) if mesh.object_id is None else mesh.object_id[clean.parent]
    # Vertices are told apart by label, so that no turned edge can carry a face into another object.
    _, label = np.unique(label, return_inverse=True)
    key, labelled = np.unique(clean.faces + label[:, None] * len(clean.points), return_inverse=True)
    before, source = split_non_manifold(labelled.reshape(-1, 3).astype(np.int32))
    after = flip_folds(clean.points[key[source] % len(clean.points)], before)
    is_changed = (after != before).any(axis=1)
    if not is_changed.any():
        return clean
    # A turned face takes the corner it lacks from its partner, which had it.
    corner_at = np.full(len(source), -1, dtype=np.int64)
    corner_at[before[is_changed]] = clean.corner[is_changed]
    corner = clean.corner.copy()
    own = before[is_changed][:, None, :] == after[is_changed][:, :, None]
    kept = np.take_along_axis(clean.corner[is_changed], own.argmax(axis=2), axis=1)
    corner[is_changed] = np.where(own.any(axis=2), kept, corner_at[after[is_changed]])
    return replace(clean, corner=corner, changes=clean.count("faces_unfolded", int(is_changed.sum())))

"""The division into surfaces: the mesh's own labels, or regions of one material found in the photographs.

What the method calls a surface is what shares a reflectance. A mesh may bring labels; a scan is one piece. There the
geometry divides first (connected pieces, cut at creases to panels) and the photographs second (a smooth panel is cut
where its albedo changes for good; parts of one piece that look alike are one surface again). Texture, shading and
highlights must not divide; a mirror, whose pixels show other things, is held together by its geometry.

Differs from the paper: its objects come divided by hand.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32
from scipy.spatial import cKDTree

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.maths import regions, topology
from relight3d.records import PatchMesh, ShadingPoints, Surfaces
from relight3d.recover.segmentation import SegmentationOptions, cut_panels

MAX_POINTS = 250_000  # more pixels than this are thinned out: the division needs no more


@dataclass(frozen=True)
class SurfaceOptions:
    """What cuts a scan into surfaces."""

    crease_deg: float = 40.0  # a sharper edge than this cuts
    split_normal_deg: float = 15.0  # so does an edge across which the vertex normals jump by this
    min_information: float = 0.02  # of the median: a pixel lit less than this says nothing of its albedo
    parts: SegmentationOptions = field(default_factory=SegmentationOptions)

    def __post_init__(self) -> None:
        for name in ("crease_deg", "split_normal_deg"):
            if not 1 <= getattr(self, name) <= 175:
                raise InputError(f"surfaces.{name}", getattr(self, name), "1 to 175 degrees")
        if not 0 <= self.min_information < 1:
            raise InputError("surfaces.min_information", self.min_information, "0 to 1, a share of the median")


def surfaces_from_labels(mesh: PatchMesh) -> Surfaces | None:
    """One surface per object_id, in their order, named by object_names where they are; None without labels."""
    if mesh.object_id is None:
        return None
    ids, surface_of_face = np.unique(mesh.object_id, return_inverse=True)
    names = mesh.object_names or {}
    return _surfaces(surface_of_face, tuple(names.get(int(i)) or f"object {i}" for i in ids))


def surfaces_from_photographs(
    mesh: PatchMesh,
    points: ShadingPoints,
    camera: Camera,
    albedo: Float32[np.ndarray, "point 3"],
    information: Float32[np.ndarray, " point"],
    options: SurfaceOptions,
) -> Surfaces:
    """Regions of one material, per face, from the mesh's creases and a rough albedo of each pixel.

    `albedo` is each pixel's least squares over the photographs, with indirect light, mirrors and highlights still in
    it; `information` its summed squared irradiance, 0 where no light was seen. Faces that no pixel tells of take the
    label of the nearest that one does, along the mesh if they are connected. Surfaces are numbered by their first
    face. With no telling pixel at all, the whole mesh is one surface.
    """
    edges = topology.shared_edges(mesh.welded_vertex[mesh.faces])
    piece = regions.components(len(mesh.faces), edges.pairs)
    panel = regions.components(len(mesh.faces), edges.pairs[~creases(mesh, edges, options)])
    tells = information > options.min_information * (float(np.median(information)) if len(information) else 0.0)
    points, albedo = points.take(tells), albedo[tells]
    surface = np.zeros(len(mesh.faces), np.int32)
    if len(points):
        points, albedo, camera = _thinned(points, albedo, camera)
        colors, of_piece, parts = log_colors(albedo), piece[points.face], options.parts.for_picture(len(points))
        of_panel = large_panels(panel[points.face], of_piece, parts)
        near = neighbours(points, camera)
        near = near[of_piece[near[:, 0]] == of_piece[near[:, 1]]]
        of_panel, part = cut_panels(points, camera, of_panel, colors, near, parts)
        joined = merge_parts(part, of_panel, colors, part[near], parts)[part]
        votes = face_votes(points.face, without_small(joined, parts), len(mesh.faces))
        surface = _spread(mesh, edges.pairs, votes)
    first = regions.first_of_each(surface)
    number = np.argsort(np.argsort(first))[regions.renumbered(surface)]
    return _surfaces(number, tuple(f"surface {i}" for i in range(len(first))))


def creases(mesh: PatchMesh, edges: topology.SharedEdges, options: SurfaceOptions) -> Bool[np.ndarray, " pair"]:
    """The edges that cut: sharp ones, and those across which the shading normals jump."""
    angle = topology.dihedral_angles(mesh.face_normals, edges.pairs)
    jump = np.zeros(len(edges.pairs))
    for end in (0, 1):
        one = mesh.faces[edges.pairs[:, 0], (edges.sides[:, 0] + end) % 3]
        # The other face's corner at the same place, whichever way it runs along the edge.
        corners = mesh.faces[edges.pairs[:, 1]]
        at = (mesh.welded_vertex[corners] == mesh.welded_vertex[one][:, None]).argmax(axis=1)
        other = corners[np.arange(len(corners)), at]
        cosine = np.einsum("pi,pi->p", mesh.vertex_normals[one], mesh.vertex_normals[other])
        jump = np.maximum(jump, np.arccos(np.clip(cosine, -1, 1)))
    return (angle > np.radians(options.crease_deg)) | (jump > np.radians(options.split_normal_deg))


def neighbours(points: ShadingPoints, camera: Camera) -> Int32[np.ndarray, "pair 2"]:
    """Pairs of points in neighbouring pixels that are neighbours in space too, not across an outline."""
    grid = np.full(camera.num_pixels, -1, np.int32)
    grid[points.pixel] = np.arange(len(points), dtype=np.int32)
    grid = grid.reshape(camera.height, camera.width)
    one = np.concatenate([grid[:, :-1].ravel(), grid[:-1].ravel()])
    other = np.concatenate([grid[:, 1:].ravel(), grid[1:].ravel()])
    pairs = np.stack([one, other], axis=1)[(one >= 0) & (other >= 0)]
    apart = np.linalg.norm(points.position[pairs[:, 0]] - points.position[pairs[:, 1]], axis=1)
    slant = np.abs(np.einsum("pi,pi->p", points.geometric_normal, points.to_viewer))
    reach = points.depth / min(camera.fx, camera.fy) / np.maximum(slant, 0.1)
    return pairs[apart < 3.0 * np.maximum(reach[pairs[:, 0]], reach[pairs[:, 1]])]


def log_colors(albedo: Float32[np.ndarray, "point 3"]) -> Float64[np.ndarray, "point 3"]:
    """Log luminance and two log colour ratios, which indirect light changes less."""
    # The ratios of what is much darker than the rest are noise.
    offset = max(0.05 * float(np.median(albedo)), 1e-12)
    red, green, blue = np.log(np.maximum(albedo, 0).astype(np.float64) + offset).T
    return np.stack([(red + green + blue) / 3, (red - green) / 2**0.5, (red + green - 2 * blue) / 6**0.5], axis=1)


def large_panels(
    panel: Int32[np.ndarray, " point"], piece: Int32[np.ndarray, " point"], options: SegmentationOptions
) -> Int32[np.ndarray, " point"]:
    """Panels, with all those of a piece that are smaller than a patch as one: a rough scan's creases are noise."""
    is_large = np.bincount(panel)[panel] >= options.patch_px
    return np.where(is_large, panel, int(panel.max()) + 1 + piece).astype(np.int32)


def without_small(part: Int32[np.ndarray, " point"], options: SegmentationOptions) -> Int32[np.ndarray, " point"]:
    """Parts of too few pixels become -1; if all are too small, the largest stays."""
    count = np.bincount(part)
    return np.where(count[part] >= min(options.min_pixels, count.max()), part, -1).astype(np.int32)


def merge_parts(
    part: Int32[np.ndarray, " point"],
    panel: Int32[np.ndarray, " point"],
    colors: Float64[np.ndarray, "point 3"],
    touching: Int32[np.ndarray, "pair 2"],
    options: SegmentationOptions,
) -> Int32[np.ndarray, " part"]:
    """The surface of each part: parts that touch and look alike in all their colours are one surface again.

    Parts of one panel stay apart, they were cut for a reason. Parts smaller than a patch join none: a mixture of what
    is on their two sides would join the two. They go to the neighbour they are most like.
    """
    moments = regions.region_moments(colors, part, int(part.max()) + 1)
    panel_of_part = panel[regions.first_of_each(part)]
    touching, border = regions.borders(touching, np.ones(len(touching)))
    is_large = moments.count >= options.patch_px
    may_merge = is_large[touching].all(axis=1) & (panel_of_part[touching[:, 0]] != panel_of_part[touching[:, 1]])
    # A few stray pixels of a part, somewhere beside another, do not make the two neighbours.
    may_merge &= border > 0.25 * np.sqrt(moments.count[touching].min(axis=1))
    pairs = np.concatenate([touching[may_merge], regions.pairs_within(panel_of_part)])
    is_apart = np.arange(len(pairs)) >= may_merge.sum()
    label = regions.merge_alike(moments, pairs, options.floor, options.same_material, may_merge=~is_apart)
    moments = regions.united(moments, label, grows=True)
    touching, _ = regions.borders(label[touching], border)
    return regions.absorb(moments, touching, options.floor, moments.count < options.patch_px)[label]


def face_votes(
    face: Int32[np.ndarray, " point"], part: Int32[np.ndarray, " point"], num_faces: int
) -> Int32[np.ndarray, " face"]:
    """The part that most pixels of a face are in; -1 for a face without."""
    says = part >= 0
    num_parts = int(part.max(initial=0)) + 1
    key, count = np.unique(face[says].astype(np.int64) * num_parts + part[says], return_counts=True)
    key = key[np.argsort(count, kind="stable")]  # the last one written stays: the most votes
    label = np.full(num_faces, -1, np.int32)
    label[key // num_parts] = key % num_parts
    return label


def _spread(
    mesh: PatchMesh, pairs: Int32[np.ndarray, "pair 2"], surface: Int32[np.ndarray, " face"]
) -> Int32[np.ndarray, " face"]:
    """Faces of -1 take the nearest label: along the mesh first, through space where none is connected."""
    middle = mesh.centered_vertices[mesh.faces].mean(axis=1)
    length = np.linalg.norm(middle[pairs[:, 0]] - middle[pairs[:, 1]], axis=1)
    surface = regions.nearest_labelled(surface, pairs, length)
    is_lost = surface < 0
    if is_lost.any():
        known = np.flatnonzero(~is_lost)
        surface[is_lost] = surface[known[cKDTree(middle[known]).query(middle[is_lost])[1]]]
    return surface


def _thinned(points: ShadingPoints, albedo: np.ndarray, camera: Camera) -> tuple[ShadingPoints, np.ndarray, Camera]:
    """Every k-th row and column of a large picture, as a picture of its own."""
    step = int(np.ceil(np.sqrt(len(points) / MAX_POINTS)))
    if step <= 1:
        return points, albedo, camera
    row, column = np.divmod(points.pixel, camera.width)
    kept = (row % step == 0) & (column % step == 0)
    small = camera.resized(-(-camera.width // step), -(-camera.height // step))
    pixel = row[kept] // step * small.width + column[kept] // step
    return replace(points.take(kept), pixel=pixel.astype(np.int32)), albedo[kept], small


def _surfaces(surface_of_face: np.ndarray, names: tuple[str, ...]) -> Surfaces:
    return Surfaces(surface_of_face.astype(np.int32), names, (("diffuse",),) * len(names))

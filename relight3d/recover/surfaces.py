"""The division into surfaces: the mesh's own labels, or regions of one material found in the photographs.

What the method calls a surface is what shares a reflectance. A mesh may bring labels; a scan is one piece. There the
geometry divides first (connected pieces, cut at creases into panels) and the photographs second (a smooth panel is cut
where its albedo changes for good; panels of one piece that look alike are one surface again). Texture, shading and
highlights must not divide; a mirror, whose pixels show other things, is held together by its geometry.

Differs from the paper: its objects come divided by hand.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32
from scipy.spatial import cKDTree
from skimage.segmentation import slic

from relight3d.camera import Camera
from relight3d.errors import InputError
from relight3d.maths import regions, topology
from relight3d.records import PatchMesh, ShadingPoints, Surfaces


@dataclass(frozen=True)
class SurfaceOptions:
    """What cuts a scan into surfaces, and what joins its parts again."""

    crease_deg: float = 40.0  # a sharper edge than this cuts
    split_normal_deg: float = 15.0  # so does an edge whose two sides have vertex normals this far apart
    luminance_scatter: float = 0.25  # of the log albedo within one material: indirect light is still in it
    chroma_scatter: float = 0.08  # of the log ratios of its colours
    same_material: float = 0.7  # Bhattacharyya distance below which two parts of a piece are one material
    min_information: float = 0.02  # of the median: a pixel lit less than this says nothing of its albedo
    min_pixels: int = 24  # a smaller region is absorbed
    flat_deg: float = 12.0  # a panel whose normals stay within this is never cut: it may be a mirror
    min_share: float = 0.02  # of a smooth panel: smaller parts are not cut off
    patch_px: int = 150  # pixels in the patches that a smooth panel is put together from
    interleaving: float = 4.0  # colours within each other more than so many discs on a ground are one texture

    def __post_init__(self) -> None:
        if not 5 <= self.crease_deg <= 175:
            raise InputError("surfaces.crease_deg", self.crease_deg, "5 to 175 degrees")
        if not 1 <= self.split_normal_deg <= 175:
            raise InputError("surfaces.split_normal_deg", self.split_normal_deg, "1 to 175 degrees")
        for name in ("luminance_scatter", "chroma_scatter", "same_material"):
            if not 0 < getattr(self, name) < 10:
                raise InputError(f"surfaces.{name}", getattr(self, name), "a number between 0 and 10")
        if not 0 <= self.min_information < 1:
            raise InputError("surfaces.min_information", self.min_information, "0 to 1, a share of the median")
        if self.min_pixels < 1:
            raise InputError("surfaces.min_pixels", self.min_pixels, "at least 1 pixel")

    @property
    def floor(self) -> Float64[np.ndarray, "3"]:
        """The scatter of log luminance and of the two log colour ratios that one material may have."""
        return np.array([self.luminance_scatter, self.chroma_scatter, self.chroma_scatter])


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
    """Regions of one material, per face, from creases and a rough albedo of each pixel.

    `albedo` is each pixel's least squares over the photographs, with indirect light, mirrors and highlights still in
    it; `information` its summed squared irradiance, 0 where no light was seen. Faces that no pixel tells of take the
    label of the nearest that one does, along the mesh if they are connected.
    """
    edges = topology.shared_edges(mesh.welded_vertex[mesh.faces])
    is_cut = creases(mesh, edges, options)
    piece = regions.components(len(mesh.faces), edges.pairs)
    panel = regions.components(len(mesh.faces), edges.pairs[~is_cut])
    tells = information > options.min_information * float(np.median(information))
    points, colors = points.take(tells), log_colors(albedo[tells])
    part = cut_panels(points, camera, panel[points.face], colors, options)
    part = merge_parts(part, piece[points.face], colors, options)
    surface = spread(mesh, edges.pairs, face_votes(points.face, part, len(mesh.faces)))
    surface = np.unique(surface, return_inverse=True)[1]
    return _surfaces(surface, tuple(f"surface {i}" for i in range(int(surface.max()) + 1)))


def cut_panels(
    points: ShadingPoints,
    camera: Camera,
    panel: Int32[np.ndarray, " point"],
    colors: Float64[np.ndarray, "point 3"],
    options: SurfaceOptions,
) -> Int32[np.ndarray, " point"]:
    """Parts of one material within each panel: patches of like colour put together, and the colours of a texture."""
    panel = np.unique(panel, return_inverse=True)[1]
    patch = np.where(is_flat(points, panel, options.flat_deg)[panel], 0, _patches(points, camera, colors, options) + 1)
    (panel_of_part, _), part = np.unique(np.stack([panel, patch]), axis=1, return_inverse=True)
    part = part.ravel()
    near = _neighbours(points, camera)
    near = near[panel[near[:, 0]] == panel[near[:, 1]]]

    def merged(into: np.ndarray) -> None:
        nonlocal part, panel_of_part
        part, panel_of_part = into[part], panel_of_part[np.unique(into, return_index=True)[1]]

    def state() -> tuple[regions.Moments, np.ndarray, np.ndarray]:
        moments = regions.region_moments(colors, part, len(panel_of_part))
        pairs, length = regions.borders(part[near])
        return moments, pairs, length

    moments, pairs, _ = state()
    merged(regions.merge_alike(moments, pairs, options.floor, options.same_material))
    moments, pairs, _ = state()
    least = np.maximum(options.min_pixels, options.min_share * np.bincount(panel)[panel_of_part])
    into = regions.most_alike_neighbour(moments, pairs, options.floor, moments.count < least)
    merged(np.unique(into, return_inverse=True)[1])
    moments, _, _ = state()
    same_panel = regions.pairs_within(panel_of_part)
    merged(regions.merge_alike(moments, same_panel, options.floor, options.same_material))
    moments, pairs, length = state()
    merged(regions.merge_interleaved(moments.count, pairs, length, options.interleaving))
    return part.astype(np.int32)


def merge_parts(
    part: Int32[np.ndarray, " point"],
    piece: Int32[np.ndarray, " point"],
    colors: Float64[np.ndarray, "point 3"],
    options: SurfaceOptions,
) -> Int32[np.ndarray, " point"]:
    """Parts of one piece that look alike are one surface again; parts of too few pixels get -1."""
    moments = regions.region_moments(colors, part, int(part.max()) + 1)
    piece_of_part = np.zeros(len(moments.count), np.int32)
    piece_of_part[part] = piece
    large = np.flatnonzero(moments.count >= options.min_pixels)
    pairs = large[regions.pairs_within(piece_of_part[large])]
    merged = regions.merge_alike(moments, pairs, options.floor, options.same_material)
    return np.where(moments.count >= options.min_pixels, merged, -1)[part].astype(np.int32)


def is_flat(points: ShadingPoints, panel: Int32[np.ndarray, " point"], flat_deg: float) -> Bool[np.ndarray, " panel"]:
    """Panels nine tenths of whose pixels have a normal within an angle of the mean."""
    count = np.bincount(panel)
    mean = np.stack([np.bincount(panel, points.normal[:, i]) for i in range(3)], axis=1)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
    near = np.einsum("pi,pi->p", points.normal, mean[panel]) > np.cos(np.radians(flat_deg))
    return np.bincount(panel, near) >= 0.9 * count


def _patches(
    points: ShadingPoints, camera: Camera, colors: Float64[np.ndarray, "point 3"], options: SurfaceOptions
) -> Int32[np.ndarray, " point"]:
    """Compact patches of like colour in the picture (SLIC superpixels)."""
    picture = np.full((camera.num_pixels, 3), 100.0, np.float32)  # far from every colour, where there is no point
    picture[points.pixel] = colors / options.floor
    picture = picture.reshape(camera.height, camera.width, 3)
    number = max(1, camera.num_pixels // options.patch_px)
    patch = slic(picture, n_segments=number, compactness=1.0, channel_axis=-1, start_label=0, convert2lab=False)
    return patch.ravel()[points.pixel].astype(np.int32)


def _neighbours(points: ShadingPoints, camera: Camera) -> Int32[np.ndarray, "pair 2"]:
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


def face_votes(
    face: Int32[np.ndarray, " point"], part: Int32[np.ndarray, " point"], num_faces: int
) -> Int32[np.ndarray, " face"]:
    """The part most pixels of a face are in; -1 for a face without."""
    says = part >= 0
    votes, count = np.unique(np.stack([face[says], part[says]]), axis=1, return_counts=True)
    order = np.argsort(count, kind="stable")  # the last one written stays: the most votes
    label = np.full(num_faces, -1, np.int32)
    label[votes[0, order]] = votes[1, order]
    return label


def creases(mesh: PatchMesh, edges: topology.SharedEdges, options: SurfaceOptions) -> Bool[np.ndarray, " pair"]:
    """The edges that cut: sharp ones, and those across which the shading normals jump."""
    angle = topology.dihedral_angles(mesh.face_normals, edges.pairs)
    is_cut = angle > np.radians(options.crease_deg)
    jump = np.ones(len(edges.pairs))
    for end in (0, 1):
        one = mesh.faces[edges.pairs[:, 0], (edges.sides[:, 0] + end) % 3]
        # The corner of the other face at the same place, whichever way it runs along the edge.
        others = mesh.faces[edges.pairs[:, 1]]
        same = mesh.welded_vertex[others] == mesh.welded_vertex[one][:, None]
        other = np.take_along_axis(others, same.argmax(axis=1)[:, None], axis=1)[:, 0]
        cosine = np.einsum("pi,pi->p", mesh.vertex_normals[one], mesh.vertex_normals[other])
        jump = np.minimum(jump, cosine)
    return is_cut | (jump < np.cos(np.radians(options.split_normal_deg)))


def log_colors(albedo: Float32[np.ndarray, "point 3"]) -> Float64[np.ndarray, "point 3"]:
    """Log luminance and two log colour ratios: what light of one colour leaves alone but for the first."""
    # Below 2 % the ratios of an albedo are noise.
    red, green, blue = np.log(np.maximum(albedo, 0).astype(np.float64) + 0.02).T
    return np.stack([(red + green + blue) / 3, (red - green) / 2**0.5, (red + green - 2 * blue) / 6**0.5], axis=1)


def spread(
    mesh: PatchMesh, pairs: Int32[np.ndarray, "pair 2"], surface: Int32[np.ndarray, " face"]
) -> Int32[np.ndarray, " face"]:
    """Faces without a label (-1) take the nearest one's: along the mesh first, through space where none is connected."""
    middle = mesh.centered_vertices[mesh.faces].mean(axis=1)
    if not (surface >= 0).any():
        return np.zeros(len(surface), np.int32)
    length = np.linalg.norm(middle[pairs[:, 0]] - middle[pairs[:, 1]], axis=1)
    surface = regions.nearest_labelled(surface, pairs, length)
    lost = surface < 0
    if lost.any():
        known = np.flatnonzero(~lost)
        surface[lost] = surface[known[cKDTree(middle[known]).query(middle[lost])[1]]]
    return surface


def _surfaces(surface_of_face: np.ndarray, names: tuple[str, ...]) -> Surfaces:
    return Surfaces(surface_of_face.astype(np.int32), names, (("diffuse",),) * len(names))

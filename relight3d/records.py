"""Every frozen record that crosses a stage, in the order of the flow.

capture + mesh -> PatchMesh -> ShadingPoints -> Lighting -> Surfaces -> Mirrors, Texture, Indirect, Lobes, Detail,
Residual -> RelightModel -> Plan -> Frame. Cameras and lights have modules of their own.

Arrays name their axes: light height width pixel point face vertex surface lobe basis. Positions inside the
recovery and the engine are centred: the mesh's middle is the origin (`PatchMesh.center` leads back to the world),
so that float32 keeps its digits for a mesh a million metres away.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int8, Int16, Int32

from relight3d.camera import Camera
from relight3d.lights import Light

# ------------------------------------------------------------------------------------------------ input


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A mesh as a file gives it, in world coordinates."""

    vertices: Float64[np.ndarray, "vertex 3"]
    faces: Int32[np.ndarray, "face 3"]
    vertex_normals: Float32[np.ndarray, "vertex 3"] | None = None
    corner_uvs: Float32[np.ndarray, "face 3 2"] | None = None  # v up, as in OBJ
    object_id: Int32[np.ndarray, " face"] | None = None  # which object or material a face belongs to
    object_names: Mapping[int, str] | None = None


@dataclass(frozen=True, eq=False)
class Photograph:
    """One photograph: which lights were on, whence it was taken, and where its pixels are.

    `pixels` holds linear radiance in memory instead of a file (synthetic captures); `is_valid` its mask.
    """

    name: str
    split: str
    lights: tuple[Light, ...]
    camera: Camera
    image_path: Path | None = None
    mask_path: Path | None = None
    group: str = ""  # the file's own word for a kind of test frame; means are reported per group
    pixels: Float32[np.ndarray, "height width 3"] | None = None
    is_valid: Bool[np.ndarray, "height width"] | None = None


@dataclass(frozen=True, eq=False)
class Capture:
    """A capture folder: a mesh, and photographs under known lights. The training ones share `camera`."""

    folder: Path
    camera: Camera
    photographs: tuple[Photograph, ...]
    mesh: TriangleMesh
    color_space: str = "linear"
    unit: str = ""

    def split(self, name: str) -> tuple[Photograph, ...]:
        """The photographs of one split, in the file's order."""
        return tuple(p for p in self.photographs if p.split == name)


@dataclass(frozen=True, eq=False)
class MeshReport:
    """What cleaning and subdivision changed: a count by kind of change, and lines for a person."""

    num_faces_in: int
    num_faces_out: int
    changes: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class PatchMesh:
    """The clean, subdivided mesh whose faces carry the indirect light; world coordinates.

    Vertices may stand at one place with different normals or UVs; `welded_vertex` gives them one number, for
    questions about edges and neighbours. `parent_face` is the face of the input mesh each one came from.
    """

    vertices: Float64[np.ndarray, "vertex 3"]
    faces: Int32[np.ndarray, "face 3"]
    vertex_normals: Float32[np.ndarray, "vertex 3"]
    welded_vertex: Int32[np.ndarray, " vertex"]
    parent_face: Int32[np.ndarray, " face"]
    object_id: Int32[np.ndarray, " face"] | None
    corner_uvs: Float32[np.ndarray, "face 3 2"] | None
    object_names: Mapping[int, str] | None
    report: MeshReport

    @cached_property
    def center(self) -> Float64[np.ndarray, "3"]:
        """The middle of the bounding box: the origin of all centred coordinates."""
        return (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2

    @cached_property
    def centered_vertices(self) -> Float32[np.ndarray, "vertex 3"]:
        """Vertices about `center`; the difference is taken in float64."""
        return np.ascontiguousarray((self.vertices - self.center).astype(np.float32))

    @cached_property
    def radius(self) -> float:
        """The radius of the sphere about `center` that holds the mesh."""
        return float(np.linalg.norm(self.vertices - self.center, axis=1).max())

    @cached_property
    def face_normals(self) -> Float32[np.ndarray, "face 3"]:
        """Unit geometric normals by the corners' order; zero for a face without area."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.where(length > 0, normal / np.maximum(length, np.finfo(np.float64).tiny), 0.0).astype(np.float32)

    @cached_property
    def face_areas(self) -> Float64[np.ndarray, " face"]:
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


# ------------------------------------------------------------------------------------- geometry of a view


@dataclass(frozen=True, eq=False)
class ShadingPoints:
    """The points a picture is made of, one per pixel that sees the mesh (in a mirror, the point it shows).

    Structure of arrays, centred coordinates. `normal` shades, `geometric_normal` (turned to the viewer) offsets
    rays. `barycentric` are the weights of the face's three corners.
    """

    pixel: Int32[np.ndarray, " point"]  # flat index, row by row
    face: Int32[np.ndarray, " point"]
    barycentric: Float32[np.ndarray, "point 3"]
    position: Float32[np.ndarray, "point 3"]
    geometric_normal: Float32[np.ndarray, "point 3"]
    normal: Float32[np.ndarray, "point 3"]
    to_viewer: Float32[np.ndarray, "point 3"]
    depth: Float32[np.ndarray, " point"]

    def __len__(self) -> int:
        return len(self.pixel)

    def take(self, index: np.ndarray) -> "ShadingPoints":
        """The points of an index or a mask."""
        return ShadingPoints(**{name: getattr(self, name)[index] for name in self.__dataclass_fields__})


@dataclass(frozen=True, eq=False)
class Lighting:
    """How one light reaches each point: what geometry decides, for a light of power 1.

    Radiance is linear in the light's power (rgb), so one number per point is enough: `form` = falloff * cosine where
    the light is seen, 0 in its shadow. `cosine` is n.l whatever stands between. `thrown` holds the same as `form`
    for the light that each plane mirror throws (before its reflectance), None where no mirror does.
    """

    to_light: Float32[np.ndarray, "point 3"]
    cosine: Float32[np.ndarray, " point"]
    form: Float32[np.ndarray, " point"]
    is_lit: Bool[np.ndarray, " point"]
    thrown: Float32[np.ndarray, "mirror point"] | None = None
    num_rays: int = 0
    num_thrown_rays: int = 0


@dataclass(frozen=True, eq=False)
class Observations:
    """The training photographs at the points of the captured view, normalised, with all that geometry says of them.

    `radiance` is divided by each photograph's `scale` (the summed power of its lights per colour; for a lights-off
    frame the mean of the others), so that photographs of unequal lamps stand on one footing; `weight` carries
    what the division did to the noise, and is 0 where a colour or pixel says nothing. `form` sums the lights of a
    photograph by their share of the colour (its last axis has length 1 when every photograph has one light). `lights`
    are in centred coordinates.
    """

    radiance: Float32[np.ndarray, "photo point 3"]
    weight: Float32[np.ndarray, "photo point"]
    scale: Float64[np.ndarray, "photo 3"]
    lights: tuple[tuple[Light, ...], ...]
    form: Float32[np.ndarray, "photo point color"]
    thrown: Float32[np.ndarray, "mirror photo point color"] | None
    is_lit: Bool[np.ndarray, "photo point"]
    is_facing: Bool[np.ndarray, "photo point"]  # towards a light, and not grazing it, whatever stands between
    is_safe: Bool[np.ndarray, "photo point"]  # clear of shadow borders by the geometry's error, and not grazing
    is_highlight: Bool[np.ndarray, "photo point"]  # a highlight is possible here by geometry alone
    is_interior: Bool[np.ndarray, " point"]  # off the outlines, where a pixel mixes two surfaces
    num_rays: int = 0
    # is_highlight of what mirrors throw, None where none does. Neighbours share it: comparing them asks for the other alone.
    is_thrown_highlight: Bool[np.ndarray, "photo point"] | None = None
    blocked_share: tuple[float, ...] = ()  # of what each photograph's lights reach: left out, in a shadow of nothing known

    @property
    def is_dark(self) -> Bool[np.ndarray, " photo"]:
        """Photographs taken with every light off."""
        return np.array([len(lights) == 0 for lights in self.lights], dtype=bool)

    @property
    def is_reached(self) -> Bool[np.ndarray, "photo point"]:
        """Where a light is seen, itself or in a mirror that throws it."""
        return self.is_lit | self.is_thrown

    @property
    def is_thrown(self) -> Bool[np.ndarray, "photo point"]:
        """Where a light is seen in a mirror that throws it."""
        return np.zeros_like(self.is_lit) if self.thrown is None else self.thrown.max(axis=(0, 3)) > 0

    @property
    def ambient(self) -> Float32[np.ndarray, "photo point 3"] | None:
        """What a photograph with every light off shows, normalised as each photograph is; None without one."""
        dark = np.flatnonzero(self.is_dark)
        if len(dark) == 0:
            return None
        return self.radiance[dark[0]] * (self.scale[dark[0]] / self.scale).astype(np.float32)[:, None]


# --------------------------------------------------------------------------------------- what is recovered

KINDS = ("diffuse", "textured", "glossy", "mirror")


@dataclass(frozen=True, eq=False)
class Health:
    """Status, rank and condition of one family of solves, one entry per face, vertex, pixel or surface.

    Status codes are those of maths.least_squares.Status; `fallback` says what a bad one was replaced by.
    """

    site: str  # "surface", "face", "vertex", "pixel" or "light"
    status: Int8[np.ndarray, " site"]
    rank: Int32[np.ndarray, " site"]
    condition: Float32[np.ndarray, " site"]
    residual: Float32[np.ndarray, " site"]
    fallback: str = ""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The regions of one material: which face belongs to which, and what kind each is.

    `kinds` holds, per surface, a tuple of words of KINDS: a surface can be textured and glossy at once.
    `evidence` holds the numbers the words were decided by, per surface.
    """

    surface_of_face: Int32[np.ndarray, " face"]
    names: tuple[str, ...]
    kinds: tuple[tuple[str, ...], ...]
    evidence: tuple[Mapping[str, float], ...] = ()

    @property
    def num_surfaces(self) -> int:
        return len(self.names)

    def which(self, kind: str) -> Bool[np.ndarray, " surface"]:
        """True for the surfaces of a kind."""
        return np.array([kind in kinds for kinds in self.kinds], dtype=bool)


@dataclass(frozen=True, eq=False)
class Mirror:
    """A mirror surface: its plane (centred coordinates; normal to the reflecting side) and its reflectance.

    `curvature` says whether the plane is only a mean: a gently curved mirror reflects with its own normals and
    throws no sharp patch. `score` is the edge correlation it was accepted with (1.1.3).
    """

    surface: int
    point: Float64[np.ndarray, "3"]
    normal: Float64[np.ndarray, "3"]
    reflectance: Float64[np.ndarray, "3"]
    is_plane: bool
    radius: float  # of the disc about `point` that holds the mirror
    throws_light: bool
    score: float


@dataclass(frozen=True, eq=False)
class Lobe:
    """One Lafortune lobe, eq. (4): color * max(0, c_x u_x v_x + c_y u_y v_y + c_z u_z v_z) ** exponent.

    u and v are the unit directions to the light and to the viewer in the frame of the normal; the lobe is scaled so
    that |c| = 1 in its strongest component and `color` carries the rest. `tangent` (centred coordinates, zero for an
    isotropic lobe) is projected to each point's tangent plane. One that `is_halfway` is about the half-way direction
    instead, color * (1 / (c_x h_x^2 + c_y h_y^2 + c_z h_z^2)) ** exponent, round, or brushed (c_x != c_y) with the tangent
    tangent + turn x p at a position p (maths.halfway).
    """

    color: Float64[np.ndarray, "3"]
    axes: Float64[np.ndarray, "3"]  # c_x, c_y, c_z
    exponent: float
    tangent: Float64[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    turn: Float64[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    is_halfway: bool = False


@dataclass(frozen=True, eq=False)
class Indirect:
    """Indirect and ambient irradiance: low-order functions of the light at each site, eq. (7).

    irradiance(site, light) = max(0, ambient + strength(light) * coefficients . basis(direction to the light)).
    `site` is "face", "vertex" or "pixel". `anchors` are the photographed directions from the scene's middle: a light
    farther than `reach_rad` from all of them is read at the nearest place within reach, so nothing runs away.
    """

    basis: str
    site: str
    coefficients: Float32[np.ndarray, "site basis 3"]
    ambient: Float32[np.ndarray, "site 3"]
    anchors: Float64[np.ndarray, "light 3"]
    reach_rad: float
    softening: float  # a lamp nearer than this counts as at this distance, in the capture's unit
    ambient_is_separate: bool  # measured apart from the indirect light, or a stated prior


@dataclass(frozen=True, eq=False)
class Residual:
    """What the model misses at each captured pixel, as a function of the light that dies away between photographs.

    A pixel misses one thing in the light (a normal, a lobe) and another in shadow (the indirect light), so there are two
    sets of modes, blended by how far the light is seen:
    radiance += strength(light) * sum_k modes[pixel, k] * (weights[k] . kernel(light, anchors)).
    Modes are in whole steps that nobody sees; the weights hold the unit.
    """

    lit_modes: Int16[np.ndarray, "pixel lit 3"] | Float32[np.ndarray, "pixel lit 3"]  # float32: in files of earlier versions
    lit_weights: Float64[np.ndarray, "lit light"]
    dark_modes: Int16[np.ndarray, "pixel dark 3"] | Float32[np.ndarray, "pixel dark 3"]
    dark_weights: Float64[np.ndarray, "dark light"]
    anchors: Float64[np.ndarray, "light 3"]
    lit_length_rad: float
    dark_length_rad: float


@dataclass(frozen=True, eq=False)
class Background:
    """The unmodelled surroundings as mirrors show them: low-order functions of the light at each pixel that sees them.

    In the functions of `Indirect`, but of radiance, not irradiance. `toward` is the reflected direction, by which another
    viewpoint finds the pixel that looked most nearly the same way.
    """

    pixel: Int32[np.ndarray, " miss"]
    toward: Float32[np.ndarray, "miss 3"]
    coefficients: Float32[np.ndarray, "miss basis 3"]
    ambient: Float32[np.ndarray, "miss 3"]


@dataclass(frozen=True, eq=False)
class PixelMap:
    """What is known per pixel of the captured view: the recovered texture, normals and where they came from."""

    points: ShadingPoints  # the primary hits, before detail
    surface: Int32[np.ndarray, " point"]
    albedo: Float32[np.ndarray, "point 3"]
    normal: Float32[np.ndarray, "point 3"]  # with detail
    lobe_gain: Float32[np.ndarray, " point"]  # detail of the lobe: a factor on its colour, 1 where none
    num_lit: Int32[np.ndarray, " point"]  # photographs in which the light was seen there


@dataclass(frozen=True, eq=False)
class Decision:
    """One line of the plan: an effect on one surface (-1: the whole scene), and the evidence."""

    effect: str
    surface: int
    is_on: bool
    gain_db: float  # how much left-out photographs gain by the effect
    noise_db: float  # how much of a gain is within their own scatter
    reason: str


@dataclass(frozen=True)
class Price:
    """One setting of the frames: what it loses against the exact one, and the work that one frame of it takes.

    Work is counted, not timed: the same capture gives the same list on every machine, and a few frames timed where it
    is used turn the counts into milliseconds (relight.budget).
    """

    name: str
    options: Mapping[str, object]  # of RelightOptions, where they differ from the exact setting's
    error_db: float  # by how much left-out photographs would be missed more than by the exact setting
    psnr_db: float  # what left-out photographs would be reached with
    work: Mapping[str, int]  # rays by kind, points, lobes, modes and sites of a frame under one light


@dataclass(frozen=True, eq=False)
class RelightModel:
    """Everything needed to relight a scene, and to say how far to trust it."""

    camera: Camera
    mesh: PatchMesh
    surfaces: Surfaces
    pixels: PixelMap
    surface_albedo: Float64[np.ndarray, "surface 3"]
    indirect: Indirect | None
    residual: Residual | None
    background: Background | None
    lobes: tuple[tuple[Lobe, ...], ...]  # per surface
    mirrors: tuple[Mirror, ...]
    lights: tuple[tuple[Light, ...], ...]  # of the training photographs, world coordinates
    exposure: float
    decisions: tuple[Decision, ...]
    health: Mapping[str, Health]
    warnings: tuple[str, ...] = ()
    settings: Mapping[str, object] = field(default_factory=dict)
    prices: tuple[Price, ...] = ()  # settings of the frames, the exact one first
    outlines_end: Literal["black", "object"] = "object"  # what a pixel shows beside the mesh: nothing, or more of it
    vertex_albedo: Float32[np.ndarray, "vertex 3"] | None = None  # what holds where no captured pixel knows
    seconds: Mapping[str, float] = field(default_factory=dict, compare=False)

    @cached_property
    def albedo_unseen(self) -> Float32[np.ndarray, "vertex 3"]:
        """The albedo of each vertex where no captured pixel knows it: its surface's, unless the model says more."""
        if self.vertex_albedo is not None:
            return self.vertex_albedo
        out = np.zeros((len(self.mesh.vertices), 3), np.float32)
        out[self.mesh.faces.ravel()] = np.repeat(self.surface_albedo[self.surfaces.surface_of_face], 3, axis=0)
        return out

    def save(self, path: str | Path) -> None:
        """Write the model file (under a temporary name, then renamed)."""
        from relight3d.io.model_file import save_model

        save_model(self, path)

    def __repr__(self) -> str:
        return (
            f"RelightModel({self.camera.width}x{self.camera.height} px, {len(self.mesh.faces)} faces, "
            f"{self.surfaces.num_surfaces} surfaces, {len(self.lights)} photographs)"
        )

    def _repr_html_(self) -> str:
        from relight3d.display.notebook import html_of_model

        return html_of_model(self)


# ------------------------------------------------------------------------------------------------ frames


@dataclass(frozen=True, eq=False)
class Terms:
    """The parts a frame is the sum of; each is linear radiance, None where the plan left the effect out."""

    direct: Float32[np.ndarray, "height width 3"] | None
    specular: Float32[np.ndarray, "height width 3"] | None
    indirect: Float32[np.ndarray, "height width 3"] | None
    mirror: Float32[np.ndarray, "height width 3"] | None


@dataclass(frozen=True, eq=False)
class Stats:
    """Where a frame's time and rays went, by effect, and what was given up for a budget."""

    milliseconds: Mapping[str, float]
    rays: Mapping[str, int]
    settings: Mapping[str, object] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def total_ms(self) -> float:
        return float(sum(self.milliseconds.values()))

    @property
    def num_rays(self) -> int:
        return int(sum(self.rays.values()))


@dataclass(frozen=True, eq=False)
class Frame:
    """A relit frame: linear radiance, its terms, where it hit the mesh, and its cost."""

    radiance: Float32[np.ndarray, "height width 3"]
    is_hit: Bool[np.ndarray, "height width"]
    exposure: float  # the capture's: multiply, clip and encode to show
    stats: Stats
    _terms: "Terms | Callable[[], Terms] | None" = None  # computed when asked for, since a live viewer seldom asks

    @property
    def terms(self) -> Terms:
        """direct, specular, indirect and mirror radiance; they add up to `radiance`."""
        found = self._terms() if callable(self._terms) else self._terms
        assert found is not None, "a frame is made with its terms, or with the way to them"
        return found

    def __repr__(self) -> str:
        height, width = self.is_hit.shape
        return f"Frame({width}x{height} px, {self.stats.total_ms:.1f} ms, {self.stats.num_rays:,} rays)"

    def _repr_html_(self) -> str:
        from relight3d.display.notebook import html_of_frame

        return html_of_frame(self)

"""What the rounds share (Stage), what is fitted so far (Fitted), and why (Evidence)."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from relight3d.camera import Camera
from relight3d.effects import forced_states
from relight3d.maths.least_squares import Solution
from relight3d.records import Lobe, Mirror, Observations, PatchMesh, ShadingPoints, Surfaces
from relight3d.recover import bounce, diffuse, indirect, sites
from relight3d.recover.surfaces import neighbours
from relight3d.tracing import RayScene

if TYPE_CHECKING:
    from relight3d.recover.run import RecoverOptions

EDGE_TRUST = 0.03  # of a pixel on an outline, which mixes two surfaces: enough to fill it, too little to decide
SCENE_NOISE_DB = 0.1  # what a gain of the whole scene must exceed
ANY_GAIN = -1e9  # dB: the threshold of what a person forced on


@dataclass(frozen=True, eq=False)
class Stage:
    """What stays the same through all rounds."""

    options: "RecoverOptions"
    mesh: PatchMesh
    rays: RayScene
    camera: Camera
    points: ShadingPoints
    surfaces: Surfaces
    surface: np.ndarray  # of each point
    panel_of_face: np.ndarray  # smooth pieces of surfaces
    is_matte: np.ndarray  # point: not on a mirror
    hear: sp.csr_matrix  # sites hear their own points
    gather: sp.csr_matrix  # and their neighbours' too
    spread: sp.csr_matrix  # points read sites
    transport: bounce.Transport | None  # between surfaces; None where none sees another
    anchors: np.ndarray
    softening: float
    white: float  # the radiance that shows as white, in normalised photographs
    forced: Mapping[tuple[str, int], bool] = field(default_factory=dict)  # effects that a person switched

    @cached_property
    def near(self) -> np.ndarray:
        """Pairs of neighbouring points, once for all rounds."""
        return neighbours(self.points, self.camera)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Why an effect is on or off: what left-out photographs gain by it, and how much of a gain is chance."""

    gain_db: float
    noise_db: float
    reason: str


@dataclass(frozen=True, eq=False)
class Fitted:
    """What is fitted so far; arrays per photograph are normalised."""

    albedo: np.ndarray  # point x 3
    surface_albedo: np.ndarray  # surface x 3
    irradiance: np.ndarray  # photo x point x 3: indirect and ambient
    specular: np.ndarray | None  # photo x point x 3: lobes; None while there are none
    normal: np.ndarray  # point x 3
    lobe_gain: np.ndarray  # point
    lobes: tuple[tuple[Lobe, ...], ...]
    is_textured: np.ndarray  # surface: its texture is kept per pixel
    texture_shows: np.ndarray  # surface: the difference measure calls it textured
    design: indirect.LightDesign | None = None
    solution: Solution | None = None
    bounced: bounce.Bounced | None = None  # what surfaces send one another, which the solution is beside
    sent: np.ndarray | None = None  # photo x point x 3: that light at the points, a part of the irradiance
    border: Solution | None = None
    joint: Solution | None = None
    owner: np.ndarray | None = None  # point: whose scale it has, a surface's or a panel's
    lobe_fits: tuple = ()
    trust: np.ndarray | None = None  # photo x point: robust weights
    blocked: tuple[int, ...] = ()  # photographs that an unmodelled blocker or lamp spoils
    scale_words: tuple[str, ...] = ()
    evidence: dict[tuple[str, int], Evidence] = field(default_factory=dict)


def set_stage(
    options: "RecoverOptions",
    mesh: PatchMesh,
    rays: RayScene,
    camera: Camera,
    points: ShadingPoints,
    surfaces: Surfaces,
    mirrors: tuple[Mirror, ...],
    observed: Observations,
    exposure: float,
) -> Stage:
    """All that the rounds share: who hears whom, and in which units."""
    surface = surfaces.surface_of_face[points.face]
    is_matte = ~np.isin(surface, [m.surface for m in mirrors])
    site = options.indirect.site
    binding = sites.site_binding(mesh, points, site)
    heard = binding.tocsc(copy=True)
    heard.data *= np.repeat(is_matte & observed.is_interior, np.diff(heard.indptr))
    heard = heard.tocsr()
    heard.eliminate_zeros()
    anchors = indirect.light_anchors(observed)
    return Stage(
        options=options,
        mesh=mesh,
        rays=rays,
        camera=camera,
        points=points,
        surfaces=surfaces,
        surface=surface,
        panel_of_face=diffuse.panels_of(mesh, surfaces.surface_of_face),
        is_matte=is_matte,
        hear=heard,
        gather=sites.spread_over_neighbours(mesh, heard, site, options.indirect.smoothing_px),
        spread=binding.T.tocsr(),
        transport=bounce.trace_transport(
            rays,
            mesh,
            surfaces.surface_of_face,
            points,
            is_matte & observed.is_interior,
            sites.site_vertices(mesh, points, site),
            bounce.lights_to_try(observed.lights, anchors, indirect.reach_of(anchors), options.bounce.num_lights),
            mirrors,
            options.bounce,
        ),
        anchors=anchors,
        softening=0.5 * mesh.radius,
        white=1.0 / (exposure * float(np.median(observed.scale))),
        forced=forced_states(surfaces.names, options.force),
    )


def start(stage: Stage, observed: Observations) -> Fitted:
    """Nothing fitted yet."""
    num, num_surfaces = len(stage.points), stage.surfaces.num_surfaces
    return Fitted(
        albedo=np.full((num, 3), 0.5, np.float32),
        surface_albedo=np.full((num_surfaces, 3), 0.5),
        irradiance=np.zeros_like(observed.radiance),
        specular=None,
        normal=stage.points.normal,
        lobe_gain=np.ones(num, np.float32),
        lobes=((),) * num_surfaces,
        is_textured=np.ones(num_surfaces, bool),
        texture_shows=np.zeros(num_surfaces, bool),
    )


def edge_trust(observed: Observations) -> np.ndarray:
    """How far each point is believed, as a column: all the way inside, next to nothing on an outline."""
    return np.where(observed.is_interior, 1.0, EDGE_TRUST)[:, None]


def without_blocked(observed: Observations, fitted: Fitted) -> Observations:
    """The photographs without those that a blocker or a stray lamp spoils, of at most a quarter of all.

    What such a photograph adds to the fits is less than what it spoils: lobes, detail and residual would explain it.
    """
    if not 0 < len(fitted.blocked) <= len(observed.lights) // 4:
        return observed
    weight = observed.weight.copy()
    weight[list(fitted.blocked)] = 0.0
    return replace(observed, weight=weight)

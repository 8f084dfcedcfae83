"""What each scene is made of: metres, z up, the table top at z = 0. Every number of a capture stands here."""

from dataclasses import dataclass, field

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """One surface. `albedo` is the whole diffuse albedo, `lobe_reflectance` the whole weight of the GGX lobe."""

    kind: str  # diffuse | textured | glossy | mirror
    albedo: Triple = (0.0, 0.0, 0.0)  # of a textured surface: the mean colour that the pattern varies
    lobe_reflectance: float = 0.0  # Fresnel is constant: no rise towards grazing
    lobe_alpha: float = 0.0  # GGX roughness, isotropic
    mirror_reflectance: Triple = (0.0, 0.0, 0.0)
    has_relief: bool = False


@dataclass(frozen=True)
class Thing:
    """One object of the mesh: its id is its place in the list."""

    name: str
    shape: str  # slab | box | sphere | vase | capsule | panel_front | panel_back
    at: Triple  # middle of its foot (a slab: middle of its top)
    size: Triple  # full extents
    turn_deg: float  # about z
    cells: int  # tessellation: cells along an edge or around the axis
    material: Material


@dataclass(frozen=True)
class Wall:
    """A rectangle of the unknown surroundings, not in the mesh: middle, the two half edges, one side reflects."""

    name: str
    middle: Triple
    half_u: Triple
    half_v: Triple  # it faces half_u x half_v
    albedo: Triple
    radiance: Triple = (0.0, 0.0, 0.0)  # an emitter where not zero


@dataclass(frozen=True)
class Relief:
    """Band-limited bumps of the table top, in the photographs only: the mesh is flat there."""

    shortest_m: float = 0.018
    longest_m: float = 0.045
    slope_deg: float = 2.6  # root mean square along each axis; the median tilt is 1.18 times this
    texel_m: float = 0.002
    seed: int = 5


@dataclass(frozen=True)
class View:
    eye: Triple
    target: Triple
    width_px: int
    height_px: int
    focal_px: float


@dataclass(frozen=True)
class LampSettings:
    kind: str = "directional"  # | point
    num_train: int = 24
    num_test: int = 8
    lowest_deg: float = 25.0
    highest_deg: float = 80.0
    lowest_test_deg: float = 33.0
    strength: float = 3.0  # irradiance at the target, before the frame's own factor of 0.7 to 1.3
    distances_m: tuple[float, float] = (1.5, 2.5)  # point lamps only
    num_two_lights: int = 2
    new_view_turns_deg: tuple[float, ...] = (10.0, -20.0)
    seed: int = 11


@dataclass(frozen=True)
class SceneSettings:
    name: str
    things: tuple[Thing, ...]
    walls: tuple[Wall, ...]
    view: View
    lamps: LampSettings = field(default_factory=LampSettings)
    relief: Relief = field(default_factory=Relief)
    samples: int = 448  # per pixel, of each lamp alone
    ambient_samples: int = 1536  # of the lights-off picture, which is in every photograph
    chunk: int = 64  # samples of one resumable step
    max_depth: int = 8  # surfaces on a path
    seed: int = 1


TABLE = Material("glossy", (0.34, 0.27, 0.20), lobe_reflectance=0.10, lobe_alpha=0.22, has_relief=True)
BRONZE = Material("mirror", mirror_reflectance=(0.75, 0.55, 0.35))
DARK_BACK = Material("diffuse", (0.09, 0.08, 0.07))


def desk_things(fineness: float) -> tuple[Thing, ...]:
    """The desk's objects; `fineness` 1 gives about 12,000 faces, 0.35 about 1,500."""

    def cells(count: int) -> int:
        return max(2, round(count * fineness))

    mirror = dict(at=(-0.21, 0.33, -0.001), size=(0.50, 0.014, 0.26), turn_deg=20.0)
    return (
        Thing("table", "slab", (0, 0.04, 0), (1.24, 1.14, 0.03), 0, cells(36), TABLE),
        Thing("box", "box", (0.18, 0.22, -0.001), (0.16, 0.16, 0.20), 25, cells(9),
              Material("diffuse", (0.62, 0.24, 0.16))),
        Thing("tea_box", "box", (-0.20, -0.05, -0.001), (0.20, 0.15, 0.12), -20, cells(9),
              Material("textured", (0.45, 0.42, 0.38))),
        Thing("ball", "sphere", (0.065, 0.005, 0.0), (0.15, 0.15, 0.15), 0, cells(44),
              Material("diffuse", (0.70, 0.60, 0.18))),
        Thing("vase", "vase", (0.35, -0.04, 0.0), (0.15, 0.15, 0.27), 0, cells(44),
              Material("diffuse", (0.34, 0.58, 0.54))),
        Thing("glazed_ball", "sphere", (0.03, -0.25, 0.0), (0.10, 0.10, 0.10), 0, cells(40),
              Material("glossy", (0.07, 0.12, 0.36), lobe_reflectance=0.08, lobe_alpha=0.10)),
        Thing("mirror", "panel_front", cells=cells(8), material=BRONZE, **mirror),
        Thing("mirror_back", "panel_back", cells=cells(4), material=DARK_BACK, **mirror),
    )  # fmt: skip


ROOM = (
    Wall("back_wall", (0, 1.5, -0.175), (1.7, 0, 0), (0, 0, 0.575), (0.60, 0.48, 0.24)),
    Wall("left_wall", (-1.7, 0.1, -0.165), (0, 1.4, 0), (0, 0, 0.585), (0.70, 0.20, 0.15)),
    Wall("right_wall", (1.7, 0.1, -0.165), (0, -1.4, 0), (0, 0, 0.585), (0.20, 0.50, 0.60)),
    Wall("floor", (0, -0.3, -0.75), (1.7, 0, 0), (0, 1.8, 0), (0.35, 0.33, 0.30)),
    Wall("part_ceiling", (0, -1.75, 1.6), (-0.9, 0, 0), (0, 0.5, 0), (0.70, 0.70, 0.70)),
    Wall("warm_lamp", (0.1, -1.5, 1.59), (-0.3, 0, 0), (0, 0.2, 0), (0, 0, 0), (2.6, 1.9, 1.2)),
    Wall("cool_window", (-1.69, 0.1, 0.21), (0, 0.6, 0), (0, 0, 0.18), (0, 0, 0), (0.55, 0.8, 1.15)),
)

DESK = SceneSettings(
    "desk", desk_things(1.0), ROOM, View((0.0, -0.96, 1.02), (0.0, 0.035, 0.03), 400, 300, 560.0),
)  # fmt: skip

TINY = SceneSettings(
    "tiny", desk_things(0.35), ROOM, View((0.0, -0.96, 1.02), (0.0, 0.035, 0.03), 64, 48, 560.0 * 64 / 400),
    lamps=LampSettings(num_train=12, num_test=4, new_view_turns_deg=(10.0,), num_two_lights=0),
    relief=Relief(shortest_m=0.09, longest_m=0.2, slope_deg=2.6), samples=1024, ambient_samples=16384, chunk=256,
)  # fmt: skip

POINTS = SceneSettings(
    "points",
    (
        Thing("table", "slab", (0, 0, 0), (1.30, 1.0, 0.04), 0, 32,
              Material("glossy", (0.22, 0.26, 0.30), lobe_reflectance=0.07, lobe_alpha=0.16, has_relief=True)),
        Thing("crate", "box", (-0.24, 0.10, -0.001), (0.18, 0.18, 0.16), 35, 8,
              Material("textured", (0.48, 0.40, 0.30))),
        Thing("capsule", "capsule", (0.06, 0.17, 0.0), (0.13, 0.13, 0.30), 0, 44,
              Material("diffuse", (0.20, 0.30, 0.62))),
        Thing("vase", "vase", (-0.06, -0.16, 0.0), (0.12, 0.12, 0.19), 0, 44, Material("diffuse", (0.66, 0.62, 0.58))),
        Thing("brass_ball", "sphere", (0.22, -0.14, 0.0), (0.13, 0.13, 0.13), 0, 44,
              Material("glossy", (0.30, 0.20, 0.06), lobe_reflectance=0.18, lobe_alpha=0.14)),
        Thing("mirror", "panel_front", (0.33, 0.25, -0.001), (0.40, 0.014, 0.30), -32, 7,
              Material("mirror", mirror_reflectance=(0.82, 0.80, 0.74))),
        Thing("mirror_back", "panel_back", (0.33, 0.25, -0.001), (0.40, 0.014, 0.30), -32, 4, DARK_BACK),
        Thing("block", "box", (-0.24, -0.19, -0.001), (0.13, 0.09, 0.09), 10, 7,
              Material("diffuse", (0.20, 0.52, 0.22))),
    ),
    ROOM, View((0.05, -0.95, 0.95), (0.02, 0.04, 0.05), 320, 240, 450.0),
    lamps=LampSettings(kind="point", num_train=16, num_test=6, seed=23, num_two_lights=1),
    relief=Relief(seed=8), samples=256, ambient_samples=1024, seed=2,
)  # fmt: skip

PLAIN = SceneSettings(
    "plain",
    (
        Thing("ball", "sphere", (-0.17, 0.0, 0.0), (0.28, 0.28, 0.28), 0, 96, Material("diffuse", (0.60, 0.35, 0.22))),
        Thing("box", "box", (0.18, 0.05, 0.0), (0.22, 0.22, 0.26), 30, 12, Material("diffuse", (0.30, 0.45, 0.60))),
    ),
    (), View((0.0, -1.0, 0.62), (0.0, 0.0, 0.13), 320, 240, 500.0),
    lamps=LampSettings(num_train=12, num_test=4, num_two_lights=0, new_view_turns_deg=(), seed=31),
    samples=256, ambient_samples=0, seed=3,
)  # fmt: skip

SCENES = {scene.name: scene for scene in (DESK, TINY, POINTS, PLAIN)}

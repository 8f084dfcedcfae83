"""What a recovery of a synthetic scene should find."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32

from relight3d.evaluate.scenes import Scene
from relight3d.evaluate.world import World
from relight3d.lights import Light
from relight3d.records import Indirect, PixelMap, RelightModel, Surfaces
from relight3d.shading import points_seen


@dataclass(frozen=True, eq=False)
class Truth:
    """What a recovery of the captured view should find; zero and -1 where a pixel misses the mesh."""

    albedo: Float32[np.ndarray, "height width 3"]
    normal: Float32[np.ndarray, "height width 3"]
    object_id: Int32[np.ndarray, "height width"]

    @property
    def is_hit(self) -> Bool[np.ndarray, "height width"]:
        return self.object_id >= 0


def truth_of(scene: Scene) -> Truth:
    """The albedo, the normals (with relief) and the objects that the scene's camera sees."""
    world, camera = World(scene), scene.camera
    points = points_seen(world.rays, world.mesh, camera)
    albedo, normal = np.zeros((2, camera.num_pixels, 3), np.float32)
    object_id = np.full(camera.num_pixels, -1, np.int32)
    albedo[points.pixel], normal[points.pixel] = world.albedo(points), world.normal(points)
    object_id[points.pixel] = world.object_of_face[points.face]
    size = (camera.height, camera.width)
    return Truth(albedo.reshape(*size, 3), normal.reshape(*size, 3), object_id.reshape(size))


def true_model(scene: Scene, lights: Sequence[Sequence[Light]] = (), exposure: float = 1.0) -> RelightModel:
    """The model that a perfect recovery from photographs under `lights` would give, one surface for each object.

    It has the ambient light and no interreflections: those have no exact low-order form.
    """
    world = World(scene)
    points = points_seen(world.rays, world.mesh, scene.camera)
    surface = world.object_of_face[points.face]
    names = world.mesh.object_names or {}
    num_faces = len(world.mesh.faces)
    ambient = np.broadcast_to(np.asarray(scene.ambient, np.float32), (num_faces, 3)).copy()
    no_coefficients = np.zeros((num_faces, 1, 3), np.float32)
    up = np.array([[0.0, 0.0, 1.0]])
    return RelightModel(
        camera=scene.camera,
        mesh=world.mesh,
        surfaces=Surfaces(
            world.object_of_face,
            tuple(names.get(key, f"surface {key}") for key in range(len(scene.materials))),
            tuple(material.kinds for material in scene.materials),
        ),
        pixels=PixelMap(
            points=points,
            surface=surface,
            albedo=world.albedo(points),
            normal=world.normal(points),
            lobe_gain=np.ones(len(points), np.float32),
            num_lit=np.full(len(points), len(lights), np.int32),
        ),
        surface_albedo=np.array([material.albedo for material in scene.materials]),
        indirect=Indirect("constant", "face", no_coefficients, ambient, up, np.pi, 1e-6, True),
        residual=None,
        background=None,
        lobes=tuple(material.lobes for material in scene.materials),
        mirrors=world.mirrors,
        lights=tuple(tuple(each) for each in lights),
        exposure=exposure,
        decisions=(),
        health={},
    )

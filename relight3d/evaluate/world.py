"""A synthetic scene made ready for rays, and what its materials are at each point."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32

from relight3d.evaluate.scenes import Scene
from relight3d.lights import Light
from relight3d.maths.lafortune import tangent_frame
from relight3d.records import MeshReport, Mirror, PatchMesh, ShadingPoints, TriangleMesh
from relight3d.shading import cast_light, lobe_brdf, mirrored_light, ray_scene


class World:
    """A scene made ready for rays, and its materials by point."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.mesh = _patch_mesh(scene.mesh)
        self.rays = ray_scene(self.mesh)
        ids = scene.mesh.object_id
        self.object_of_face = np.zeros(len(scene.mesh.faces), np.int32) if ids is None else ids
        self.mirrors = tuple(self._mirror(key) for key, m in enumerate(scene.materials) if m.mirror > 0)

    def albedo(self, points: ShadingPoints) -> Float32[np.ndarray, "point 3"]:
        albedo = np.zeros((len(points), 3), np.float32)
        for key, material in enumerate(self.scene.materials):
            mine = np.flatnonzero(self.object_of_face[points.face] == key)
            albedo[mine] = material.albedo
            if material.checker_albedo is not None:
                square = np.floor(self._uv(points.take(mine)) * material.num_checkers).astype(int)
                albedo[mine[square.sum(axis=1) % 2 == 1]] = material.checker_albedo
        return albedo

    def normal(self, points: ShadingPoints) -> Float32[np.ndarray, "point 3"]:
        """Shading normals, tilted by the materials' relief."""
        normal = points.normal.copy()
        for key, material in enumerate(self.scene.materials):
            mine = np.flatnonzero(self.object_of_face[points.face] == key)
            if material.relief_slope and len(mine):
                wave = np.cos(2 * np.pi * material.num_waves * self._uv(points.take(mine))) * material.relief_slope
                tangent, bitangent = tangent_frame(normal[mine])
                tilted = normal[mine] - wave[:, :1] * tangent - wave[:, 1:] * bitangent
                normal[mine] = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
        return normal

    def lit(
        self, points: ShadingPoints, lights: Sequence[Light]
    ) -> tuple[Float32[np.ndarray, "point 3"], Float32[np.ndarray, "point 3"]]:
        """Direct irradiance and the lobes' radiance under centred lights, with the light that mirrors throw."""
        normal = self.normal(points)
        irradiance, specular = np.zeros((2, len(points), 3), np.float32)
        for light in lights:
            lit = cast_light(self.rays, points, light, normal, self.mirrors, self.object_of_face)
            power = light.power.astype(np.float32)
            irradiance += lit.form[:, None] * power
            specular += self._specular(points, normal, lit.to_light, lit.form) * power
            for mirror, form in zip(self.mirrors, lit.thrown if lit.thrown is not None else ()):
                thrown = power * mirror.reflectance.astype(np.float32)
                to_lamp = mirrored_light(light, mirror).incident(points.position).to_light
                irradiance += form[:, None] * thrown
                specular += self._specular(points, normal, to_lamp, form) * thrown
        return irradiance, specular

    def _specular(
        self, points: ShadingPoints, normal: np.ndarray, to_light: np.ndarray, form: np.ndarray
    ) -> Float32[np.ndarray, "point 3"]:
        """The lobes' radiance for a light of power 1."""
        radiance = np.zeros((len(points), 3), np.float32)
        for key, material in enumerate(self.scene.materials):
            mine = np.flatnonzero((self.object_of_face[points.face] == key) & (form > 0)) if material.lobes else ()
            if len(mine):
                brdf = lobe_brdf(
                    material.lobes, normal[mine], to_light[mine], points.to_viewer[mine], points.position[mine]
                )
                radiance[mine] = brdf * form[mine, None]
        return radiance

    def _uv(self, points: ShadingPoints) -> Float32[np.ndarray, "point 2"]:
        uvs = self.mesh.corner_uvs
        assert uvs is not None, "a checkered or waved material needs UVs"
        return np.einsum("pk,pku->pu", points.barycentric, uvs[points.face])

    def _mirror(self, key: int) -> Mirror:
        """The plane through all of an object's vertices."""
        faces = self.mesh.faces[self.object_of_face == key]
        corners = self.mesh.centered_vertices[np.unique(faces)].astype(np.float64)
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        normal = self.mesh.face_normals[self.object_of_face == key].mean(axis=0).astype(np.float64)
        reflectance = np.full(3, self.scene.materials[key].mirror)
        radius = float(np.linalg.norm(corners - middle, axis=1).max())
        return Mirror(key, middle, normal / np.linalg.norm(normal), reflectance, True, radius, True, 1.0)


def _patch_mesh(mesh: TriangleMesh) -> PatchMesh:
    """The mesh as it is: not cleaned, not subdivided."""
    assert mesh.vertex_normals is not None, "synthetic meshes have normals"
    _, welded = np.unique(mesh.vertices, axis=0, return_inverse=True)
    report = MeshReport(len(mesh.faces), len(mesh.faces))
    return PatchMesh(
        vertices=mesh.vertices,
        faces=mesh.faces,
        vertex_normals=mesh.vertex_normals,
        welded_vertex=welded.ravel().astype(np.int32),
        parent_face=np.arange(len(mesh.faces), dtype=np.int32),
        object_id=mesh.object_id,
        corner_uvs=mesh.corner_uvs,
        object_names=mesh.object_names,
        report=report,
    )

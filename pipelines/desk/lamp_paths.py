"""The path tracer of one lamp alone, as a Mitsuba integrator (`variant.choose` comes first).

It is Mitsuba's path tracer (its rays, BSDFs, emitters, samplers) with one addition: at every surface point of a path,
beside the lamp itself, the lamp's image in the plane mirror is sampled too. A path tracer cannot find that image by
chance, for the lamp is a point and the mirror is smooth, so the light that the mirror throws would be missing. The
image is seen only through the mirror's outline, from its front; the lamp must be seen from the point of reflection.
Nothing is counted twice: paths continue through the mirror by sampling, but those never meet a lamp without extent.

Three parts come out: `direct` (lamp on the first surface seen), `thrown` (the same by way of the mirror), and the rest,
which includes all that is seen in the mirror. The picture is their sum.
"""

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

ROULETTE_FROM = 3
FAR_M = 1e6
LIFT_M = 1e-4  # a reflection's shadow ray starts this far in front of the mirror


@dataclass(frozen=True)
class MirrorPlane:
    """The plane mirror's rectangle, in world coordinates."""

    middle: np.ndarray
    normal: np.ndarray
    axis_u: np.ndarray  # unit
    axis_v: np.ndarray
    half_u: float
    half_v: float
    reflectance: np.ndarray


class LampPaths(mi.SamplingIntegrator):
    def __init__(self, mirror: MirrorPlane | None, position: np.ndarray | None, to_light: np.ndarray, max_depth: int):
        """One lamp of unit irradiance, or of unit intensity at `position`; the scene holds the same as its emitter."""
        super().__init__(mi.Properties())
        self.mirror, self.is_point, self.max_depth = mirror, position is not None, max_depth
        place = np.asarray(position if self.is_point else to_light, float)
        self.lamp = opaque(place)
        if mirror is not None:
            # A direction is mirrored in the plane through the origin, a position in the mirror's own.
            origin = mirror.middle if self.is_point else np.zeros(3)
            self.image = opaque(place - 2 * ((place - origin) @ mirror.normal) * mirror.normal)
            self.middle, self.normal = opaque(mirror.middle), opaque(mirror.normal)
            self.axis_u, self.axis_v = opaque(mirror.axis_u), opaque(mirror.axis_v)
            self.reflectance = mi.Color3f(mirror.reflectance)

    def aov_names(self):
        return [f"{part}.{channel}" for part in ("direct", "thrown") for channel in "RGB"]

    def lamp_light(self, scene, si, bsdf, active):
        """Light of the lamp itself that the surface sends back along the ray."""
        sample, irradiance = scene.sample_emitter_direction(si, mi.Point2f(0.5), True, active)
        return irradiance * bsdf.eval(mi.BSDFContext(), si, si.to_local(sample.d), active)

    def thrown_light(self, scene, si, bsdf, active):
        """Light of the lamp's image in the mirror that the surface sends back along the ray."""
        to_image = self.image - si.p if self.is_point else mi.Vector3f(self.image)
        squared = dr.squared_norm(to_image) if self.is_point else 1.0
        to_image = dr.normalize(to_image)
        towards = dr.dot(to_image, self.normal)
        front = dr.dot(si.p - self.middle, self.normal)
        distance = front / dr.select(towards < -1e-6, -towards, 1.0)
        hit = si.p + distance * to_image - self.middle
        # Never &= here: Dr.Jit would change the caller's mask too.
        active = active & (front > 1e-5) & (towards < -1e-6)
        active = active & (dr.abs(dr.dot(hit, self.axis_u)) < self.mirror.half_u)
        active = active & (dr.abs(dr.dot(hit, self.axis_v)) < self.mirror.half_v)
        lifted = self.middle + hit + LIFT_M * self.normal
        active = active & (scene.ray_test(si.spawn_ray_to(lifted), active) == False)  # noqa: E712  (scalar: a bool)
        to_lamp = self.lamp - lifted if self.is_point else mi.Vector3f(self.lamp)
        last = mi.Ray3f(lifted, to_lamp, 1.0 if self.is_point else FAR_M, si.time, si.wavelengths)
        active = active & (scene.ray_test(last, active) == False)  # noqa: E712
        value = bsdf.eval(mi.BSDFContext(), si, si.to_local(to_image), active)
        return dr.select(active, value * self.reflectance / squared, 0.0)

    @dr.syntax
    def sample(self, scene, sampler, ray, medium=None, active=True):
        ray = mi.Ray3f(ray.o, ray.d, ray.time, ray.wavelengths)
        direct, thrown, rest = mi.Color3f(0), mi.Color3f(0), mi.Color3f(0)
        throughput, depth = mi.Color3f(1), mi.UInt32(0)
        si = scene.ray_intersect(ray, active)
        active = active & si.is_valid()
        is_seen = mi.Bool(active)
        while active:
            bsdf = si.bsdf()
            from_lamp = throughput * self.lamp_light(scene, si, bsdf, active)
            from_mirror = mi.Color3f(0)
            if dr.hint(self.mirror is not None, mode="scalar"):
                from_mirror = throughput * self.thrown_light(scene, si, bsdf, active)
            is_first = depth == 0
            direct += dr.select(is_first, from_lamp, 0.0)
            thrown += dr.select(is_first, from_mirror, 0.0)
            rest += dr.select(is_first, 0.0, from_lamp + from_mirror)
            step, weight = bsdf.sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d(), active)
            throughput *= weight
            depth += 1
            survival = dr.select(depth >= ROULETTE_FROM, dr.minimum(dr.max(throughput), 0.95), 1.0)
            active &= (depth < self.max_depth) & (sampler.next_1d() < survival) & (dr.max(throughput) > 0)
            throughput *= dr.rcp(dr.maximum(survival, 1e-6))
            ray = si.spawn_ray(si.to_world(step.wo))
            si = scene.ray_intersect(ray, active)
            active &= si.is_valid()
        return direct + thrown + rest, is_seen, [*direct, *thrown]


def opaque(vector: np.ndarray) -> "mi.Vector3f":
    """A constant that compiled kernels do not contain, so that the next lamp uses the same kernel."""
    value = mi.Vector3f(*map(float, vector))
    dr.make_opaque(value)
    return value

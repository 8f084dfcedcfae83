"""Runs in an environment that has Mitsuba: times its `direct` integrator at 1 sample, and its path tracer.

    MITSUBA_PYTHON pipelines/bench/mitsuba_frame.py MESH.ply CAMERA.json ROUNDS

Prints one line of JSON: milliseconds of each frame by name, by the clock and of all cores.
"""

import json
import sys
import time

import mitsuba as mi


def main() -> None:
    mesh, camera, rounds = sys.argv[1], json.loads(sys.argv[2]), int(sys.argv[3])
    mi.set_variant("llvm_ad_rgb" if camera.get("llvm") else "scalar_rgb")
    scene = mi.load_dict(scene_of(mesh, camera))
    took = {}
    for name, samples in (("direct", 1), ("path", 16)):
        integrator = mi.load_dict({"type": name, **({"max_depth": 8} if name == "path" else {})})
        wall, cores = [], []
        for index in range(rounds + 1):
            start, start_cores = time.perf_counter(), time.process_time()
            image = mi.render(scene, integrator=integrator, spp=samples, seed=index)
            _ = float(image.array[0])  # LLVM renders when it is read
            wall.append(1e3 * (time.perf_counter() - start))
            cores.append(1e3 * (time.process_time() - start_cores))
        took[f"Mitsuba {name}, {samples} samples"] = {"wall": wall[1:], "cores": cores[1:]}
    sys.stdout.write(json.dumps(took) + "\n")


def scene_of(mesh: str, camera: dict) -> dict:
    """The mesh in one diffuse material under one distant light."""
    to_world = mi.ScalarTransform4f(camera["to_world"])
    film = {"type": "hdrfilm", "width": camera["w"], "height": camera["h"], "rfilter": {"type": "box"}}
    return {
        "type": "scene",
        "shape": {"type": "ply", "filename": mesh, "bsdf": {"type": "twosided", "b": {"type": "diffuse"}}},
        "light": {"type": "directional", "direction": camera["direction"], "irradiance": {"type": "rgb", "value": 3.0}},
        "sensor": {"type": "perspective", "fov": camera["fov"], "to_world": to_world, "film": film},
    }


if __name__ == "__main__":
    main()

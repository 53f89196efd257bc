"""The scenes of `run` and `images`, as jobs that are written into a folder with the assets' full paths.

Both lists vary what a kernel is a product of: where collisions come from (one grid, several media), channels (grey or
not), what else a ray can meet, and how light is scattered; and beside it transmittance functions, emission and lights.
Keys are those that jobs had at commit f074d28, so that old and new programs render the same files.
"""
import base64
import copy
import json
import math
import struct
from pathlib import Path

ASSETS = Path(__file__).resolve().parents[2] / "scenes" / "assets"


class Scene:
    """A job, and the glTF document beside it if it has surfaces."""

    def __init__(self, name, what, job, gltf=None, alpha=1.0):
        self.name, self.what, self.job, self.gltf = name, what, job, gltf
        # Largest value that a sample's alpha can have.
        self.alpha = alpha

    def write(self, folder):
        """Writes the job and what it names into `folder`; returns its path."""
        job = copy.deepcopy(self.job)
        if self.gltf:
            job["scene"] = f"{self.name}.gltf"
            (folder / job["scene"]).write_text(json.dumps(self.gltf))
        path = folder / f"{self.name}.json"
        path.write_text(json.dumps(job, indent=1))
        return path


# Parts of jobs.

def volume(asset, scale, albedo=0.999, phase=None, place=None, **more):
    """A grid `density` of the assets with extinction `scale` where it is 1."""
    keys = {"vdb": str(ASSETS / asset), "density": {"grid": "density", "scale": scale}, "albedo": albedo}
    if phase:
        keys["phase"] = phase
    if place:
        keys["transform"] = place
    return {**keys, **more}


def hg(g):
    return {"type": "henyey_greenstein", "g": g}


def sun(diameter=0.0, to_light=(0.5, 0.8, -0.3), irradiance=(3, 3, 3)):
    return {"type": "sun", "to_light": list(to_light), "irradiance": list(irradiance), "angular_diameter": diameter}


def environment(*radiance):
    return {"type": "environment", "radiance": list(radiance)}


def sky(intensity=1.0, turn=100.0):
    return {"type": "environment", "image": str(ASSETS / "sky.exr"), "intensity": intensity, "rotation_y": turn}


def point(position, intensity):
    return {"type": "point", "position": list(position), "intensity": list(intensity)}


# Parts of glTF documents.

def matte(*colour, emits=None):
    """A diffuse surface and nothing else; `emits` is radiance given off by its front."""
    material = {
        "doubleSided": emits is None,
        "pbrMetallicRoughness": {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0},
        "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}},
    }
    if emits:
        strength = max(1.0, *emits)
        material["emissiveFactor"] = [e / strength for e in emits]
        material["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
    return material


def glass(ior, attenuation=None, distance=1.0, scatter=None):
    """Smooth clear glass; `scatter` fills it with a medium of that multiple-scattering colour."""
    body = {"thicknessFactor": 1.0}
    if attenuation:
        body |= {"attenuationColor": list(attenuation), "attenuationDistance": distance}
    extensions = {
        "KHR_materials_ior": {"ior": ior},
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_volume": body,
    }
    if scatter:
        extensions["KHR_materials_volume_scatter"] = {"multiscatterColor": list(scatter), "scatterAnisotropy": 0.2}
    return {"pbrMetallicRoughness": {"roughnessFactor": 0.0, "metallicFactor": 0.0}, "extensions": extensions}


def quad(corner, a, b):
    """Two triangles, their front towards a x b."""
    p, q = [list(corner)], [[corner[k] + a[k] + b[k] for k in range(3)]]
    pa, pb = [[corner[k] + a[k] for k in range(3)]], [[corner[k] + b[k] for k in range(3)]]
    return p + pa + q + p + q + pb


def floor(height, half):
    return quad((-half, height, -half), (0, 0, 2 * half), (2 * half, 0, 0))


def box(centre, half):
    """The closed surface of a cube, front outwards."""
    corners = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            corner, a, b = [-half] * 3, [0.0] * 3, [0.0] * 3
            corner[axis] = side * half
            a[u], b[v] = 2 * half, 2 * half
            corner = [corner[k] + centre[k] for k in range(3)]
            corners += quad(corner, a, b) if side > 0 else quad(corner, b, a)
    return corners


def gltf(meshes, instances=()):
    """A document of meshes (corners, three a triangle, and a material), and volumes that are instanced.

    `instances` are pairs of the object of `PILEUS_volume` and a list of translations.
    """
    document = {"asset": {"version": "2.0"}, "scene": 0, "nodes": [], "extensionsUsed": []}
    data, views, accessors = b"", [], []

    def accessor(rows):
        nonlocal data
        accessors.append({
            "bufferView": len(views), "componentType": 5126, "count": len(rows), "type": "VEC3",
            "min": [min(r[k] for r in rows) for k in range(3)], "max": [max(r[k] for r in rows) for k in range(3)],
        })
        # Bounds must be those of the single precision that is stored.
        single = lambda v: struct.unpack("<f", struct.pack("<f", v))[0]
        for bound in ("min", "max"):
            accessors[-1][bound] = [single(v) for v in accessors[-1][bound]]
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": 12 * len(rows)})
        data += b"".join(struct.pack("<3f", *row) for row in rows)
        return len(accessors) - 1

    document["meshes"] = [
        {"primitives": [{"attributes": {"POSITION": accessor(corners)}, "material": i}]}
        for i, (corners, _) in enumerate(meshes)
    ]
    document["materials"] = [material for _, material in meshes]
    document["nodes"] = [{"mesh": i} for i in range(len(meshes))]
    for keys, places in instances:
        instancing = {"attributes": {"TRANSLATION": accessor(places)}}
        document["nodes"].append({"extensions": {"PILEUS_volume": keys, "EXT_mesh_gpu_instancing": instancing}})
    document["scenes"] = [{"nodes": list(range(len(document["nodes"])))}]
    used = {key for material in document["materials"] for key in material.get("extensions", {})}
    used |= {key for node in document["nodes"] for key in node.get("extensions", {})}
    document["extensionsUsed"] = sorted(used)
    document |= {"bufferViews": views, "accessors": accessors}
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    document["buffers"] = [{"uri": uri, "byteLength": len(data)}]
    return document


# Scenes over the one-grid grey one.

def axes():
    """What stands over the grey cloud alone, and over the chromatic plume alone: (scene, name of its base)."""
    cloud = volume("cumulus_small.vdb", 0.4, 0.999, hg(0.8))
    # Below and behind the camera, so small from here that no path meets what is there.
    far = [1e5, -2e5, 1.3e5]
    view = {
        "camera": {
            "position": [736.9291789780415, 391.92875369341243, 432.35750738682486],
            "look_at": [15.5, 175.5, -0.5], "fov_y": 35.0,
        },
        "lights": [sun(), environment(0.3, 0.4, 0.6)],
        "film": {"resolution": [64, 64]},
        "sampling": {"max_bounces": 256},
    }
    triangle = gltf([([far, [far[0] + 1, far[1], far[2]], [far[0], far[1] + 1, far[2]]], matte(0.5, 0.5, 0.5))])
    ground = gltf([(quad((-1984.5, -160.0, -2000.5), (0, 0, 4000), (4000, 0, 0)), matte(0.4, 0.35, 0.3))])

    def scene(name, what, *volumes, surfaces=None):
        return Scene(name, what, {"volumes": list(volumes), **view}, surfaces)

    empty = {"homogeneous": {"sigma_t": 0.0, "bounds": [far, [f + 10 for f in far]]}}
    small = volume("syn_sphere.vdb", 1.0, 0.9, hg(0.2), {"translation": far})
    mixture = {"type": "mixture", "lobes": [
        {"weight": 0.7, "phase": hg(0.85)},
        {"weight": 0.3, "phase": {"type": "draine", "g": 0.55, "alpha": 10.0}},
    ]}
    plume = {
        "camera": {
            "position": [3.951848197478266, 2.6090544592434797, 2.6101089184869597],
            "look_at": [-0.12, 1.3875, 0.167], "fov_y": 35.0,
        },
        "lights": [sun(), environment(0.3, 0.4, 0.6)],
        "film": {"resolution": [64, 64]},
        "sampling": {"max_bounces": 64},
        "volumes": [volume("syn_plume.vdb", 50.0, [0.6, 0.5, 0.4], hg(0.0), extinction=[1.0, 0.4, 0.1])],
    }
    return [
        (scene("grey", "one grey grid, Henyey-Greenstein", cloud), None),
        (scene("empty_second", "and an empty volume far away", cloud, empty), "grey"),
        (scene("far_second", "and a small cloud far away, met by no path", cloud, small), "grey"),
        (scene("far_triangle", "and a triangle far away, met by no path", cloud, surfaces=triangle), "grey"),
        (scene("mie", "Mie (droplets of 3 micrometres)", {**cloud, "phase": {"type": "mie", "droplet_diameter": 3}}),
         "grey"),
        (scene("mixture", "Henyey-Greenstein and Draine", {**cloud, "phase": mixture}), "grey"),
        (scene("power", "power law, k = 1e9", {**cloud, "law": {"type": "power", "k": 1e9}}), "grey"),
        (scene("two", "and a cloud that overlaps it", cloud, {**cloud, "transform": {"translation": [90, -60, 130]}}),
         "grey"),
        (scene("ground", "over a diffuse square", cloud, surfaces=ground), "grey"),
        (scene("emissive", "gives off light", {**cloud, "emission": {"type": "grid", "grid": "density", "scale": 0.01}}),
         "grey"),
        (Scene("plume_chromatic", "one grid of extinction 1 : .4 : .1", plume), None),
        (Scene("plume_triangle", "and a triangle that nobody sees", plume, triangle), "plume_chromatic"),
    ]


# Scenes that cross the axes.

def crossed():
    """Scenes of 48 x 32 pixels in which what kernels are made of meets."""
    # The assets are moved to the origin and made some 3 across; the plume, a thin column, is made stout.
    def cloud(sigma, albedo=0.99, phase=None, at=(0, 0, 0), **more):
        place = {"scale": [0.01] * 3, "translation": [at[0] - 0.155, at[1] - 1.755, at[2]]}
        return volume("cumulus_small.vdb", sigma, albedo, phase or hg(0.6), place, **more)

    def plume(sigma, albedo=0.9, phase=None, at=(0, 0, 0), **more):
        place = {"scale": [4.0, 1.1, 4.0], "translation": [at[0] + 0.48, at[1] - 1.526, at[2] - 0.668]}
        return volume("syn_plume.vdb", sigma, albedo, phase or hg(0.2), place, **more)

    def fire(sigma, **more):
        place = {"scale": [1.6] * 3, "translation": [-1.68, -1.4, 1.4]}
        return volume("fire_0003.vdb", sigma, phase=hg(0.3), place=place, up_axis="z", **more)

    def haze(sigma, albedo=0.9, half=1.6, phase=None, **more):
        keys = {"homogeneous": {"sigma_t": sigma, "bounds": [[-half] * 3, [half] * 3]}, "albedo": albedo}
        return {**keys, "phase": phase or hg(0.1), **more}

    def scene(name, what, volumes, lights, surfaces=None, eye=(3.2, 1.2, 3.6), spp=1024, alpha=1.0, **sampling):
        job = {
            "volumes": volumes, "lights": lights,
            "camera": {"position": list(eye), "look_at": [0.0, 0.0, 0.0], "fov_y": 36.0},
            "film": {"resolution": [48, 32]}, "sampling": {"spp": spp, **sampling},
        }
        return Scene(name, what, job, surfaces, alpha)

    rgb, tinted = [1.0, 0.4, 0.1], [0.95, 0.85, 0.7]
    red_floor = (floor(-1.5, 4.0), matte(0.7, 0.25, 0.2))
    grey_floor = (floor(-1.5, 4.0), matte(0.5, 0.5, 0.5))
    lamp = (quad((-1.2, 2.4, -1.2), (2.4, 0, 0), (0, 0, 2.4)), matte(0.2, 0.2, 0.2, emits=(4.0, 3.5, 2.5)))
    hidden = ([[900, -900, 900], [901, -900, 900], [900, -899, 900]], matte(0.5, 0.5, 0.5))
    day = [sun(), environment(0.3, 0.4, 0.6)]
    mixture = {"type": "mixture", "lobes": [
        {"weight": 0.6, "phase": {"type": "draine", "g": 0.6, "alpha": 2.0}},
        {"weight": 0.3, "phase": {"type": "rayleigh"}},
        {"weight": 0.1, "phase": hg(-0.5)},
    ]}
    flakes = {"type": "sggx", "flakes": "specular",
              "distribution": {"shape": "fibre", "axis": [0.3, 1.0, 0.2], "roughness": 0.25}}
    diffuse_flakes = {"type": "sggx", "flakes": "diffuse",
                      "distribution": {"shape": "surface", "axis": [1.0, 0.5, 0.0], "roughness": 0.4}}
    soot = {"type": "blackbody", "normalised": True, "intensity": 1.0,
            "temperature": {"grid": "temperature", "scale": 800.0, "offset": 300.0}}
    glow = {"type": "grid", "grid": "density", "color": [1.0, 0.5, 0.2], "scale": 0.5}
    return [
        scene("grey_alone", "one grey grid, HG, sun without extent", [cloud(20.0)], day),
        scene("grey_image", "one grey grid, HG, image of the sky and a sun's disc", [cloud(20.0, tinted)],
              [sky(), sun(2.0)]),
        scene("grey_mie", "one grey grid, Mie, sun's disc", [cloud(20.0, phase={"type": "mie", "droplet_diameter": 4})],
              [sun(8.0), environment(0.3, 0.4, 0.6)], spp=2048),
        scene("grey_inside", "one grey grid, mixture of lobes, camera inside, point light", [cloud(4.0, 0.95, mixture)],
              [point((0.5, 2.4, 0.4), (8.0, 7.0, 6.0)), environment(0.4, 0.4, 0.6)], eye=(0.3, 0.1, 0.4)),
        scene("thin_point", "one thin grey grid, point light (equiangular points)", [plume(0.6)],
              [point((0.5, 0.3, 0.9), (4.0, 3.0, 2.0)), environment(0.05, 0.05, 0.05)],
              distance="equiangular"),
        scene("flakes", "one grid of mirror flakes, sun's disc and image", [plume(8.0, tinted, flakes)],
              [sun(4.0), sky(0.5)]),
        scene("flakes_floor", "diffuse flakes and a grey cloud over a floor",
              [plume(6.0, 0.9, diffuse_flakes), cloud(6.0, 0.9, at=(0.8, 0.2, 0.3))], day, gltf([red_floor])),
        scene("two_grey", "two clouds that overlap, HG and Mie", [cloud(15.0), cloud(10.0, tinted, {
            "type": "mie", "droplet_diameter": 3}, (0.9, -0.3, 0.6))], day),
        scene("three_image", "two grids and a box around them, image of the sky",
              [plume(6.0, 0.8), cloud(8.0, tinted, at=(0.6, 0, -0.4)), haze(0.2)], [sky()]),
        scene("chromatic", "one grid of extinction 1 : .4 : .1, sun without extent",
              [plume(14.0, [0.6, 0.5, 0.4], extinction=rgb)], day),
        scene("chromatic_image", "the same under an image of the sky", [plume(14.0, tinted, extinction=rgb)], [sky()]),
        scene("chromatic_mie", "the same, Mie, beside a triangle that nobody sees",
              [plume(14.0, tinted, {"type": "mie", "droplet_diameter": 4}, extinction=rgb)],
              [sun(20.0), environment(0.3, 0.4, 0.6)],
              gltf([hidden]), spp=2048, alpha=3.0),
        scene("chromatic_two", "two chromatic media of opposite order that overlap",
              [plume(10.0, tinted, extinction=rgb), haze(0.6, 0.95, extinction=[0.1, 0.5, 1.0])], day,
              spp=2048, alpha=3.0),
        scene("chromatic_floor", "a chromatic grid over a red floor, area light",
              [plume(10.0, tinted, extinction=rgb)], [environment(0.05, 0.05, 0.08)], gltf([red_floor, lamp]),
              spp=2048, alpha=3.0),
        scene("grey_floor", "a grey cloud over a floor, image of the sky", [cloud(15.0)], [sky()], gltf([red_floor]),
              spp=2048),
        scene("lamp", "two grey media over a floor, area light and point light",
              [plume(6.0), haze(0.15, 0.8)], [point((2.4, 2.0, 1.2), (3.0, 3.0, 3.5)), environment(0.1, 0.1, 0.1)], gltf([grey_floor, lamp])),
        scene("glass", "a cloud through a box of coloured glass, mixture of lobes",
              [cloud(12.0, 0.95, mixture)], [environment(0.4, 0.5, 0.7)],
              gltf([grey_floor, lamp, (box((1.3, -0.6, 1.6), 0.7), glass(1.5, (0.9, 0.6, 0.4)))])),
        scene("interior", "a scattering body of index 1 that a chromatic grid overlaps",
              [plume(8.0, tinted, extinction=rgb)], day,
              gltf([grey_floor, (box((0.5, -0.4, 0.6), 0.7), glass(1.0, (0.8, 0.6, 0.3), 0.6, (0.6, 0.5, 0.4)))]),
              alpha=3.0),
        scene("power_law", "one grey grid under the power law", [cloud(20.0, law={"type": "power", "k": 1.5})], day),
        scene("erlang_floor", "Erlang's law, chromatic, with exponential haze over a floor",
              [plume(8.0, tinted, extinction=rgb, law={"type": "erlang", "n": 3}), haze(0.2, 0.9)], day,
              gltf([red_floor]), alpha=3.0),
        scene("soot", "a black body's light over a floor", [fire(20.0, albedo=0.3, emission=soot)],
              [environment(0.15, 0.15, 0.2)], gltf([grey_floor]), spp=2048),
        scene("glow", "a chromatic grid that gives off light, Mie cloud overlapping, point light",
              [plume(8.0, tinted, extinction=rgb, emission=glow),
               cloud(5.0, 0.95, {"type": "mie", "droplet_diameter": 6}, (0.7, 0.1, 0.2))],
              [point((2.0, 2.6, 2.0), (6.0, 6.0, 6.0)), environment(0.1, 0.1, 0.15)], spp=2048, alpha=3.0),
        scene("instances", "nine instances of a plume, two that overlap, over a floor", [],
              [sun(), environment(0.3, 0.4, 0.6)],
              gltf([red_floor], [(volume("syn_plume.vdb", 15.0, tinted, hg(0.3)),
                                  [[0.9 * i, -1.5, 1.2 * k] for i in (-1, 0, 1) for k in (-1, 0, 1)])])),
    ]

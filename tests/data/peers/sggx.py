"""Reference pictures of flakes, by the phase function `sggx` of Mitsuba 3.9.1 (pip install mitsuba numpy OpenEXR).

    python3 sggx.py constant|grid SAMPLES OUT.exr OUT.var.exr

Taken from the peer are the phase function's value and the projected area, interpolated from its own grid of matrices. The path tracing is this file's: delta tracking in a cube, a next event for
the sun at every collision, directions by rejection from the peer's values. Its integrators (`volpath`, `volpathmis`) and its sampling are not used: directions that `sggx` samples in that version do not follow
the density that it returns (seen along (-0.48, 0.64, 0.6), fibres along (0.48, 0.6, 0.64) of roughness 0.2: mean direction (-0.21, -0.06, 0.28) by 60,000 samples, (-0.46, -0.19, -0.23) by
integration), so that a furnace of albedo 1 shows 0.37 to 0.5. Extinction and values are right: values integrate to one, and absorption alone is exp(-depth).
"""
import math
import random
import sys
from multiprocessing import Pool

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

SIGMA_T = 3.0
ALBEDO = (0.9, 0.7, 0.5)
TO_SUN = np.array([0.5, 0.8, -0.3]) / np.linalg.norm([0.5, 0.8, -0.3])
IRRADIANCE = (3.0, 2.0, 1.0)
SKY = (0.3, 0.4, 0.6)
SIZE = 64


def fibre(axis, roughness):
    a = np.array(axis, float)
    a /= np.linalg.norm(a)
    s = np.eye(3) - (1 - roughness**2) * np.outer(a, a)
    return [s[0, 0], s[1, 1], s[2, 2], s[0, 1], s[0, 2], s[1, 2]]


def phase_function(kind):
    n, half = 9, 1.5
    grid = np.zeros((n, n, n, 6), np.float32)  # z, y, x
    for z in range(n):
        for y in range(n):
            for x in range(n):
                px, py, pz = [(c - 4) / 4 for c in (x, y, z)]
                if kind == "constant":
                    grid[z, y, x] = fibre([0.48, 0.6, 0.64], 0.2)
                else:
                    grid[z, y, x] = fibre([0.3 - py, px + 0.2, 0.5 + 0.4 * pz], 0.15)
    # Values sit in the middle of n cells over the box.
    w = half * n / (n - 1)
    to_world = mi.ScalarTransform4f().translate([-w, -w, -w]).scale([2 * w, 2 * w, 2 * w])
    volume = {"type": "gridvolume", "grid": mi.VolumeGrid(grid), "to_world": to_world, "raw": True}
    return mi.load_dict({"type": "sggx", "S": volume})


def span(o, d):
    low, high = 0.0, math.inf
    for x, v in zip(o, d):
        if v == 0.0:
            if abs(x) > 1.0:
                return None
            continue
        a, b = (-1.0 - x) / v, (1.0 - x) / v
        low, high = max(low, min(a, b)), min(high, max(a, b))
    return (low, high) if low < high else None


def row_of_pixels(job):
    kind, y, samples = job
    phase = phase_function(kind)
    rng = random.Random(y * 7919 + 13)
    roughness = 0.2 if kind == "constant" else 0.15
    context, at = mi.PhaseFunctionContext(), mi.MediumInteraction3f()
    at.t = 1.0

    def look(p, d):
        at.p = p
        at.wi = mi.Vector3f(-d[0], -d[1], -d[2])
        at.sh_frame = mi.Frame3f(at.wi)

    def flight(o, d):
        """Distance of a collision, or None: delta tracking; no flakes show more than area 1."""
        inside = span(o, d)
        if inside is None:
            return None
        t = inside[0]
        while True:
            t -= math.log(1.0 - rng.random()) / SIGMA_T
            if t >= inside[1]:
                return None
            p = [x + t * v for x, v in zip(o, d)]
            look(p, d)
            if rng.random() < phase.projected_area(at):
                return p

    eye = np.array([3.0, 1.5, 4.0])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    tan = math.tan(math.radians(17))
    sun = TO_SUN.tolist()
    mean, square = np.zeros((SIZE, 3)), np.zeros((SIZE, 3))
    for x in range(SIZE):
        for _ in range(samples):
            u, v = (x + rng.random()) / SIZE * 2 - 1, 1 - (y + rng.random()) / SIZE * 2
            d = forward + right * (tan * u) + up * (tan * v)
            d = (d / np.linalg.norm(d)).tolist()
            o, beta, light = eye.tolist(), [1.0] * 3, [0.0] * 3
            while True:
                p = flight(o, d)
                if p is None:
                    light = [a + b * s for a, b, s in zip(light, beta, SKY)]
                    break
                beta = [b * a for b, a in zip(beta, ALBEDO)]
                look(p, d)
                value = phase.eval_pdf(context, at, mi.Vector3f(*sun))[1]
                if value > 0.0 and flight(p, sun) is None:
                    light = [a + b * value * e for a, b, e in zip(light, beta, IRRADIANCE)]
                strongest = max(beta)
                if strongest < 0.5:
                    if rng.random() >= strongest / 0.5:
                        break
                    beta = [b * 0.5 / strongest for b in beta]
                look(p, d)
                o = p
                # No value is larger than 1 / (4 pi roughness area) for one axis; mixtures are rounder.
                most = 1.2 / (4 * math.pi * roughness * phase.projected_area(at))
                while True:
                    z, turn = 1 - 2 * rng.random(), 2 * math.pi * rng.random()
                    q = math.sqrt(1 - z * z)
                    d = [q * math.cos(turn), q * math.sin(turn), z]
                    value = phase.eval_pdf(context, at, mi.Vector3f(*d))[1]
                    assert value <= most
                    if rng.random() * most < value:
                        break
            mean[x] += light
            square[x] += np.square(light)
    mean /= samples
    return mean, (square / samples - mean**2) / (samples - 1)


if __name__ == "__main__":
    kind, samples = sys.argv[1], int(sys.argv[2])
    with Pool(2) as pool:
        rows = pool.map(row_of_pixels, [(kind, y, samples) for y in range(SIZE)], 1)
    for name, part in zip(sys.argv[3:5], (0, 1)):
        mi.Bitmap(np.stack([row[part] for row in rows]).astype(np.float32)).write(name)
    print(kind, np.stack([row[0] for row in rows]).mean((0, 1)))

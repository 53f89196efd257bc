#!/usr/bin/env python3
"""Measure what denoising takes of the error of the peer scenes: the table of docs/charts/denoising.md.

    python run_denoising.py --pileus target/release/pileus --out OUTDIR [--scenes NAME ...] [--spp 16 ...] [--seeds 24]

Every scene is rendered with every number of samples and with seeds 0, 1, ...; the layer `denoised` is compared with the
image of the same render. Needs a Python that has numpy and OpenEXR; references are those of tests/data/peers.

raw, denoised  relMSE: mean over pixels and channels of (x - ref)^2 / (ref^2 + 0.01), less the reference's own variance
               mean(var / (ref^2 + 0.01)); means over the seeds
mean           mean of the denoised image over that of the raw one, less one: the largest of any seed
flicker        standard deviation over the seeds, relative as relMSE is: of the denoised pixels over that of the raw ones
seconds        processor seconds of the whole process with the layer, less those without
"""
import argparse
import resource
import subprocess
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
REFS = HERE.parent.parent / "tests" / "data" / "peers"
SCENES = ["cumulus_small", "cumulus", "cumulus_thick", "cumulus_ground", "cumulus_two", "arnold_smoke"]


def read(path, prefix=""):
    import OpenEXR
    with OpenEXR.File(str(path), separate_channels=True) as f:
        channels = f.channels()
        return np.stack([np.array(channels[prefix + c].pixels, dtype=np.float64) for c in "RGB"], axis=-1)


def rendered(o, scene, spp, seed, denoise):
    """The image and, if asked for, the denoised one; and processor seconds."""
    out = o.out / f"{scene}.exr"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    option = "--denoise" if denoise else "--no-denoise"
    subprocess.run([o.pileus, "render", HERE / f"{scene}.json", "--spp", str(spp), "--seed", str(seed), "-o", out, "-q",
                    "--no-preview", "--no-stats", option], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return read(out), read(out.with_suffix(".layers.exr"), "denoised.") if denoise else None, cpu


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--pileus", type=Path, required=True)
    ap.add_argument("--out", type=Path, required=True)
    ap.add_argument("--scenes", nargs="+", default=SCENES)
    ap.add_argument("--spp", nargs="+", type=int, default=[16])
    ap.add_argument("--seeds", type=int, default=24)
    o = ap.parse_args()
    o.out.mkdir(parents=True, exist_ok=True)
    print("| scene | samples | raw relMSE | denoised | raw over denoised | mean | flicker | CPU seconds |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for scene in o.scenes:
        ref = read(REFS / f"{scene}.exr")
        weight = 1.0 / (ref**2 + 0.01)
        own = float(np.mean(read(REFS / f"{scene}.var.exr") * weight))
        for spp in o.spp:
            kinds = [{"error": [], "sum": 0.0, "squares": 0.0} for _ in range(2)]
            mean, cost = 0.0, []
            for seed in range(o.seeds):
                raw, denoised, cpu = rendered(o, scene, spp, seed, True)
                if seed < 3:
                    cost.append(cpu - rendered(o, scene, spp, seed, False)[2])
                mean = max(mean, abs(denoised.mean() / raw.mean() - 1.0))
                for kind, image in zip(kinds, (raw, denoised)):
                    kind["error"].append(float(np.mean((image - ref)**2 * weight)) - own)
                    kind["sum"] = kind["sum"] + image
                    kind["squares"] = kind["squares"] + image**2
            spread = [float(np.mean((k["squares"] / o.seeds - (k["sum"] / o.seeds)**2) * weight))**0.5 for k in kinds]
            raw, denoised = (float(np.mean(k["error"])) for k in kinds)
            print(f"| {scene} | {spp} | {raw:.5f} | {denoised:.5f} | {raw / denoised:.1f} | {100 * mean:.2f} % | "
                  f"{spread[1] / spread[0]:.2f} | {sorted(cost)[1]:.2f} |", flush=True)


if __name__ == "__main__":
    main()

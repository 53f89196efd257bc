#!/usr/bin/env python3
"""Render the peer scenes with Pileus, Mitsuba 3 and Cycles in one sitting and compare seconds and error.

    python run_peers.py --pileus target/release/pileus \\
        --mitsuba-python VENV/bin/python --cycles-python VENV/bin/python --peer-scripts DIR \\
        --scenes cumulus_small cumulus arnold_smoke --spp 16 --repeats 3 --out OUTDIR

A renderer takes part when its option is given; `--base` is another build of Pileus, to see what a change brought. The jobs beside this file are the only description of the scenes: the
peers' scene files are made from them. DIR holds mitsuba_render.py (with vdb_dump.py) and cycles_render.py.
Run with a Python that has numpy and OpenEXR.

Every repeat renders every scene with every renderer, the order of renderers turning by one each time, so that a machine
that slows down slows all of them. Repeat r uses seed SEED + r.

seconds   what the renderer itself reports for sampling alone; loading and building are in `setup_seconds`
          (Pileus: load + build; Mitsuba: file and scene; Cycles: its synchronisation)
cpu       processor seconds, user and system, which hold on a machine with other load where `seconds` do not: of
          Pileus' whole process, loading and writing included; for Cycles of its sampling alone
relmse    mean over pixels and channels of (x - ref)^2 / (ref^2 + 0.01), less the reference's own variance
          mean(var / (ref^2 + 0.01)); empty where there is no reference
e_x_t     relmse x seconds: lower is better; hardly depends on the sample count
e_x_cpu   relmse x cpu
mean_off  mean of the image / mean of the reference - 1: shows a bias or another convention
OUTDIR gets peers.csv (one row a render), peers.md (medians) and the images.
"""
import argparse
import csv
import functools
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
RENDERERS = ("pileus", "base", "mitsuba", "cycles")
FIELDS = ("scene", "renderer", "version", "spp", "seconds", "cpu", "relmse", "e_x_t", "e_x_cpu", "repeat",
          "setup_seconds", "mean_off")


def read_exr(path):
    """The R, G and B channels as float64, shape (height, width, 3)."""
    import OpenEXR
    with OpenEXR.File(str(path), separate_channels=True) as f:
        channels = f.channels()
        return np.stack([np.asarray(channels[c].pixels, dtype=np.float64) for c in "RGB"], axis=-1)


def only(values, what, name):
    if len(values) != 1:
        raise SystemExit(f"{name}: the peers take exactly one {what}, the job has {len(values)}")
    return values[0]


def triple(v):
    return [float(v)] * 3 if np.isscalar(v) else [float(x) for x in v]


def grey(job):
    return all(len(set(triple(v.get("extinction", 1.0)))) == 1 for v in job["volumes"])


def mitsuba_takes(job):
    """Its script knows one volume and nothing else."""
    return len(job["volumes"]) == 1 and "scene" not in job


def ground(job):
    """The square of a job's glTF document in the keys of the peers' scripts."""
    document = json.loads((HERE / job["scene"]).read_text())
    corners = only(document["accessors"], "accessor", job["scene"])
    low, high = corners["min"], corners["max"]
    if low[1] != high[1] or high[0] - low[0] != high[2] - low[2]:
        raise SystemExit(f"{job['scene']}: the peers take a level square")
    material = only(document["materials"], "material", job["scene"])
    return {"center": [(a + b) / 2 for a, b in zip(low, high)], "size": high[0] - low[0],
            "albedo": material["pbrMetallicRoughness"]["baseColorFactor"][:3]}


def peer_scene(name, job, assets, spp, threads):
    """A Pileus job in the keys of the peers' scripts."""
    suns = [x for x in job["lights"] if x["type"] == "sun"]
    skies = [x for x in job["lights"] if x["type"] == "environment"]
    cam, sun, sky = job["camera"], only(suns, "sun", name), only(skies, "environment", name)

    def volume(v):
        vdb = assets / Path(v["vdb"]).name if assets else (HERE / v["vdb"]).resolve()
        return {"vdb": str(vdb), "grid": v["density"]["grid"], "density_scale": v["density"]["scale"],
                "albedo": triple(v["albedo"]), "g": v["phase"].get("g", 0.0)}

    first, *others = job["volumes"]
    scene = {
        **volume(first),
        "camera": {"position": cam["position"], "look_at": cam["look_at"], "up": cam["up"], "fov_y_deg": cam["fov_y"]},
        "resolution": job["film"]["resolution"],
        "sun": {"direction": sun["to_light"], "irradiance": sun["irradiance"], "direction_is": "to_light"},
        "env": {"radiance": sky["radiance"]},
        "spp": spp, "max_bounces": job["sampling"]["max_bounces"], "threads": threads,
    }
    if others:
        scene["more_volumes"] = [{**volume(v), "translate": v["transform"]["translation"]} for v in others]
    if "scene" in job:
        scene["ground"] = ground(job)
    extinction = triple(first.get("extinction", 1.0))
    if extinction != [1.0] * 3:
        scene["sigma_t_rgb"] = extinction
    return scene


def program(path):
    """A path as it is named (links kept, a virtual environment's Python is one), a bare name from PATH."""
    return path.absolute() if path and path.exists() else path


def call(cmd, log):
    """Run, keep everything printed in a log file, return standard output."""
    return call_timed(cmd, log)[0]


def call_timed(cmd, log):
    """Run, keep everything printed in a log file, return standard output and the processor seconds of the process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    r = subprocess.run([str(c) for c in cmd], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    log.write_text(r.stdout)
    if r.returncode != 0:
        raise RuntimeError(f"{Path(str(cmd[0])).name} ended with {r.returncode}: {r.stdout.strip()[-400:]}")
    return r.stdout, sum(after[:2]) - sum(before[:2])


def last_json(text, start):
    for line in reversed(text.splitlines()):
        if line.startswith(start):
            return json.loads(line[line.index("{"):])
    raise RuntimeError("no result line in the renderer's output")


def run_pileus(o, job_file, job, scene_file, out, spp, seed):
    return run_build(o.pileus, o, job_file, job, out, spp, seed)


def run_base(o, job_file, job, scene_file, out, spp, seed):
    return run_build(o.base, o, job_file, job, out, spp, seed)


@functools.cache
def help_of(build):
    return subprocess.run([build, "render", "--help"], capture_output=True, text=True).stdout


def run_build(build, o, job_file, job, out, spp, seed):
    if o.assets:      # the job's volumes from another folder
        job = json.loads(json.dumps(job))
        for v in job["volumes"]:
            v["vdb"] = str(o.assets / Path(v["vdb"]).name)
        if "scene" in job:
            job["scene"] = str(HERE / job["scene"])
        job_file = out.with_suffix(".job.json")
        job_file.write_text(json.dumps(job, indent=1))
    named = job.get("output", {}).get("stats")
    stats = job_file.parent / named if named else out.with_suffix(".stats.json")
    stats.unlink(missing_ok=True)
    # The same files of every build, and what the peers write: images, no picture for the eye.
    options = ["--no-preview"] if "--no-preview" in help_of(build) else []
    _, cpu = call_timed([build, "render", job_file, "--spp", spp, "--threads", o.threads, "--seed", seed, "-o", out, "-q", *options],
                        out.with_suffix(".log"))
    s = json.loads(stats.read_text())
    t = s["seconds"]
    return s.get("version", ""), t["render"], t.get("load", 0.0) + t.get("build", 0.0), cpu


def run_mitsuba(o, job_file, job, scene_file, out, spp, seed):
    # volpath is the faster one, but only volpathmis copes with an extinction that differs between channels
    integrator = "volpath" if grey(job) else "volpathmis"
    cmd = [o.mitsuba_python, o.peer_scripts / "mitsuba_render.py", scene_file, out, "--variant", o.mitsuba_variant,
           "--integrator", integrator, "--spp", spp, "--threads", o.threads, "--seed", seed]
    if o.vdb_python:
        cmd += ["--vdb-python", o.vdb_python]
    s = last_json(call(cmd, out.with_suffix(".log")), "{")
    if s["spp"] != spp:
        raise RuntimeError(f"{s['spp']} samples instead of {spp}")
    return f"{s['mitsuba']} {s['variant']} {s['integrator']}", s["render_s"], s["load_s"], None


def run_cycles(o, job_file, job, scene_file, out, spp, seed):
    cmd = [o.cycles_python, o.peer_scripts / "cycles_render.py", scene_file, out, "--spp", spp, "--threads", o.threads,
           "--seed", seed]
    s = last_json(call(cmd, out.with_suffix(".log")), "CYCLES ")
    return f"{s['blender']} {s['mode']}", s["render_s"], s["sync_s"], s["cpu_s_sampling"]


RUN = {"pileus": run_pileus, "base": run_base, "mitsuba": run_mitsuba, "cycles": run_cycles}


def errors(image, refs, name):
    """relMSE and relative offset of the mean, or two None without a reference."""
    ref_file, var_file = refs / f"{name}.exr", refs / f"{name}.var.exr"
    if not ref_file.is_file():
        return None, None
    ref, var, x = read_exr(ref_file), read_exr(var_file), read_exr(image)
    if x.shape != ref.shape:
        raise RuntimeError(f"image is {x.shape}, reference {ref.shape}")
    if not np.isfinite(x).all():
        raise RuntimeError("image has values that are not finite")
    weight = 1.0 / (ref ** 2 + 0.01)
    return float(np.mean(((x - ref) ** 2 - var) * weight)), float(x.mean() / ref.mean() - 1.0)


def show(v, digits=3):
    return "-" if v is None else f"{v:.{digits}g}"


def median(rows, key):
    values = [r[key] for r in rows if r[key] is not None]
    return statistics.median(values) if values else None


def markdown(rows, o, loads, failures):
    out = ["| scene | renderer | version | spp | seconds | set-up s | cpu s | relMSE | **e x t** | **e x cpu** | mean off | e x cpu / Pileus |",
           "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"]
    for scene in o.scenes:
        groups = [(name, [r for r in rows if r["scene"] == scene and r["renderer"] == name]) for name in RENDERERS]
        groups = [(name, g) for name, g in groups if g]
        own = median([r for r in rows if r["scene"] == scene and r["renderer"] == "pileus"], "e_x_cpu")
        for name, g in groups:
            m = {k: median(g, k) for k in ("seconds", "setup_seconds", "cpu", "relmse", "e_x_t", "e_x_cpu", "mean_off")}
            ratio = m["e_x_cpu"] / own if own and m["e_x_cpu"] is not None else None
            off = "-" if m["mean_off"] is None else f"{100 * m['mean_off']:+.3f} %"
            out.append(f"| {scene} | {name} | {g[0]['version']} | {o.spp} | {show(m['seconds'])} | {show(m['setup_seconds'])} "
                       f"| {show(m['cpu'])} | {show(m['relmse'])} | **{show(m['e_x_t'])}** | **{show(m['e_x_cpu'])}** | {off} | {show(ratio)} |")
    out += ["", f"Medians of {o.repeats} interleaved repeats, {o.threads} threads on {os.cpu_count()} cores "
            f"({platform.machine()}); load average of the machine {loads[0]:.2f} before the first render, {max(loads):.2f} at most."]
    out += [f"Failed: {f}" for f in failures]
    return "\n".join(out) + "\n"


def main():
    known = sorted(p.stem for p in HERE.glob("*.json"))
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--pileus", type=Path, help="the pileus program")
    ap.add_argument("--base", type=Path, help="another build of the pileus program")
    ap.add_argument("--mitsuba-python", type=Path, help="a Python that has mitsuba and numpy")
    ap.add_argument("--cycles-python", type=Path, help="a Python that has bpy")
    ap.add_argument("--peer-scripts", type=Path, help="folder of mitsuba_render.py, vdb_dump.py and cycles_render.py")
    ap.add_argument("--vdb-python", help="a Python that has OpenVDB, for vdb_dump.py (default: that script's own)")
    ap.add_argument("--mitsuba-variant", default="scalar_rgb")
    ap.add_argument("--assets", type=Path, help="folder of the volumes (default: where the jobs say)")
    ap.add_argument("--refs", type=Path, default=HERE.parent.parent / "tests" / "data" / "peers", help="folder of the references")
    ap.add_argument("--scenes", nargs="+", default=["cumulus_small", "cumulus", "arnold_smoke"], choices=known, metavar="SCENE",
                    help="of " + " ".join(known))
    ap.add_argument("--renderers", nargs="+", choices=RENDERERS, help="default: all whose option is given")
    ap.add_argument("--spp", type=int, default=16)
    ap.add_argument("--repeats", type=int, default=3)
    ap.add_argument("--threads", type=int, default=2)
    ap.add_argument("--seed", type=int, default=0)
    ap.add_argument("--out", type=Path, required=True, help="folder for table, CSV and images")
    o = ap.parse_args()
    needs = {"pileus": (o.pileus,), "base": (o.base,), "mitsuba": (o.mitsuba_python, o.peer_scripts), "cycles": (o.cycles_python, o.peer_scripts)}
    chosen = o.renderers or [r for r in RENDERERS if all(needs[r])]
    for r in chosen:
        if not all(needs[r]):
            ap.error(f"{r} needs its program" + ("" if r in ("pileus", "base") else f" (--{r}-python) and --peer-scripts"))
    if not chosen:
        ap.error("no renderer: give --pileus, --mitsuba-python or --cycles-python")
    o.pileus, o.base, o.mitsuba_python, o.cycles_python = (
        program(x) for x in (o.pileus, o.base, o.mitsuba_python, o.cycles_python))
    if o.assets:
        o.assets = o.assets.resolve()
    o.out.mkdir(parents=True, exist_ok=True)
    o.out = o.out.resolve()

    loads = [os.getloadavg()[0]]
    rows, failures = [], []
    for repeat in range(o.repeats):
        for scene in o.scenes:
            job_file = HERE / f"{scene}.json"
            job = json.loads(job_file.read_text())
            turn = repeat % len(chosen)
            for name in chosen[turn:] + chosen[:turn]:
                if name == "cycles" and not grey(job):
                    continue      # its script knows one extinction for all channels
                if name == "mitsuba" and not mitsuba_takes(job):
                    continue
                out = o.out / f"{scene}.{name}.{repeat}.exr"
                scene_file = o.out / f"{scene}.{name}.{repeat}.scene.json"
                try:
                    out.unlink(missing_ok=True)
                    if name not in ("pileus", "base"):
                        scene_file.write_text(json.dumps(peer_scene(scene, job, o.assets, o.spp, o.threads), indent=1))
                    version, seconds, setup, cpu = RUN[name](o, job_file, job, scene_file, out, o.spp, o.seed + repeat)
                    relmse, off = errors(out, o.refs, scene)
                except (RuntimeError, OSError, KeyError, ValueError) as e:
                    failures.append(f"{scene} {name} repeat {repeat}: {e!r}")
                    print(failures[-1], file=sys.stderr, flush=True)
                    continue
                row = {"scene": scene, "renderer": name, "version": version, "spp": o.spp, "seconds": seconds, "cpu": cpu, "relmse": relmse,
                       "e_x_t": None if relmse is None else relmse * seconds,
                       "e_x_cpu": None if relmse is None or cpu is None else relmse * cpu, "repeat": repeat,
                       "setup_seconds": setup, "mean_off": off}
                rows.append(row)
                loads.append(os.getloadavg()[0])
                print(f"{scene} {name} repeat {repeat}: {seconds:.3f} s, relMSE {show(relmse, 4)}, e x t {show(row['e_x_t'], 4)}, e x cpu {show(row['e_x_cpu'], 4)}, "
                      f"load {loads[-1]:.2f}", flush=True)
                with open(o.out / "peers.csv", "w", newline="") as f:
                    w = csv.DictWriter(f, FIELDS)
                    w.writeheader()
                    w.writerows({k: "" if v is None else v for k, v in r.items()} for r in rows)
    table = markdown(rows, o, loads, failures)
    (o.out / "peers.md").write_text(table)
    print(table)
    sys.exit(1 if failures or not rows else 0)


if __name__ == "__main__":
    main()

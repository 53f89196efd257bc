#!/usr/bin/env bash
# A layer beside R, G, B, A in an EXR, in whatever part, leaves Blender's `Image.pixels` empty; in the
# same part it makes Mitsuba refuse the file as a texture, and a second alpha makes `Bitmap.split` fail.
#
# Versions: bpy 5.0.1, mitsuba 3.9.1, OpenEXR 3.5.3 (Python 3.11, which bpy 5.0.1 needs).
# Expected: further channels `layer.channel` are ignored by what wants the picture (OpenEXR, "Technical
# Introduction", layers: "an image file reader that doesn't support layers" sees R, G, B, A).
# Done: files of 32 x 16 pixels with OpenEXR's module; loaded by both.
# Seen on 2026-11-29: see `expected` below. What it means for Pileus: the decision
# "Layers stand beside the image" in docs/decisions.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3.11}" -m venv venv
venv/bin/pip install -q bpy==5.0.1 mitsuba==3.9.1 OpenEXR==3.5.3

cat > write.py <<'PY'
import numpy as np, OpenEXR
rgba = list("RGBA")
def part(channels, name=None):
    pixels = {c: np.full((16, 32), 0.5, dtype=np.float32) for c in channels}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    return (header, pixels) if name is None else OpenEXR.Part(header, pixels, name=name)
for name, channels in [
    ("a_picture", rgba),
    ("b_layer", rgba + ["samples.Y"]),
    ("c_second_alpha", rgba + ["variance." + c for c in rgba]),
]:
    OpenEXR.File(*part(channels)).write(name + ".exr")
OpenEXR.File([part(rgba, "rgba"), part(["samples.Y"], "samples")]).write("d_parts.exr")
PY

cat > blender.py <<'PY'
import bpy, glob
for name in sorted(glob.glob("*.exr")):
    image = bpy.data.images.load(name)
    print("Blender", name, len(image.pixels))
PY

cat > mitsuba_reads.py <<'PY'
import glob, mitsuba as mi
mi.set_variant("scalar_rgb")
def works(action):
    try:
        action()
        return "works"
    except Exception:
        return "refused"
for name in sorted(glob.glob("*.exr")):
    bitmap = mi.Bitmap(name)
    texture = lambda: mi.load_dict({"type": "bitmap", "filename": name})
    print("Mitsuba", name, "split", works(bitmap.split) + ",", "texture", works(texture))
PY

venv/bin/python write.py
{ venv/bin/python blender.py; venv/bin/python mitsuba_reads.py; } | grep -E '^(Blender|Mitsuba) ' > seen
cat > expected <<'TXT'
Blender a_picture.exr 2048
Blender b_layer.exr 0
Blender c_second_alpha.exr 0
Blender d_parts.exr 0
Mitsuba a_picture.exr split works, texture works
Mitsuba b_layer.exr split works, texture refused
Mitsuba c_second_alpha.exr split refused, texture refused
Mitsuba d_parts.exr split works, texture works
TXT
diff expected seen && echo "as described"

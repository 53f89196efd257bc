#!/usr/bin/env bash
# Crate: gltf 1.4.1 (crates.io), the reader of most Rust programs.
#
# Three things that glTF 2.0 allows stop it, each by an error of its JSON layer and not of its
# validation, so that `Gltf::from_slice_without_validation` refuses them as well:
#   1. a scene without `nodes` (the property is optional, an empty array is forbidden: an empty
#      scene cannot be written in any other way);
#   2. a whole number that is written with a fraction of zero (`"mesh": 0.0`), which JSON does not
#      tell from `0` and which writers in JavaScript, Lua or PHP may produce;
#   3. an animation channel whose target has no `node`, which is how KHR_animation_pointer
#      writes its channels.
# A reader that wants such files has to normalise the JSON before the crate sees it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
mkdir src
cat > Cargo.toml <<'T'
[package]
name = "finding"
version = "0.0.0"
edition = "2021"
[dependencies]
gltf = { version = "=1.4.1", default-features = false }
gltf-json = "=1.4.1"
serde_json = "1"
T
cat > src/main.rs <<'T'
fn main() {
    let asset = r#""asset": {"version": "2.0"}"#;
    let cases = [
        ("plain", format!(r#"{{{asset}, "scenes": [{{"nodes": [0]}}], "nodes": [{{}}]}}"#)),
        ("scene without nodes", format!(r#"{{{asset}, "scenes": [{{}}]}}"#)),
        (
            "whole number as 0.0",
            format!(r#"{{{asset}, "scene": 0.0, "scenes": [{{"nodes": [0]}}], "nodes": [{{}}]}}"#),
        ),
        (
            "animation target without node",
            format!(
                r#"{{{asset}, "scenes": [{{"nodes": [0]}}], "nodes": [{{}}],
                "extensionsUsed": ["KHR_animation_pointer"],
                "buffers": [{{"byteLength": 16, "uri": "data:application/octet-stream;base64,AAAAAAAAgD8AAAAAAACAPw=="}}],
                "bufferViews": [{{"buffer": 0, "byteLength": 8}}, {{"buffer": 0, "byteOffset": 8, "byteLength": 8}}],
                "accessors": [
                  {{"bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1]}},
                  {{"bufferView": 1, "componentType": 5126, "count": 2, "type": "SCALAR"}}],
                "animations": [{{"samplers": [{{"input": 0, "output": 1}}], "channels": [{{"sampler": 0,
                  "target": {{"path": "pointer", "extensions": {{"KHR_animation_pointer": {{"pointer": "/nodes/0/weights/0"}}}}}}}}]}}]}}"#
            ),
        ),
    ];
    for (name, text) in cases {
        match gltf::Gltf::from_slice_without_validation(text.as_bytes()) {
            Ok(_) => println!("{name}: read"),
            Err(error) => println!("{name}: {error}"),
        }
    }
}
T
nice cargo run -q > seen
cat seen
grep -qx 'plain: read' seen
grep -q '^scene without nodes: .*missing field `nodes`' seen
grep -q '^whole number as 0.0: .*invalid type: floating point `0.0`' seen
grep -q '^animation target without node: .*missing field `node`' seen
echo "as described"

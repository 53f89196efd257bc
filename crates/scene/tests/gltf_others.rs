//! glTF as others write it: what exporters, converters and people make of the format.

use pileus_media::Bounds3;
use std::path::{Path, PathBuf};

use base64::Engine;
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3, Vec3};
use pileus_scene::gltf::{self, GltfScene, GltfSurfaces};
use pileus_scene::volume::DefaultScale;
use pileus_scene::{
    CameraRequest, Error, GlassRule, Hint, Light, Loaded, Place, Projection, Scene, SceneRequest,
    Surfaces, VolumeSource, VolumeSpec,
};
use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;
use serde_json::{Value, json};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn conformance(name: &str) -> PathBuf {
    root().join("tests/data/conformance").join(name)
}

fn read(file: &Value) -> Result<(GltfScene, GltfSurfaces), Error> {
    let text = file.to_string();
    gltf::parse_with_surfaces("folder/a.gltf", text.as_bytes(), 683.0, GlassRule::default())
}

fn error(file: &Value) -> Error {
    read(file).map(|_| ()).expect_err("an error")
}

/// A glTF file in the making, with one buffer.
#[derive(Default)]
struct File {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

const F32: u32 = 5126;
const U8: u32 = 5121;
const U16: u32 = 5123;
const I16: u32 = 5122;

impl File {
    fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views
            .push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()}));
        self.bytes.extend(bytes);
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1, "componentType": component, "type": kind,
            "count": count,
        }));
        self.accessors.len() - 1
    }

    fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let n = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, F32, kind, values.len() / n)
    }

    fn shorts(&mut self, kind: &str, values: &[u16], count: usize) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, U16, kind, count)
    }

    fn data(&self) -> String {
        let data = base64::engine::general_purpose::STANDARD.encode(&self.bytes);
        format!("data:application/octet-stream;base64,{data}")
    }

    /// The file with these nodes, all of them roots unless `more` says otherwise.
    fn json(&self, nodes: Value, more: Value) -> Value {
        let count = nodes.as_array().map_or(0, Vec::len);
        let mut file = json!({
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": (0..count).collect::<Vec<_>>()}],
            "nodes": nodes,
        });
        if !self.bytes.is_empty() {
            file["buffers"] = json!([{"byteLength": self.bytes.len(), "uri": self.data()}]);
            file["bufferViews"] = json!(self.views);
            file["accessors"] = json!(self.accessors);
        }
        for (key, value) in more.as_object().unwrap() {
            file[key] = value.clone();
        }
        file
    }
}

/// A unit square in the plane z = 0, as a mesh, with coordinates.
fn square(file: &mut File) -> Value {
    let position = file.floats("VEC3", &[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]);
    let uv = file.floats("VEC2", &[0., 1., 1., 1., 1., 0., 0., 0.]);
    json!({"primitives": [{
        "attributes": {"POSITION": position, "TEXCOORD_0": uv}, "mode": 6,
    }]})
}

fn lights() -> Value {
    json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 683}, {"type": "directional"},
        {"type": "spot", "spot": {"outerConeAngle": 0.5}},
    ]}})
}

fn light(index: usize) -> Value {
    json!({"KHR_lights_punctual": {"light": index}})
}

/// Height of what a ray downwards at (x, y) meets.
fn height(surfaces: &Surfaces, x: f64, y: f64) -> Option<f64> {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let hit = surfaces.intersect(DVec3::new(x, y, 100.0), Vec3::NEG_Z, 1000.0, &mut rng)?;
    Some(100.0 - hit.t)
}

/// Unit normal for shading there.
fn normal(surfaces: &Surfaces, x: f64, y: f64) -> Vec3 {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let hit = surfaces.intersect(DVec3::new(x, y, 100.0), Vec3::NEG_Z, 1000.0, &mut rng).unwrap();
    surfaces.interaction(&hit, Vec3::NEG_Z).shading_normal
}

fn load(path: &Path, camera: CameraRequest) -> Result<Loaded, Error> {
    Scene::load(SceneRequest {
        gltf: Some((path.to_owned(), 683.0)),
        volumes: Vec::new(),
        volume_place: &|_, _| Place::default(),
        camera,
        lens: None,
        lights: Vec::new(),
        environment: None,
        resolution: None,
        default_scale: DefaultScale::One,
        glass_rule: GlassRule::default(),
    })
}

const AUTO: CameraRequest = CameraRequest::Auto { fov_y_degrees: 35.0, orbit: None };

/// A folder with a glTF file in it.
fn folder_of(file: &Value) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    std::fs::write(&path, file.to_string()).unwrap();
    (folder, path)
}

#[test]
fn hidden_nodes_hide_all_that_is_below() {
    let hidden = |visible: Value| json!({"KHR_node_visibility": {"visible": visible}});
    let mut file = File::default();
    let mesh = square(&mut file);
    let volume = json!({"homogeneous": {"sigma_t": 1, "bounds": [[0, 0, 0], [1, 1, 1]]}});
    let mut below = light(0);
    below["PILEUS_volume"] = volume.clone();
    below["KHR_node_visibility"] = json!({"visible": true});
    let file_with = |first: Value, extras: Value| {
        file.json(
            json!([
                {"mesh": 0, "extensions": first, "extras": extras, "children": [1]},
                // Its own word does not help it; cameras are not hidden.
                {"mesh": 0, "extensions": below, "camera": 0, "children": [2]},
                {"mesh": 0, "extensions": {"PILEUS_volume": volume}},
            ]),
            json!({
                "scenes": [{"nodes": [0]}], "meshes": [mesh], "extensions": lights(),
                "cameras": [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}],
                "extensionsUsed": ["KHR_node_visibility", "KHR_lights_punctual"],
                "extensionsRequired": ["KHR_node_visibility"],
            }),
        )
    };
    for (first, extras, is_hidden) in [
        (hidden(json!(false)), json!({}), true),
        (hidden(json!(true)), json!({}), false),
        (json!({"KHR_node_visibility": {}}), json!({}), false),
        (json!({}), json!({"a": 1}), false),
        // What three.js makes of an extension that it does not know.
        (json!({}), json!({"gltfExtensions": hidden(json!(false))}), true),
        (hidden(json!(true)), json!({"gltfExtensions": hidden(json!(false))}), false),
    ] {
        let (scene, surfaces) = read(&file_with(first.clone(), extras)).unwrap();
        let found = (scene.meshes.len(), scene.lights.len(), scene.volumes.len());
        assert_eq!(found, if is_hidden { (0, 0, 0) } else { (3, 1, 2) }, "{first}");
        assert_eq!(surfaces.surfaces.is_some(), !is_hidden);
        assert_eq!(scene.cameras.len(), 1);
        assert_eq!(scene.notes.iter().any(|note| note.contains("hidden")), is_hidden);
        assert!(scene.not_modelled.is_empty(), "{:?}", scene.not_modelled);
    }
    let wrong = error(&file_with(hidden(json!("no")), json!({})));
    assert!(wrong.to_string().contains("`visible`"), "{wrong}");

    // Hidden from the middle of the tree on, and instanced.
    let mut file = File::default();
    let mesh = square(&mut file);
    let shifts = file.floats("VEC3", &[0., 0., 0., 5., 0., 0.]);
    let instanced = json!({"attributes": {"TRANSLATION": shifts}});
    let (scene, _) = read(&file.json(
        json!([
            {"children": [1, 2]},
            {"mesh": 0, "extensions": {
                "KHR_node_visibility": {"visible": false}, "EXT_mesh_gpu_instancing": instanced,
                "PILEUS_volume": {"homogeneous": {"sigma_t": 1}},
            }},
            {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": instanced}},
        ]),
        json!({"scenes": [{"nodes": [0]}], "meshes": [mesh]}),
    ))
    .unwrap();
    assert_eq!((scene.meshes.len(), scene.volumes.len()), (1, 0));
}

#[test]
fn extensions_that_were_moved_to_extras_are_read_or_named() {
    let nodes = json!([{"extras": {"gltfExtensions": {
        "PILEUS_volume": {"vdb": "a%20b.vdb"}, "VENDOR_thing": {},
    }}}]);
    let materials = json!([{"extras": {"gltfExtensions": {"KHR_materials_x": {}}}}, {"extras": 3}]);
    let file = File::default().json(nodes, json!({"materials": materials}));
    let (scene, _) = read(&file).unwrap();
    let [volume] = scene.volumes.as_slice() else { panic!("{:?}", scene.volumes) };
    assert_eq!(Path::new(volume.spec.vdb.as_ref().unwrap()), Path::new("folder/a b.vdb"));
    assert_eq!(volume.pointer, "/nodes/0/extras/gltfExtensions/PILEUS_volume");
    let listed = scene.not_modelled.join(" ");
    assert!(listed.contains("KHR_materials_x, VENDOR_thing"), "{listed}");
    let wrong = json!([{"extras": {"gltfExtensions": {"PILEUS_volume": {"vbd": "a"}}}}]);
    let wrong = error(&File::default().json(wrong, json!({})));
    let part = wrong.place().part.clone().unwrap();
    assert_eq!(part, "/nodes/0/extras/gltfExtensions/PILEUS_volume/vbd");
}

/// A file with every kind of integer that glTF has.
fn everything() -> Value {
    let mut file = File::default();
    let mut mesh = square(&mut file);
    let primitive = &mut mesh["primitives"][0];
    let joints = file.shorts("VEC4", &[0, 1, 0, 0].repeat(4), 4);
    let weights = file.floats("VEC4", &[0.5, 0.5, 0., 0.].repeat(4));
    let shift = file.floats("VEC3", &[0., 0., 2.].repeat(4));
    let bind = file.floats("MAT4", &DMat4::IDENTITY.as_mat4().to_cols_array().repeat(2));
    primitive["attributes"]["JOINTS_0"] = json!(joints);
    primitive["attributes"]["WEIGHTS_0"] = json!(weights);
    primitive["targets"] = json!([{"POSITION": shift}]);
    primitive["material"] = json!(0);
    primitive["indices"] = json!(file.shorts("SCALAR", &[0, 1, 2, 3], 4));
    mesh["weights"] = json!([1]);
    let shifts = file.floats("VEC3", &[0., 0., 0., 5., 0., 0.]);
    let sparse = file.shorts("SCALAR", &[1], 1);
    let changed = file.floats("VEC3", &[7., 0., 0.]);
    let views = |accessor: usize| file.accessors[accessor]["bufferView"].clone();
    let sparse = json!({
        "count": 1, "indices": {"bufferView": views(sparse), "componentType": U16},
        "values": {"bufferView": views(changed)},
    });
    file.accessors[shifts]["sparse"] = sparse;
    let instanced = json!({"attributes": {"TRANSLATION": shifts}});
    file.json(
        json!([
            {"mesh": 0, "skin": 0},
            {"translation": [0, 0, 1], "name": "joint"},
            {"translation": [0, 0, 3], "name": "joint"},
            {"camera": 0, "translation": [1, 2, 3]},
            {"extensions": {
                "KHR_lights_punctual": {"light": 1}, "EXT_mesh_gpu_instancing": instanced,
                "PILEUS_volume": {"vdb": "a_##.vdb", "frame": 12, "law": {"type": "erlang", "n": 3}},
            }},
            {"extras": {"pileus_vdb": "a_##.vdb", "pileus_frame": 12}},
        ]),
        json!({
            "scene": 1,
            "scenes": [{"name": "empty"}, {"nodes": [0, 1, 2, 3, 4, 5]}],
            "meshes": [mesh],
            "skins": [{"joints": [1, 2], "inverseBindMatrices": bind, "skeleton": 1}],
            "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}],
            "materials": [{"alphaCutoff": 1, "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0, "texCoord": 0}, "metallicFactor": 0,
            }}],
            "textures": [{"source": 0, "sampler": 0}],
            "samplers": [{"magFilter": 9728, "wrapS": 10497}],
            "images": [{"uri": "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8BQDwAEhQGAhKmMIQAAAABJRU5ErkJggg=="}],
            "extensions": lights(),
            "animations": [{"channels": [
                // What `KHR_animation_pointer` writes: a target without a node.
                {"sampler": 0, "target": {"path": "pointer", "extensions": {
                    "KHR_animation_pointer":
                        {"pointer": "/nodes/1/extensions/KHR_node_visibility/visible"}}}},
                {"sampler": 0, "target": {"node": 1, "path": "translation"}},
            ], "samplers": [{"input": 0, "output": 0}]}],
            "extensionsRequired": ["KHR_animation_pointer"],
        }),
    )
}

/// The text of a value with every whole number written by `write`.
fn written(value: &Value, write: &dyn Fn(i64) -> String) -> String {
    match value {
        Value::Number(number) => number.as_i64().map_or(number.to_string(), write),
        Value::Array(values) => {
            let values: Vec<String> = values.iter().map(|v| written(v, write)).collect();
            format!("[{}]", values.join(", "))
        }
        Value::Object(map) => {
            let members = map.iter().map(|(k, v)| format!("{}: {}", json!(k), written(v, write)));
            format!("{{{}}}", members.collect::<Vec<_>>().join(",\n"))
        }
        other => other.to_string(),
    }
}

#[test]
fn whole_numbers_and_animations_are_read_however_they_are_written() {
    let file = everything();
    let (scene, surfaces) = read(&file).unwrap();
    let surfaces = surfaces.surfaces.unwrap();
    // The square stands at 0, its target adds 2, its joints 1 and 3 by halves.
    assert_eq!(height(&surfaces, 0.5, 0.5), Some(4.0));
    assert_eq!((scene.volumes.len(), scene.lights.len(), scene.cameras.len()), (3, 2, 1));
    assert_eq!(scene.volumes[1].to_world.translation, DVec3::new(7.0, 0.0, 0.0));
    assert_eq!(scene.volumes[0].spec.frame, Some(12));
    assert_eq!(scene.volumes[2].spec.frame, Some(12));
    assert_eq!(scene.counts.animations, 1);
    assert!(scene.not_modelled.iter().any(|item| item.contains("rest pose")));
    assert!(scene.notes.iter().any(|note| note.contains("scene 1 of 2")), "{:?}", scene.notes);
    for write in [
        &|n: i64| format!("{n}.0") as String,
        &|n: i64| format!("{n}e0"),
        &|n: i64| format!("{n}.000E+00"),
        &|n: i64| if n == 0 { "0e-1".into() } else { format!("{n}0e-1") },
    ] as [&dyn Fn(i64) -> String; 4]
    {
        let text = written(&file, write);
        let again = gltf::parse_with_surfaces(
            "folder/a.gltf",
            text.as_bytes(),
            683.0,
            GlassRule::default(),
        );
        let (again, found) = again.unwrap_or_else(|error| panic!("{error}\n{text}"));
        assert_eq!(again.volumes.len(), scene.volumes.len());
        for (a, b) in again.volumes.iter().zip(&scene.volumes) {
            assert_eq!((&a.spec, &a.to_world), (&b.spec, &b.to_world));
        }
        assert_eq!((&again.lights, &again.cameras), (&scene.lights, &scene.cameras));
        assert_eq!((&again.meshes, again.counts), (&scene.meshes, scene.counts));
        assert_eq!(height(&found.surfaces.unwrap(), 0.5, 0.5), Some(4.0));
    }
    // What is not whole stays an error, at its place in the text as it was written.
    let text = written(&file, &|n| if n == 5126 { "5126.5".into() } else { format!("{n}.0") });
    let error = gltf::parse("a.gltf", text.as_bytes(), 683.0).unwrap_err();
    let line = text.lines().position(|line| line.contains("5126.5")).unwrap() + 1;
    assert_eq!(error.place().line, Some(line), "{error}");
    // A scene of nothing is valid.
    let empty = json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{}]});
    let (scene, surfaces) = read(&empty).unwrap();
    assert!(scene.meshes.is_empty() && surfaces.surfaces.is_none());
}

#[test]
fn data_uris_and_backslashes_are_read_in_buffers_images_and_volumes() {
    let mut file = File::default();
    let mesh = {
        let mut mesh = square(&mut file);
        mesh["primitives"][0]["material"] = json!(0);
        mesh
    };
    let text = |buffer: &str, image: &str, volume: Value| {
        let mut file = file.json(
            json!([{"mesh": 0}, volume]),
            json!({
                "meshes": [mesh],
                "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
                "textures": [{"source": 0}],
                "images": [{"uri": image}],
            }),
        );
        file["buffers"][0]["uri"] = json!(buffer);
        file
    };
    let png = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8BQDwAEhQGAhKmMIQAAAABJRU5ErkJggg==";
    let bytes = base64::engine::general_purpose::STANDARD.encode(&file.bytes);
    let broken_lines = |data: &str| {
        let lines: Vec<&str> =
            data.as_bytes().chunks(60).map(|c| std::str::from_utf8(c).unwrap()).collect();
        lines.join("\r\n")
    };
    let percent = |data: &str| data.replace('+', "%2B").replace('/', "%2f").replace('=', "%3D");
    let unpadded = |data: &str| data.trim_end_matches('=').to_owned();
    let url = |data: &str| data.replace('+', "-").replace('/', "_");
    for change in [&broken_lines as &dyn Fn(&str) -> String, &percent, &unpadded, &url] {
        let [buffer, image] = [&bytes[..], png]
            .map(|data| format!("data:application/octet-stream;base64,{}", change(data)));
        let (_, found) = read(&text(&buffer, &image, json!({}))).unwrap();
        assert_eq!(height(&found.surfaces.unwrap(), 0.5, 0.5), Some(0.0));
    }
    let whole = format!("data:image/png;base64,{png}");
    let damaged = error(&text("data:;base64,A!", &whole, json!({})));
    assert_eq!(damaged.place().part.as_deref(), Some("/buffers/0/uri"));

    // Names with backslashes and percent signs, in buffers, images and volumes alike.
    let volumes = |name: &str| {
        [
            json!({"extensions": {"PILEUS_volume": {"vdb": name}}}),
            json!({"extras": {"pileus_volume": {"vdb": name.replace("%20", " ")}}}),
            json!({"extras": {"pileus_vdb": format!("//{}", name.replace("%20", " "))}}),
        ]
    };
    for volume in volumes(r"sub\\..\\sub\\a%20b.vdb".replace(r"\\", r"\").as_str()) {
        let (folder, path) = folder_of(&text(r"sub\a%20b.bin", r"sub\100%.png", volume));
        let sub = folder.path().join("sub");
        std::fs::create_dir(&sub).unwrap();
        std::fs::write(sub.join("a b.bin"), &file.bytes).unwrap();
        let png = base64::engine::general_purpose::STANDARD.decode(png).unwrap();
        std::fs::write(sub.join("100%.png"), png).unwrap();
        std::fs::copy(conformance("names_same.vdb"), sub.join("a b.vdb")).unwrap();
        let loaded = load(&path, AUTO).unwrap();
        assert_eq!(loaded.scene.volumes.len(), 1);
        assert!(loaded.scene.surfaces.is_some());
    }
}

/// The posed place of a vertex by the formula of glTF 2.0, section 3.7.3.3.
fn posed(joints: &[(f64, DAffine3, DMat4)], vertex: DVec3) -> DVec3 {
    joints
        .iter()
        .map(|(weight, world, bind)| {
            (DMat4::from(*world) * *bind).transform_point3(vertex) * *weight
        })
        .sum()
}

#[test]
fn skins_and_morph_targets_stand_at_rest() {
    // Two joints, the second turned, scaled and far away; the mesh's node elsewhere altogether.
    let turn = DQuat::from_axis_angle(DVec3::new(0.3, 0.2, 1.0).normalize(), 0.7);
    let first = DAffine3::from_translation(DVec3::new(10.0, 20.0, 3.0));
    let second = first
        * DAffine3::from_scale_rotation_translation(DVec3::new(2.0, 1.0, 1.5), turn, DVec3::X);
    let bind = [
        DMat4::from_translation(DVec3::new(-0.5, 0.0, 0.25)),
        DMat4::from_scale_rotation_translation(
            DVec3::splat(0.5),
            DQuat::from_rotation_z(0.2),
            DVec3::Y,
        ),
    ];
    let corners = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y];
    let shift = DVec3::new(0.25, 0.0, 0.5);
    let weights_of = [[1.0, 0.0], [0.75, 0.25], [0.5, 0.5], [0.0, 1.0]];
    for (case, mirrored) in [("floats", 1.0), ("bytes", 1.0), ("two sets", 1.0), ("floats", -1.0)] {
        let mut file = File::default();
        let mut mesh = square(&mut file);
        let attributes = &mut mesh["primitives"][0]["attributes"];
        let normals = file.floats("VEC3", &[0., 0., 1.].repeat(4));
        attributes["NORMAL"] = json!(normals);
        let (joints, weights): (Vec<u16>, Vec<f32>) = match case {
            "two sets" => {
                let second: Vec<f32> =
                    weights_of.iter().flat_map(|w| [w[1] as f32, 0.0, 0.0, 0.0]).collect();
                let joints = file.shorts("VEC4", &[1, 0, 0, 0].repeat(4), 4);
                attributes["JOINTS_1"] = json!(joints);
                attributes["WEIGHTS_1"] = json!(file.floats("VEC4", &second));
                let first = weights_of.iter().flat_map(|w| [w[0] as f32, 0.0, 0.0, 0.0]);
                ([0, 0, 0, 0].repeat(4), first.collect())
            }
            _ => {
                let all = weights_of.iter().flat_map(|w| [w[0] as f32, w[1] as f32, 0.0, 0.0]);
                ([0, 1, 0, 0].repeat(4), all.collect())
            }
        };
        if case == "bytes" {
            let joints: Vec<u8> = joints.iter().map(|&j| j as u8).collect();
            attributes["JOINTS_0"] = json!(file.accessor(&joints, U8, "VEC4", 4));
            let bytes: Vec<u8> = weights.iter().map(|w| (w * 255.0).round() as u8).collect();
            let weights = file.accessor(&bytes, U8, "VEC4", 4);
            file.accessors[weights]["normalized"] = json!(true);
            attributes["WEIGHTS_0"] = json!(weights);
        } else {
            attributes["JOINTS_0"] = json!(file.shorts("VEC4", &joints, 4));
            attributes["WEIGHTS_0"] = json!(file.floats("VEC4", &weights));
        }
        let flat: Vec<f32> = bind.iter().flat_map(|m| m.as_mat4().to_cols_array()).collect();
        let matrices = file.floats("MAT4", &flat);
        let target = file.floats("VEC3", &shift.as_vec3().to_array().repeat(4));
        mesh["primitives"][0]["targets"] = json!([{}, {"POSITION": target}]);
        // The node's weights count, not the mesh's.
        mesh["weights"] = json!([1, -7]);
        let columns = |m: &DAffine3| DMat4::from(*m).to_cols_array().to_vec();
        let mirror = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(mirrored, 1.0, 1.0)));
        let nodes = json!([
            {"mesh": 0, "skin": 0, "translation": [-50, 3, 9], "scale": [4, 4, 4], "weights": [0, 0.5]},
            {"matrix": columns(&mirror), "children": [2]},
            {"matrix": columns(&first), "children": [3]},
            {"matrix": columns(&(first.inverse() * second))},
        ]);
        let text = file.json(
            nodes,
            json!({
                "scenes": [{"nodes": [0, 1]}], "meshes": [mesh],
                "skins": [{"joints": [2, 3], "inverseBindMatrices": matrices}],
            }),
        );
        let (scene, found) = read(&text).unwrap();
        assert!(scene.not_modelled.is_empty(), "{:?}", scene.not_modelled);
        let surfaces = found.surfaces.unwrap();
        let expected: Vec<DVec3> = corners
            .iter()
            .zip(weights_of)
            .map(|(corner, weights)| {
                let joints =
                    [(weights[0], mirror * first, bind[0]), (weights[1], mirror * second, bind[1])];
                posed(&joints, *corner + shift * 0.5)
            })
            .collect();
        let Bounds3 { low, high } = surfaces.bounds();
        let around =
            |pick: fn(DVec3, DVec3) -> DVec3| expected.iter().copied().reduce(pick).unwrap();
        // Weights in bytes are off by half a step.
        let error = if case == "bytes" { 0.06 } else { 1e-5 };
        assert!((low - around(DVec3::min)).length() < error, "{case}: {low} {expected:?}");
        assert!((high - around(DVec3::max)).length() < error, "{case}: {high} {expected:?}");
        // Inside the first triangle of the fan: its height, and a normal that faces up.
        let middle = (expected[0] + expected[1] + expected[2]) / 3.0;
        let z = height(&surfaces, middle.x, middle.y).unwrap();
        assert!((z - middle.z).abs() < error * 2.0, "{case}: {z} {middle}");
        assert!(normal(&surfaces, middle.x, middle.y).z > 0.5);
    }
}

#[test]
fn morph_targets_follow_the_weights_of_node_and_mesh() {
    let mut file = File::default();
    let mut mesh = square(&mut file);
    let normals = file.floats("VEC3", &[0., 0., 1.].repeat(4));
    mesh["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
    let up = file.floats("VEC3", &[0., 0., 3.].repeat(4));
    let tilt = file.floats("VEC3", &[1., 0., 0.].repeat(4));
    mesh["primitives"][0]["targets"] = json!([{"POSITION": up, "NORMAL": tilt}]);
    mesh["weights"] = json!([0.5]);
    let text = file.json(
        json!([
            {"mesh": 0},
            {"mesh": 0, "weights": [1], "translation": [2, 0, 0]},
            {"mesh": 0, "weights": [0], "translation": [4, 0, 0]},
            {"mesh": 0, "weights": [1, 9], "translation": [6, 0, 0]},
        ]),
        json!({"meshes": [mesh]}),
    );
    let (scene, found) = read(&text).unwrap();
    assert!(scene.not_modelled.is_empty(), "{:?}", scene.not_modelled);
    let surfaces = found.surfaces.unwrap();
    for (x, expected) in [(0.5, 1.5), (2.5, 3.0), (4.5, 0.0), (6.5, 3.0)] {
        assert_eq!(height(&surfaces, x, 0.5), Some(expected), "{x}");
    }
    assert!((normal(&surfaces, 2.5, 0.5) - Vec3::new(1.0, 0.0, 1.0).normalize()).length() < 1e-6);
    assert!((normal(&surfaces, 4.5, 0.5) - Vec3::Z).length() < 1e-6);
    // Two shapes, the mesh's and the node's; the same shape is kept once.
    assert_eq!(surfaces.counts().meshes, 3);
}

#[test]
fn broken_skins_are_errors() {
    let mut file = File::default();
    let mut mesh = square(&mut file);
    let joints = file.shorts("VEC4", &[0, 5, 0, 0].repeat(4), 4);
    mesh["primitives"][0]["attributes"]["JOINTS_0"] = json!(joints);
    let weights = file.floats("VEC4", &[0.5, 0.5, 0., 0.].repeat(4));
    mesh["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(weights);
    let one = file.floats("MAT4", &DMat4::IDENTITY.as_mat4().to_cols_array());
    let with = |skin: Value| {
        file.json(
            json!([{"mesh": 0, "skin": 0}, {"name": "joint"}]),
            json!({"meshes": [mesh], "skins": [skin]}),
        )
    };
    for (skin, says) in [
        (json!({"joints": [1]}), "joint beyond the skin's 1"),
        (json!({"joints": []}), "no joints"),
        (json!({"joints": [9]}), "joint 9"),
        (json!({"joints": [1, 1], "inverseBindMatrices": one}), "fewer inverse bind"),
        (json!({"joints": [1], "inverseBindMatrices": joints}), "VEC4"),
    ] {
        let error = error(&with(skin));
        assert!(matches!(error, Error::Invalid { .. }));
        let said = format!("{error}").to_lowercase();
        assert!(said.contains(&says.to_lowercase()), "{error}");
    }
    // A joint that is not part of the scene has a place all the same.
    let mut apart = with(json!({"joints": [1, 1, 1, 1, 1, 1]}));
    apart["scenes"] = json!([{"nodes": [0]}]);
    apart["nodes"][1] = json!({"name": "joint", "translation": [0, 0, 5]});
    let apart = read(&apart).unwrap().1.surfaces.unwrap();
    assert_eq!(height(&apart, 0.5, 0.5), Some(5.0));
    let mut lost = with(json!({"joints": [1]}));
    lost["nodes"][0]["skin"] = json!(3);
    assert!(error(&lost).to_string().contains("skin 3"));
    // Many nodes that each pose one mesh with many vertices.
    let mut file = File::default();
    let position = file.floats("VEC3", &[0.0; 3 * 3000]);
    let shift = file.floats("VEC3", &[0.0; 3 * 3000]);
    let nodes: Vec<Value> =
        (0..2000).map(|i| json!({"mesh": 0, "weights": [f64::from(i) + 0.5]})).collect();
    let mesh = json!({"primitives": [{
        "attributes": {"POSITION": position}, "targets": [{"POSITION": shift}],
    }]});
    let many = error(&file.json(json!(nodes), json!({"meshes": [mesh]})));
    assert!(matches!(many, Error::Unsupported { .. }), "{many}");
}

#[test]
fn volumes_and_lights_are_instanced() {
    let mut file = File::default();
    let shifts = file.floats("VEC3", &[-1.5, 0., 0., 1.5, 0., 0., 0., 4., 0.]);
    let turns = file.floats("VEC4", &[0., 0., 0., 1., 0., 0.6, 0., 0.8, 0., 0., 0., 1.]);
    let scales = file.floats("VEC3", &[1., 1., 1., 2., 2., 2., 0., 0., 0.]);
    let attributes = json!({"TRANSLATION": shifts, "ROTATION": turns, "SCALE": scales});
    let holds = |mut extensions: Value| {
        extensions["EXT_mesh_gpu_instancing"] = json!({"attributes": attributes});
        extensions
    };
    let volume =
        json!({"PILEUS_volume": {"homogeneous": {"sigma_t": 1, "bounds": [[0, 0, 0], [1, 1, 1]]}}});
    let text = file.json(
        json!([
            {"name": "cloud", "translation": [10, 0, 0], "extensions": holds(volume)},
            {"name": "lamp", "translation": [0, 10, 0], "extensions": holds(light(0))},
            {"extensions": holds(light(1))},
            {"name": "spot", "extensions": holds(light(2))},
            {"name": "prop", "extensions": holds(json!({})),
                "extras": {"pileus_vdb": "a.vdb"}},
        ]),
        json!({"extensions": lights()}),
    );
    let (scene, _) = read(&text).unwrap();
    let places: Vec<DVec3> = scene.volumes.iter().map(|v| v.to_world.translation).collect();
    let pair = [DVec3::new(8.5, 0.0, 0.0), DVec3::new(11.5, 0.0, 0.0)];
    assert_eq!(&places[..2], &pair);
    assert_eq!(places.len(), 4, "two nodes, of whose three instances one is nothing");
    assert!((scene.volumes[1].to_world.matrix3.determinant() - 8.0).abs() < 1e-6);
    let mut found = scene.lights.iter();
    for x in [-1.5, 1.5] {
        let Some(Light::Point(point)) = found.next() else { panic!("{:?}", scene.lights) };
        assert_eq!(point.position, DVec3::new(x, 10.0, 0.0));
        assert!((point.intensity.x - 1.0).abs() < 1e-6, "an instance's scale is not brightness");
    }
    let suns: Vec<Vec3> = found
        .by_ref()
        .take(2)
        .map(|light| match light {
            Light::Sun(sun) => sun.to_light,
            other => panic!("{other:?}"),
        })
        .collect();
    // Half turns of 2 acos(0.8) about Y.
    assert!((suns[0] - Vec3::Z).length() < 1e-6, "{suns:?}");
    assert!((suns[1] - Vec3::new(0.96, 0.0, 0.28)).length() < 1e-6, "{suns:?}");
    assert_eq!(found.filter(|light| matches!(light, Light::Spot(_))).count(), 2);
    let flat: Vec<&String> =
        scene.warnings.iter().filter(|w| w.contains("scaled to nothing")).collect();
    assert!(
        flat.len() == 1 && flat[0].contains("5 volumes and lights") && flat[0].contains("`node 2`"),
        "{flat:?}"
    );
    // Buffers are read for that alone.
    assert!(gltf::parse("a.gltf", text.to_string().as_bytes(), 683.0).is_ok());
    let mut lost = text.clone();
    lost["buffers"][0]["uri"] = json!("none.bin");
    assert!(matches!(error(&lost), Error::Io { .. }));
    // A small file does not ask for much.
    let mut bomb = text;
    bomb["accessors"] = json!([{"componentType": F32, "type": "VEC3", "count": 4_000_000}]);
    for node in bomb["nodes"].as_array_mut().unwrap() {
        node["extensions"]["EXT_mesh_gpu_instancing"] = json!({"attributes": {"TRANSLATION": 0}});
    }
    let bomb = error(&bomb);
    assert!(bomb.to_string().contains("far more data"), "{bomb}");
}

#[test]
fn what_is_scaled_to_nothing_is_left_out() {
    let volume = json!({"PILEUS_volume": {"homogeneous": {"sigma_t": 1}}});
    let nodes = |scale: [f64; 3]| {
        json!([
            {"name": "parent", "scale": scale, "children": [1, 2, 3]},
            {"name": "cloud", "extensions": volume},
            {"name": "lamp", "extensions": light(0)},
            {"name": "sun", "extensions": light(1)},
        ])
    };
    let read = |scale: [f64; 3]| {
        let more = json!({"scenes": [{"nodes": [0]}], "extensions": lights()});
        read(&File::default().json(nodes(scale), more)).unwrap().0
    };
    for (scale, volumes, lights) in [
        ([0.0; 3], 0, 0),
        // A sheet: nothing is left of a volume, but lights still have their place and direction.
        ([1.0, 0.0, 1.0], 0, 2),
        // No direction is left, but a place.
        ([1.0, 1.0, 0.0], 0, 1),
        ([1.0, 2.0, -1.0], 1, 2),
    ] {
        let scene = read(scale);
        assert_eq!((scene.volumes.len(), scene.lights.len()), (volumes, lights), "{scale:?}");
        let left_out = 3 - volumes - lights;
        let warning = scene.warnings.join(" ");
        assert_eq!(warning.contains("scaled to nothing"), left_out > 0, "{warning}");
        assert_eq!(warning.contains("`cloud`"), volumes == 0, "{warning}");
    }
}

#[test]
fn quantised_meshes_warn_of_what_shares_their_node() {
    let mut file = File::default();
    let shorts: Vec<u8> = [0i16, 0, 0, 0, 100, 0, 0, 0, 100, 100, 0, 0]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let position = file.accessor(&shorts, I16, "VEC3", 3);
    let view = file.accessors[position]["bufferView"].as_u64().unwrap() as usize;
    file.views[view]["byteStride"] = json!(8);
    let floats = square(&mut file);
    let mesh = json!({"primitives": [{"attributes": {"POSITION": position}}]});
    let volume = json!({"PILEUS_volume": {"homogeneous": {"sigma_t": 1}}});
    let warnings = |node: Value| {
        let more = json!({
            "meshes": [mesh, floats], "extensions": lights(),
            "extensionsUsed": ["KHR_mesh_quantization"],
        });
        read(&file.json(json!([node]), more)).unwrap().0.warnings
    };
    for extensions in [&volume, &light(0)] {
        let node = json!({"name": "box", "mesh": 0, "extensions": extensions});
        let found = warnings(node);
        assert!(found.len() == 1 && found[0].contains("`box`"), "{found:?}");
        assert!(warnings(json!({"mesh": 1, "extensions": extensions})).is_empty());
    }
    let properties = json!({"mesh": 0, "extras": {"pileus_vdb": "a.vdb"}});
    assert_eq!(warnings(properties).len(), 1);
    assert!(warnings(json!({"mesh": 0})).is_empty());
}

#[test]
fn frames_come_from_custom_properties() {
    let nodes = |extras: Value| File::default().json(json!([{"extras": extras}]), json!({}));
    let (folder, path) =
        folder_of(&nodes(json!({"pileus_vdb": "smoke_####.vdb", "pileus_frame": 12})));
    let error = load(&path, AUTO).unwrap_err();
    assert!(matches!(error, Error::Vdb { .. }), "{error:?}");
    std::fs::copy(conformance("names_same.vdb"), folder.path().join("smoke_0012.vdb")).unwrap();
    assert_eq!(load(&path, AUTO).unwrap().scene.volumes.len(), 1);
    let missing = folder_of(&nodes(json!({"pileus_vdb": "smoke_####.vdb"})));
    let missing = load(&missing.1, AUTO).unwrap_err();
    assert!(missing.remedy().contains("`pileus_frame`"), "{}", missing.remedy());
    let half = error_of(&nodes(json!({"pileus_vdb": "a", "pileus_frame": 1.5})));
    assert!(half.contains("pileus_frame"), "{half}");
}

fn error_of(file: &Value) -> String {
    error(file).to_string()
}

#[test]
fn the_first_camera_that_can_be_rendered_is_taken() {
    let perspective = json!({"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}});
    let flat = json!({"type": "orthographic", "name": "Flat",
        "orthographic": {"xmag": 1, "ymag": 0, "znear": 0, "zfar": 9}});
    let node = |camera: usize, name: &str, z: f64| json!({"camera": camera, "name": name, "translation": [0, 0, z]});
    let nodes = json!([
        node(0, "A top", 1.0),
        node(1, "B flat", 2.0),
        {"camera": 1, "name": "C nothing", "scale": [0, 0, 0]},
        node(2, "D close", 4.0),
        {"camera": 1, "translation": [0, 0, 5]},
        {"extensions": {"PILEUS_volume": {"homogeneous": {"sigma_t": 1}}}},
    ]);
    let mut named = perspective.clone();
    named["name"] = json!("Camera.001");
    let cameras = json!([flat, perspective, named]);
    let mut second_is_flat = nodes.clone();
    second_is_flat[1]["camera"] = json!(0);
    let file = File::default().json(second_is_flat, json!({"cameras": cameras}));
    let (_folder, path) = folder_of(&file);
    let loaded = load(&path, AUTO).unwrap();
    assert_eq!(loaded.scene.camera.position().z, 4.0);
    assert_eq!(loaded.hints, [Hint::OtherCamera]);
    let notes = loaded.notes.join("\n");
    for said in [
        "`D close` is taken",
        "first of 5",
        "passed over: `A top`, `B flat`, `C nothing`",
        "`node 4`",
    ] {
        assert!(notes.contains(said), "{said}: {notes}");
    }
    let by_name = |name: &str| {
        load(&path, CameraRequest::Node { name: name.into(), place: Place::default() })
    };
    for (name, z) in [("D close", 4.0), ("Camera.001", 4.0), ("node 4", 5.0)] {
        assert_eq!(by_name(name).unwrap().scene.camera.position().z, z, "{name}");
    }
    assert!(matches!(by_name("A top"), Err(Error::Invalid { .. })));
    for name in ["D", ""] {
        let error = by_name(name).unwrap_err();
        assert!(error.remedy().contains("`D close`"), "{}", error.remedy());
    }
    // An orthographic one is as good as others.
    let mut with_flat = cameras.clone();
    with_flat[0]["orthographic"] = json!({"xmag": 3, "ymag": 1.5, "znear": 0, "zfar": 9});
    let file = File::default().json(nodes.clone(), json!({"cameras": with_flat}));
    let (_folder, path) = folder_of(&file);
    let loaded = load(&path, AUTO).unwrap();
    let camera = &loaded.scene.camera;
    assert_eq!(camera.position().z, 1.0);
    assert_eq!(camera.projection(), Projection::Orthographic { height: 3.0 });
    assert_eq!(camera.resolution(), [640, 320]);
    // The width follows the resolution where that has another shape: pixels stay square.
    let (left, _) = camera.ray([0.0, 160.0]);
    assert!((left - DVec3::new(-3.0, 0.0, 1.0)).length() < 1e-12, "{left}");
    for (xmag, ymag) in [(1.0, -1.0), (0.0, 1.0), (-2.0, 1.0)] {
        with_flat[0]["orthographic"] = json!({"xmag": xmag, "ymag": ymag, "znear": 0, "zfar": 9});
        let file = File::default().json(nodes.clone(), json!({"cameras": with_flat}));
        let (_folder, path) = folder_of(&file);
        let request = CameraRequest::Node { name: "A top".into(), place: Place::default() };
        let error = load(&path, request).unwrap_err();
        assert!(error.to_string().contains("xmag"), "{error}");
    }
    // None of them.
    let file = File::default()
        .json(json!([node(0, "A", 1.0), node(0, "B", 1.0)]), json!({"cameras": [cameras[0]]}));
    let (_folder, path) = folder_of(&file);
    let error = load(&path, AUTO).unwrap_err();
    assert!(error.to_string().contains("none of the scene's 2 cameras"), "{error}");
}

#[test]
fn empty_grids_and_lost_properties_are_named() {
    let (folder, path) = folder_of(
        &File::default().json(json!([{"extras": {"pileus_vdb": "empty.vdb"}}]), json!({})),
    );
    std::fs::copy(conformance("empty_grid.vdb"), folder.path().join("empty.vdb")).unwrap();
    let error = load(&path, AUTO).unwrap_err();
    assert!(error.to_string().contains("is empty"), "{error}");
    assert!(error.place().file.as_ref().unwrap().ends_with("empty.vdb"));

    let blender = json!({"version": "2.0", "generator": "Khronos glTF Blender I/O v5.0.21"});
    let mut file = File::default();
    let mesh = square(&mut file);
    let bare = File::default().json(json!([{"name": "Empty"}]), json!({"asset": blender}));
    let (_folder, path) = folder_of(&bare);
    let error = load(&path, AUTO).unwrap_err();
    assert!(error.remedy().contains("Custom Properties"), "{}", error.remedy());
    let with_mesh = file
        .json(json!([{"mesh": 0}, {"name": "Empty"}]), json!({"asset": blender, "meshes": [mesh]}));
    let (_folder, path) = folder_of(&with_mesh);
    let loaded = load(&path, AUTO).unwrap();
    assert!(loaded.notes.iter().any(|note| note.contains("Custom Properties")));
    // Neither for scenes of surfaces alone nor for other programs.
    for (nodes, asset) in [
        (json!([{"mesh": 0}]), blender.clone()),
        (json!([{"mesh": 0}, {}]), json!({"version": "2.0", "generator": "other"})),
    ] {
        let (_folder, path) =
            folder_of(&file.json(nodes, json!({"asset": asset, "meshes": [mesh]})));
        let loaded = load(&path, AUTO).unwrap();
        assert!(!loaded.notes.iter().any(|note| note.contains("Custom Properties")));
    }
}

#[test]
fn grids_of_one_name_and_files_with_z_up_are_said() {
    let load = |path: PathBuf, spec: VolumeSpec| {
        let vdb = Some(path.to_string_lossy().into_owned());
        Scene::load(SceneRequest {
            gltf: None,
            volumes: vec![VolumeSpec { vdb, ..spec }],
            volume_place: &|_, _| Place::default(),
            camera: AUTO,
            lens: None,
            lights: Vec::new(),
            environment: None,
            resolution: None,
            default_scale: DefaultScale::Cloud,
            glass_rule: GlassRule::default(),
        })
        .unwrap()
    };
    let spec = |text: &str| serde_json::from_str::<VolumeSpec>(text).unwrap();
    let loaded = load(conformance("names_same.vdb"), spec("{}"));
    assert_eq!(loaded.hints, [Hint::OtherGrid]);
    let notes = loaded.notes.join("\n");
    for said in ["3 grids are named `density`", "`density[0]` is taken", "`density[2]` from ["] {
        assert!(notes.contains(said), "{said}: {notes}");
    }
    let chosen = spec(r#"{"density": {"grid": "density[1]"}}"#);
    let notes = load(conformance("names_same.vdb"), chosen).notes.join("\n");
    assert!(!notes.contains("grids are named"), "{notes}");

    // A plume of 62 x 62 x 75 voxels by Blender; its flame is empty: it does not burn.
    let plume = root().join("scenes/assets/smoke_plume.vdb");
    let loaded = load(plume.clone(), spec("{}"));
    assert!(loaded.notes.iter().any(|note| note.contains("tallest along z")), "{:?}", loaded.notes);
    assert_eq!(loaded.hints, [Hint::ZIsUp]);
    assert!(loaded.scene.volumes[0].emission.is_none());
    for said in [
        r#"{"up_axis": "z"}"#,
        r#"{"up_axis": "y"}"#,
        r#"{"transform": {"rotation": [-0.70710678, 0, 0, 0.70710678]}}"#,
    ] {
        let notes = load(plume.clone(), spec(said)).notes.join("\n");
        assert!(!notes.contains("tallest"), "{notes}");
    }
    let notes = load(root().join("scenes/assets/cumulus_small.vdb"), spec("{}")).notes.join("\n");
    assert!(!notes.contains("tallest"), "{notes}");

    // A fire burns, unless something is said about its light.
    let fire = root().join("scenes/assets/fire_0003.vdb");
    let loaded = load(fire.clone(), spec("{}"));
    let volume = &loaded.scene.volumes[0];
    let VolumeSource::Vdb { fire: Some(chosen), .. } = &volume.source else { panic!() };
    assert!(
        loaded.notes.iter().any(|note| note.contains("grid `flame` burns")),
        "{:?}",
        loaded.notes
    );
    let emission = volume.emission.as_ref().expect("light");
    // What was chosen makes the same when it is written down.
    let written = VolumeSpec {
        emission: Some(chosen.0.clone()),
        albedo: Some(pileus_scene::volume_spec::AlbedoSpec::Constant(
            pileus_scene::volume_spec::Rgb::Grey(chosen.1),
        )),
        ..VolumeSpec::default()
    };
    let again = load(fire.clone(), written);
    let again = again.scene.volumes[0].emission.as_ref().unwrap();
    let Bounds3 { low, high } = emission.bounds_world().unwrap();
    let middle = (low + high) * 0.5;
    assert!(emission.emission(middle).max_element() > 0.0);
    assert_eq!(emission.emission(middle), again.emission(middle));
}

#[cfg(unix)]
#[test]
fn only_plain_files_are_opened_and_their_lines_not_shown() {
    let secret = "root:secret:of others";
    let mut file = File::default();
    let mesh = {
        let mut mesh = square(&mut file);
        mesh["primitives"][0]["material"] = json!(0);
        mesh
    };
    // A file that names `name` as its buffer, its image, or something of its volume.
    let with = |what: &str, name: &str| {
        let mut text = file.json(
            json!([{"mesh": 0}, {}]),
            json!({
                "meshes": [mesh],
                "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
                "textures": [{"source": 0}],
                "images": [{"uri": "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8BQDwAEhQGAhKmMIQAAAABJRU5ErkJggg=="}],
            }),
        );
        match what {
            "buffer" => text["buffers"][0]["uri"] = json!(name),
            "image" => text["images"][0]["uri"] = json!(name),
            "vdb" => text["nodes"][1] = json!({"extras": {"pileus_vdb": name}}),
            "phase" => {
                text["nodes"][1] = json!({"extras":
                    {"pileus_vdb": "a.vdb", "pileus_phase_file": name}});
            }
            _ => {
                text["nodes"][1] = json!({"extras":
                    {"pileus_vdb": "a.vdb", "pileus_law": "table", "pileus_law_file": name}});
            }
        }
        text
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    std::fs::copy(conformance("names_same.vdb"), folder.path().join("a.vdb")).unwrap();
    std::fs::write(folder.path().join("secret"), secret).unwrap();
    let made = std::process::Command::new("mkfifo").arg(folder.path().join("pipe")).status();
    assert!(made.unwrap().success());
    for what in ["buffer", "image", "vdb", "phase", "law"] {
        for name in ["pipe", "/dev/zero", ".", "secret"] {
            std::fs::write(&path, with(what, name).to_string()).unwrap();
            let error = load(&path, AUTO).unwrap_err();
            let mut said = format!("{error} {}", error.remedy());
            let mut source = std::error::Error::source(&error);
            while let Some(inner) = source {
                said.push_str(&inner.to_string());
                source = inner.source();
            }
            assert!(!said.contains("of others"), "{what} {name}: {said}");
            if name != "secret" {
                assert!(said.contains("plain file") || said.contains("not a file"), "{said}");
            }
        }
    }
}

//! Surfaces out of glTF files: every way to store them, every way to break them.

use pileus_media::Bounds3;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use base64::Engine;
use glam::{DVec3, Vec3};
use pileus_scene::gltf::{self, GltfScene, GltfSurfaces};
use pileus_scene::{Error, GlassRule, Hit, Interaction, Surfaces};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

fn asset(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/gltf").join(name)
}

/// A glTF file in the making.
#[derive(Default)]
struct File {
    bin: Vec<u8>,
    views: Vec<String>,
    accessors: Vec<String>,
}

const FLOAT: u32 = 5126;
const U8: u32 = 5121;
const U16: u32 = 5123;
const U32: u32 = 5125;
const I8: u32 = 5120;
const I16: u32 = 5122;

impl File {
    /// A view of these bytes; its number.
    fn view(&mut self, bytes: &[u8], more: &str) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let (start, length) = (self.bin.len(), bytes.len());
        self.bin.extend(bytes);
        self.views
            .push(format!(r#"{{"buffer":0,"byteOffset":{start},"byteLength":{length}{more}}}"#));
        self.views.len() - 1
    }

    fn accessor(
        &mut self,
        bytes: &[u8],
        component: u32,
        kind: &str,
        count: usize,
        more: &str,
    ) -> usize {
        let view = self.view(bytes, "");
        self.accessors.push(format!(
            r#"{{"bufferView":{view},"componentType":{component},"type":"{kind}","count":{count}{more}}}"#
        ));
        self.accessors.len() - 1
    }

    fn floats(&mut self, values: &[f32], kind: &str) -> usize {
        let n = match kind {
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 1,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, FLOAT, kind, values.len() / n, "")
    }

    /// Positions of the unit square in the plane z = 0.
    fn square(&mut self) -> usize {
        self.floats(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.], "VEC3")
    }

    fn shorts(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, U16, "SCALAR", values.len(), "")
    }

    fn json(&self, more: &str, uri: Option<&str>) -> String {
        let uri = uri.map_or(String::new(), |uri| format!(r#","uri":"{uri}""#));
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],
            "buffers":[{{"byteLength":{}{uri}}}],"bufferViews":[{}],"accessors":[{}],{more}}}"#,
            self.bin.len(),
            self.views.join(","),
            self.accessors.join(",")
        )
    }

    /// The file with its buffer as a data URI.
    fn gltf(&self, more: &str) -> String {
        let data = base64::engine::general_purpose::STANDARD.encode(&self.bin);
        self.json(more, Some(&format!("data:application/octet-stream;base64,{data}")))
    }

    fn glb(&self, more: &str) -> Vec<u8> {
        let mut json = self.json(more, None).into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut bytes = b"glTF".to_vec();
        for word in [2, 28 + json.len() as u32 + bin.len() as u32, json.len() as u32] {
            bytes.extend(word.to_le_bytes());
        }
        bytes.extend(b"JSON");
        bytes.extend(&json);
        bytes.extend((bin.len() as u32).to_le_bytes());
        bytes.extend(b"BIN\0");
        bytes.extend(&bin);
        bytes
    }
}

/// One node with one mesh of one primitive, and whatever else.
fn one(attributes: &str, more_of_primitive: &str, more: &str) -> String {
    format!(
        r#""nodes":[{{"mesh":0,"name":"it"}}],"meshes":[{{"primitives":[{{"attributes":{{{attributes}}}{more_of_primitive}}}]}}]{more}"#
    )
}

fn parse(bytes: &[u8]) -> Result<(GltfScene, GltfSurfaces), Error> {
    gltf::parse_with_surfaces("folder/a.gltf", bytes, 683.0, GlassRule::default())
}

fn surfaces(text: &str) -> Surfaces {
    parse(text.as_bytes()).unwrap().1.surfaces.expect("surfaces")
}

fn error(text: &str) -> Error {
    parse(text.as_bytes()).expect_err("an error")
}

/// What a camera's ray downwards at (x, y) meets.
fn below(surfaces: &Surfaces, x: f64, y: f64) -> Option<(Hit, Interaction)> {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let hit = surfaces.seen(DVec3::new(x, y, 10.0), Vec3::NEG_Z, 100.0, &mut rng)?;
    Some((hit, surfaces.interaction(&hit, Vec3::NEG_Z)))
}

#[test]
fn studio_and_fire_have_their_surfaces() {
    for name in ["studio.gltf", "studio.glb"] {
        let (scene, found) =
            gltf::load_with_surfaces(asset(name), 683.0, GlassRule::default()).unwrap();
        let surfaces = found.surfaces.unwrap();
        let counts = surfaces.counts();
        assert_eq!((counts.meshes, counts.instances, counts.emitters), (5, 5, 2), "{name}");
        // Three planes, a monkey and a sphere of the exporter's triangles.
        assert_eq!(counts.triangles, 6 + 968 + 2208, "{name}");
        assert!(scene.not_modelled.is_empty(), "{:?}", scene.not_modelled);
        // The area light: radiance 30 times its colour, facing down, both sides.
        let lamp = surfaces.emitters()[0];
        assert!((lamp.radiance - Vec3::new(30.0, 25.5, 18.0)).length() < 1e-3, "{lamp:?}");
        assert!(lamp.two_sided && (lamp.normal - Vec3::NEG_Y).length() < 1e-5);
        let area: f64 = surfaces.emitters().iter().map(|e| e.area).sum();
        let Bounds3 { low, high } = surfaces.instance_bounds().nth(4).unwrap();
        assert!((area - (high.x - low.x) * (high.z - low.z)).abs() < 1e-5);
        // The glass ball is closed, so that it is a body; by the letter it is a thin wall.
        assert!(surfaces.mesh_is_closed(3) && !surfaces.mesh_is_closed(0));
        assert!(found.notes.iter().any(|note| note.contains("`glass` fills closed meshes")));
        let glass = |surfaces: &Surfaces| {
            let mut rng = Pcg64Mcg::seed_from_u64(1);
            let (origin, along) = (DVec3::new(1.7, 0.5, 5.0), Vec3::NEG_Z);
            let hit = surfaces.intersect(origin, along, 9.0, &mut rng).unwrap();
            surfaces.interaction(&hit, along).parameters
        };
        let parameters = glass(&surfaces);
        assert_eq!((parameters.transmission, parameters.ior), (1.0, 1.45));
        assert!(!parameters.thin_walled);
        let letter = gltf::load_with_surfaces(asset(name), 683.0, GlassRule::Strict).unwrap();
        assert!(glass(&letter.1.surfaces.unwrap()).thin_walled);
        assert!(letter.1.notes.is_empty());
    }
    let (_, fire) =
        gltf::load_with_surfaces(asset("fire.glb"), 683.0, GlassRule::default()).unwrap();
    let counts = fire.surfaces.unwrap().counts();
    assert_eq!((counts.meshes, counts.triangles, counts.emitters), (2, 14, 0));
}

#[test]
fn buffers_come_from_chunks_data_and_files() {
    let mut file = File::default();
    let position = file.square();
    let more = one(&format!(r#""POSITION":{position}"#), r#","mode":6"#, "");
    assert_eq!(surfaces(&file.gltf(&more)).counts().triangles, 2);
    let glb = file.glb(&more);
    let counts = |bytes: &[u8]| parse(bytes).map(|found| found.1.surfaces.unwrap().counts());
    assert_eq!(counts(&glb).unwrap().triangles, 2);
    assert!(matches!(counts(&glb[..glb.len() - 1]), Err(Error::Invalid { .. })));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    let text = file.json(&more, Some("the%20data.bin"));
    std::fs::write(&path, &text).unwrap();
    let load = || gltf::load_with_surfaces(&path, 683.0, GlassRule::default());
    let missing = load().unwrap_err();
    assert!(matches!(missing, Error::Io { .. }), "{missing}");
    assert!(missing.to_string().contains("the data.bin"), "{missing}");
    std::fs::write(folder.path().join("the data.bin"), &file.bin).unwrap();
    assert!(load().unwrap().1.surfaces.is_some());
    std::fs::write(folder.path().join("the data.bin"), &file.bin[1..]).unwrap();
    let short = load().unwrap_err();
    assert!(short.to_string().contains("47 bytes, 48 are declared"), "{short}");
    for uri in
        ["http://a/b.bin", "data:x,abc", "data:x;base64,a", "data:x;base64", "data:x;base64,AAAA"]
    {
        assert!(!matches!(error(&file.json(&more, Some(uri))), Error::Io { .. }), "{uri}");
    }
    // A buffer may name no file (glTF 2.0, section 3.6.1.2): its meshes are left out.
    assert!(parse(file.json(&more, None).as_bytes()).unwrap().1.surfaces.is_none());
}

#[test]
fn modes_and_indices_make_the_right_triangles() {
    let corner = |x: f32, y: f32| [x, y, 0.0];
    let zigzag: Vec<f32> = (0..6).flat_map(|i| corner((i / 2) as f32, (i % 2) as f32)).collect();
    let fan: Vec<f32> = [corner(0., 0.), corner(2., 0.), corner(2., 1.), corner(0., 1.)].concat();
    for (mode, positions, indices) in [
        (5, &zigzag, None),
        (5, &zigzag, Some(vec![0, 1, 2, 3, 4, 5])),
        (4, &zigzag, Some(vec![0, 2, 1, 1, 2, 3, 2, 4, 3, 3, 4, 5])),
        (6, &fan, None),
    ] {
        let mut file = File::default();
        let position = file.floats(positions, "VEC3");
        let indices: Option<Vec<u16>> = indices;
        let index = indices.as_ref().map(|values| file.shorts(values));
        let index = index.map_or(String::new(), |i| format!(r#","indices":{i}"#));
        let primitive = format!(r#"{index},"mode":{mode}"#);
        let text = file.gltf(&one(&format!(r#""POSITION":{position}"#), &primitive, ""));
        let surfaces = surfaces(&text);
        for (x, y) in [(0.2, 0.3), (0.7, 0.9), (1.3, 0.2), (1.9, 0.95)] {
            let found = below(&surfaces, x, y);
            // Strips start with (0, 0), (0, 1), (1, 0): clockwise seen from +z, and so all of it.
            assert_eq!(found.is_some(), mode != 5, "mode {mode} at {x} {y}");
            let mut rng = Pcg64Mcg::seed_from_u64(1);
            let from_below = DVec3::new(x, y, -5.0);
            let seen = surfaces.seen(from_below, Vec3::Z, 9.0, &mut rng);
            assert_eq!(seen.is_some(), mode == 5);
        }
    }
    // Points and lines have no surface.
    let mut file = File::default();
    let position = file.square();
    for mode in [0, 1, 2, 3] {
        let primitive = format!(r#","mode":{mode}"#);
        let text = file.gltf(&one(&format!(r#""POSITION":{position}"#), &primitive, ""));
        let (scene, found) = parse(text.as_bytes()).unwrap();
        assert!(found.surfaces.is_none());
        assert!(scene.not_modelled.iter().any(|item| item.contains("points and lines")));
    }
}

/// Every type that indices, coordinates, colours, normals and positions may have.
#[test]
fn accessor_types_are_read() {
    let quad = [0u32, 1, 2, 0, 2, 3];
    let indices: [(u32, Vec<u8>); 3] = [
        (U8, quad.iter().map(|&i| i as u8).collect()),
        (U16, quad.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect()),
        (U32, quad.iter().flat_map(|&i| i.to_le_bytes()).collect()),
    ];
    // Red of the texture coordinates' image: a gradient along x, through vertex colours instead.
    let colors: [(u32, &str, Vec<u8>); 4] = [
        (
            FLOAT,
            "VEC3",
            [0f32, 1., 1., 1., 1., 1., 1., 1., 1., 0., 1., 1.]
                .iter()
                .flat_map(|v| v.to_le_bytes())
                .collect(),
        ),
        (
            FLOAT,
            "VEC4",
            [0f32, 1., 1., 1., 1., 1., 1., 1., 1., 1., 1., 1., 0., 1., 1., 1.]
                .iter()
                .flat_map(|v| v.to_le_bytes())
                .collect(),
        ),
        (
            U8,
            "VEC4",
            vec![0, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 0, 255, 255, 255],
        ),
        (
            U16,
            "VEC4",
            [
                0u16, 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535, 65535,
                0, 65535, 65535, 65535,
            ]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect(),
        ),
    ];
    for (index_type, index_bytes) in &indices {
        for (color_type, color_kind, color_bytes) in &colors {
            let mut file = File::default();
            let position = file.square();
            let index = file.accessor(index_bytes, *index_type, "SCALAR", 6, "");
            let normalized = if *color_type == FLOAT { "" } else { r#","normalized":true"# };
            let color = file.accessor(color_bytes, *color_type, color_kind, 4, normalized);
            let attributes = format!(r#""POSITION":{position},"COLOR_0":{color}"#);
            let text = file.gltf(&one(&attributes, &format!(r#","indices":{index}"#), ""));
            let surfaces = surfaces(&text);
            let (_, interaction) = below(&surfaces, 0.25, 0.5).unwrap();
            let expected = Vec3::new(0.25, 1.0, 1.0);
            assert!((interaction.parameters.base_color - expected).length() < 1e-5);
        }
    }
    // KHR_mesh_quantization, in the scale that the node undoes.
    let quantized = r#","extensionsUsed":["KHR_mesh_quantization"],"extensionsRequired":["KHR_mesh_quantization"]"#;
    for (component, normalized, bytes, height) in [
        (
            I16,
            true,
            [0i16, 0, 16384, 0, 32767, 0, 16384, 0, 32767, 32767, 16384, 0, 0, 32767, 16384, 0]
                .iter()
                .flat_map(|v| v.to_le_bytes())
                .collect::<Vec<u8>>(),
            16384.0 / 32767.0,
        ),
        (U8, false, vec![0, 0, 3, 0, 1, 0, 3, 0, 1, 1, 3, 0, 0, 1, 3, 0], 3.0),
        (I8, false, vec![0, 0, 0xfe, 0, 1, 0, 0xfe, 0, 1, 1, 0xfe, 0, 0, 1, 0xfe, 0], -2.0),
    ] {
        let mut file = File::default();
        let stride = if component == I16 { 8 } else { 4 };
        let view = file.view(&bytes, &format!(r#","byteStride":{stride}"#));
        file.accessors.push(format!(
            r#"{{"bufferView":{view},"componentType":{component},"type":"VEC3","count":4,"normalized":{normalized}}}"#
        ));
        let normals = file.accessor(
            &[0, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0],
            I8,
            "VEC3",
            4,
            r#","normalized":true"#,
        );
        // Elements of three bytes stand four apart.
        let last = file.views.last_mut().unwrap();
        *last = last.replace('}', r#","byteStride":4}"#);
        let attributes = format!(r#""POSITION":0,"NORMAL":{normals}"#);
        let text = file.gltf(&one(&attributes, r#","mode":6"#, quantized));
        let surfaces = surfaces(&text);
        let (hit, interaction) = below(&surfaces, 0.4, 0.3).unwrap();
        assert!((10.0 - hit.t - height).abs() < 1e-6, "{component}: {}", hit.t);
        assert_eq!(interaction.shading_normal, Vec3::Z);
        let without = file.gltf(&one(&attributes, r#","mode":6"#, ""));
        assert!(error(&without).to_string().contains("KHR_mesh_quantization"));
    }
}

#[test]
fn sparse_accessors_replace_elements() {
    let mut file = File::default();
    let base = file.square();
    let places = file.view(&[1, 3], "");
    let values: Vec<u8> = [3f32, 0., 0., 0., 5., 0.].iter().flat_map(|v| v.to_le_bytes()).collect();
    let values = file.view(&values, "");
    let sparse = format!(
        r#","sparse":{{"count":2,"indices":{{"bufferView":{places},"componentType":5121}},"values":{{"bufferView":{values}}}}}"#
    );
    file.accessors[base] = file.accessors[base].replace('}', &format!("{sparse}}}"));
    let more = one(r#""POSITION":0"#, r#","mode":6"#, "");
    let found = surfaces(&file.gltf(&more));
    let Bounds3 { low, high } = found.bounds();
    assert!(
        (low - DVec3::ZERO).length() < 1e-9 && (high - DVec3::new(3.0, 5.0, 0.0)).length() < 1e-9
    );
    // Without a view the others are zero.
    let whole = file.accessors[base].clone();
    file.accessors[base] = whole.replace(r#""bufferView":0,"#, "");
    let found = parse(file.gltf(&more).as_bytes()).unwrap();
    assert!(found.1.notes.iter().any(|note| note.contains("2 triangles have no area")));
    // Places out of order, and too large ones; and a count that no data stand for.
    file.accessors[base] = whole.clone();
    let start = file.views[places].clone();
    for broken in [[3u8, 1], [1, 4], [1, 1]] {
        let at = file.bin.len();
        file.bin.extend(broken);
        file.views[places] = format!(r#"{{"buffer":0,"byteOffset":{at},"byteLength":2}}"#);
        assert!(error(&file.gltf(&more)).to_string().contains("sparse index"));
    }
    file.views[places] = start;
    for count in ["1000000000", "1000000000000000000", "18446744073709551615"] {
        let huge = whole
            .replace(r#""bufferView":0,"#, "")
            .replace(r#""count":4"#, &format!(r#""count":{count}"#));
        file.accessors[base] = huge;
        assert!(matches!(error(&file.gltf(&more)), Error::Invalid { .. }));
    }
}

/// Each broken file is an error that names the accessor, view or primitive.
#[test]
fn broken_accessors_are_named() {
    type Break = fn(&mut File);
    let cases: [(&str, &str, Break); 11] = [
        ("/accessors/0", "do not fit", |f| {
            replace(&mut f.accessors[0], r#""count":4"#, r#""count":5"#)
        }),
        ("/accessors/0", "do not fit", |f| {
            replace(&mut f.accessors[0], r#""count":4"#, r#""count":4000000000000"#)
        }),
        ("/accessors/0", "Vec3 of U16", |f| replace(&mut f.accessors[0], "5126", "5123")),
        ("/accessors/0", "VEC", |f| replace(&mut f.accessors[0], "VEC3", "SCALAR")),
        ("/accessors/1", "indices are unsigned", |f| replace(&mut f.accessors[1], "5123", "5126")),
        ("/accessors/1", "index 5 is beyond", |f| {
            let end = f.bin.len() - 2;
            f.bin[end] = 9;
        }),
        ("/accessors/0", "element 1 has a component that is NaN", |f| {
            f.bin[12..16].copy_from_slice(&f32::NAN.to_le_bytes());
        }),
        ("/accessors/0", "component that is inf", |f| {
            f.bin[..4].copy_from_slice(&f32::INFINITY.to_le_bytes());
        }),
        ("/bufferViews/0", "its buffer has", |f| {
            replace(&mut f.views[0], r#""byteOffset":0"#, r#""byteOffset":100"#)
        }),
        ("/bufferViews/0", "its buffer has", |f| {
            replace(&mut f.views[0], r#""byteOffset":0"#, r#""byteOffset":18446744073709551615"#);
        }),
        ("/accessors/0", "only 8 bytes apart", |f| {
            replace(&mut f.views[0], "48", r#"48,"byteStride":8"#)
        }),
    ];
    for (part, says, broken) in cases {
        let mut file = File::default();
        file.square();
        file.shorts(&[0, 1, 2, 0, 2, 3]);
        let more = one(r#""POSITION":0"#, r#","indices":1"#, "");
        assert!(parse(file.gltf(&more).as_bytes()).is_ok());
        broken(&mut file);
        let error = error(&file.gltf(&more));
        assert!(matches!(error, Error::Invalid { .. }), "{says}: {error}");
        assert_eq!(error.place().part.as_deref(), Some(part), "{says}: {error}");
        assert!(error.to_string().to_lowercase().contains(&says.to_lowercase()), "{error}");
        assert!(error.place().line.is_some() && !error.remedy().is_empty());
    }
    // Numbers that do not exist.
    let mut file = File::default();
    file.square();
    file.floats(&[0., 0., 1., 0., 0., 1.], "VEC3");
    for (attributes, primitive) in [
        (r#""POSITION":7"#, ""),
        (r#""POSITION":0"#, r#","indices":7"#),
        (r#""POSITION":0"#, r#","mode":6,"material":0"#),
        (r#""POSITION":0,"NORMAL":1"#, r#","mode":6"#),
        (r#""POSITION":0"#, ""),
        (r#""POSITION":0"#, r#","mode":9"#),
    ] {
        let error = error(&file.gltf(&one(attributes, primitive, "")));
        assert!(matches!(error, Error::Invalid { .. }), "{attributes} {primitive}: {error}");
    }
}

fn replace(text: &mut String, from: &str, to: &str) {
    assert!(text.contains(from), "{from} in {text}");
    *text = text.replace(from, to);
}

#[test]
fn what_is_not_modelled_is_refused_or_listed() {
    let mut file = File::default();
    let position = file.square();
    let base = format!(r#""POSITION":{position}"#);
    for name in
        ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_materials_iridescence"]
    {
        let more = format!(r#","extensionsUsed":["{name}"],"extensionsRequired":["{name}"]"#);
        let error = error(&file.gltf(&one(&base, r#","mode":6"#, &more)));
        assert!(matches!(error, Error::Unsupported { .. }), "{error}");
        assert!(
            error.to_string().contains(name) && error.remedy().contains("KHR_mesh_quantization")
        );
        let used = format!(r#","extensionsUsed":["{name}"]"#);
        let text = file.gltf(&one(&base, r#","mode":6"#, &used));
        let (scene, _) = parse(text.as_bytes()).unwrap();
        assert!(scene.not_modelled.iter().any(|item| item.contains(name)));
    }
    let primitive =
        r#","mode":6,"targets":[{"POSITION":0}],"extensions":{"KHR_draco_mesh_compression":{}}"#;
    let refused = error(&file.gltf(&one(&base, primitive, "")));
    assert!(refused.to_string().contains("draco"), "{refused}");
    let primitive = r#","mode":6,"targets":[{"POSITION":0}]"#;
    let materials = r#","materials":[{"occlusionTexture":{"index":0}}],"textures":[{"source":0}],"images":[{"uri":"none.png"}]"#;
    let text = file.gltf(&one(&base, primitive, materials));
    let (scene, _) = parse(text.as_bytes()).unwrap();
    let says = "occlusion textures of 1 material";
    assert!(scene.not_modelled.iter().any(|item| item.contains(says)), "{says}");
}

#[test]
fn instancing_places_copies() {
    let mut file = File::default();
    let position = file.square();
    let translations = file.floats(&[0., 0., 0., 2., 0., 0., 0., 2., 1.], "VEC3");
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let rotations = file.floats(&[0., 0., 0., 1., 0., 0., half, half, 0., 0., 0., 1.], "VEC4");
    let scales = file.floats(&[1., 1., 1., 1., 1., 1., 3., 1., 1.], "VEC3");
    let nodes = |attributes: &str| {
        format!(
            r#""nodes":[{{"mesh":0,"translation":[0,0,1],"extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":{{{attributes}}}}}}}}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":{position}}},"mode":6}}]}}],
            "extensionsRequired":["EXT_mesh_gpu_instancing"]"#
        )
    };
    let attributes =
        format!(r#""TRANSLATION":{translations},"ROTATION":{rotations},"SCALE":{scales}"#);
    let found = surfaces(&file.gltf(&nodes(&attributes)));
    assert_eq!((found.counts().instances, found.counts().triangles), (3, 2));
    for (x, y, expected) in [
        (0.5, 0.5, Some((0, 1.0))),
        // Turned by a quarter about z: to the left of its place.
        (1.5, 0.5, Some((1, 1.0))),
        (2.5, 0.5, None),
        (2.5, 2.5, Some((2, 2.0))),
        (3.5, 2.5, None),
    ] {
        let hit = below(&found, x, y).map(|(hit, _)| (hit.instance, 10.0 - hit.t));
        assert_eq!(hit.map(|h| h.0), expected.map(|e| e.0), "{x} {y}");
        if let (Some(hit), Some(expected)) = (hit, expected) {
            assert!((hit.1 - expected.1).abs() < 1e-6);
        }
    }
    let uneven = format!(r#""TRANSLATION":{translations},"SCALE":{position}"#);
    let uneven = error(&file.gltf(&nodes(&uneven)));
    assert!(uneven.to_string().contains("different lengths"), "{uneven}");
}

/// PNG of these RGBA pixels, 8 bits a channel.
fn png(width: u32, pixels: &[[u8; 4]]) -> Vec<u8> {
    let height = pixels.len() as u32 / width;
    let image = image::RgbaImage::from_raw(width, height, pixels.concat()).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// A square with coordinates, a material and a texture.
fn textured(file: &mut File, material: &str, image: &str, more: &str) -> String {
    let position = file.square();
    let uv = file.floats(&[0., 1., 1., 1., 1., 0., 0., 0.], "VEC2");
    let other = file.floats(&[0., 0., 0., 0., 0., 0., 0., 0.], "VEC2");
    let attributes = format!(r#""POSITION":{position},"TEXCOORD_0":{uv},"TEXCOORD_1":{other}"#);
    let more = format!(
        r#","materials":[{material}],"textures":[{{"source":0,"sampler":0}}],"samplers":[{{"magFilter":9728}}],"images":[{image}]{more}"#
    );
    one(&attributes, r#","mode":6,"material":0"#, &more)
}

#[test]
fn textures_come_from_views_data_and_files() {
    let red = [255, 0, 0, 255];
    let pixels = [red, [128, 128, 128, 255], [0, 0, 255, 0], [0, 255, 0, 255]];
    let bytes = png(2, &pixels);
    let mut jpeg = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(8, 8, image::Rgb([128, 128, 128]))
        .write_to(&mut jpeg, image::ImageFormat::Jpeg)
        .unwrap();
    let material =
        r#"{"alphaMode":"MASK","pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#;
    let check = |surfaces: &Surfaces| {
        let color = |x, y| below(surfaces, x, y).map(|found| found.1.parameters.base_color);
        assert_eq!(color(0.25, 0.75), Some(Vec3::X));
        let grey = color(0.75, 0.75).unwrap();
        assert!((grey - 0.215_86).length() < 1e-4, "sRGB is decoded: {grey}");
        assert_eq!(color(0.25, 0.25), None, "alpha 0 is a hole");
        assert_eq!(color(0.75, 0.25), Some(Vec3::Y));
    };
    let mut file = File::default();
    let view = file.view(&bytes, "");
    let text = textured(
        &mut file,
        material,
        &format!(r#"{{"bufferView":{view},"mimeType":"image/png"}}"#),
        "",
    );
    check(&surfaces(&file.gltf(&text)));
    let mut file = File::default();
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let text =
        textured(&mut file, material, &format!(r#"{{"uri":"data:image/png;base64,{data}"}}"#), "");
    check(&surfaces(&file.gltf(&text)));
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a b.png"), &bytes).unwrap();
    std::fs::write(folder.path().join("c.jpg"), jpeg.into_inner()).unwrap();
    let load = |uri: &str| {
        let mut file = File::default();
        let text = textured(&mut file, material, &format!(r#"{{"uri":"{uri}"}}"#), "");
        let path = folder.path().join("a.gltf");
        std::fs::write(&path, file.gltf(&text)).unwrap();
        gltf::load_with_surfaces(&path, 683.0, GlassRule::default())
    };
    check(&load("a%20b.png").unwrap().1.surfaces.unwrap());
    let jpeg = load("c.jpg").unwrap().1.surfaces.unwrap();
    let grey = below(&jpeg, 0.3, 0.3).unwrap().1.parameters.base_color;
    assert!((grey - 0.215_86).length() < 0.02, "{grey}");
    assert!(matches!(load("missing.png").unwrap_err(), Error::Io { .. }));
    std::fs::write(folder.path().join("cut.png"), &bytes[..40]).unwrap();
    let cut = load("cut.png").unwrap_err();
    assert!(
        matches!(cut, Error::Invalid { .. }) && cut.place().part.as_deref() == Some("/images/0")
    );
    std::fs::write(folder.path().join("no.png"), b"RIFF....WEBP").unwrap();
    assert!(matches!(load("no.png").unwrap_err(), Error::Unsupported { .. }));
    // A header of a picture of 60000 x 60000 pixels is refused before anything is decoded.
    let mut bomb = bytes.clone();
    bomb[16..24].copy_from_slice(&[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60]);
    let mut crc = 0xffff_ffffu32;
    for &byte in &bomb[12..29] {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    bomb[29..33].copy_from_slice(&(!crc).to_be_bytes());
    std::fs::write(folder.path().join("bomb.png"), &bomb).unwrap();
    let bomb = load("bomb.png").unwrap_err();
    assert_eq!(bomb.place().part.as_deref(), Some("/images/0"), "{bomb}");
}

#[test]
fn texture_transforms_and_sets() {
    // The specification's example: the lower left quadrant, turned clockwise by a quarter.
    let pixels: Vec<[u8; 4]> = (0..16).map(|i| [i * 16, 0, 0, 255]).collect();
    let bytes = png(4, &pixels);
    let red = |transform: &str, x: f64, y: f64| {
        let mut file = File::default();
        let view = file.view(&bytes, "");
        let material = format!(
            r#"{{"emissiveFactor":[1,1,1],"emissiveTexture":{{"index":0,"extensions":{{"KHR_texture_transform":{{{transform}}}}}}}}}"#
        );
        let image = format!(r#"{{"bufferView":{view}}}"#);
        let text = textured(
            &mut file,
            &material,
            &image,
            r#","extensionsRequired":["KHR_texture_transform"]"#,
        );
        let surfaces = surfaces(&file.gltf(&text));
        let linear = below(&surfaces, x, y).unwrap().1.emission.x;
        // Which pixel it is.
        let srgb = if linear <= 0.003_130_8 {
            linear * 12.92
        } else {
            1.055 * linear.powf(1.0 / 2.4) - 0.055
        };
        (srgb * 255.0 / 16.0).round() as u32
    };
    // The square's upper left corner is the first pixel.
    assert_eq!(red("", 0.1, 0.9), 0);
    assert_eq!(red("", 0.9, 0.9), 3);
    assert_eq!(red("", 0.1, 0.1), 12);
    let example = r#""offset":[0,1],"rotation":1.57079632679,"scale":[0.5,0.5]"#;
    // Of the quadrant 8 9 / 12 13, turned clockwise: 12 8 / 13 9.
    for (x, y, pixel) in [(0.1, 0.9, 12), (0.9, 0.9, 8), (0.1, 0.1, 13), (0.9, 0.1, 9)] {
        assert_eq!(red(example, x, y), pixel, "{x} {y}");
    }
    assert_eq!(red(r#""offset":[0,1],"scale":[1,-1]"#, 0.1, 0.1), 0);
    assert_eq!(red(r#""offset":[0.25,0]"#, 0.1, 0.9), 1);
    // The second set is zero everywhere.
    assert_eq!(red(r#""texCoord":1"#, 0.9, 0.1), 0);
    let mut file = File::default();
    let view = file.view(&bytes, "");
    let material = r#"{"emissiveTexture":{"index":0,"texCoord":2}}"#;
    let text = textured(&mut file, material, &format!(r#"{{"bufferView":{view}}}"#), "");
    assert!(matches!(error(&file.gltf(&text)), Error::Unsupported { .. }));
}

#[test]
fn materials_say_everything_that_is_modelled() {
    let mut file = File::default();
    // A pyramid that stands on its tip: the square above is what is looked at.
    let square = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];
    file.floats(&[&square[..], &[0.5, 0.5, -1.0]].concat(), "VEC3");
    file.shorts(&[0, 1, 2, 0, 2, 3, 1, 0, 4, 2, 1, 4, 3, 2, 4, 0, 3, 4]);
    let material = |body: &str| {
        let more = format!(r#","materials":[{body}]"#);
        one(r#""POSITION":0"#, r#","indices":1,"material":0"#, &more)
    };
    let all = r#"{"name":"all","doubleSided":true,"emissiveFactor":[1,0.5,0],
        "pbrMetallicRoughness":{"baseColorFactor":[0.1,0.2,0.3,1],"metallicFactor":0.25,"roughnessFactor":0.75},
        "extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":4},"KHR_materials_ior":{"ior":1.33},
        "KHR_materials_specular":{"specularFactor":0.6,"specularColorFactor":[2,1,0.5]},
        "KHR_materials_transmission":{"transmissionFactor":0.7},
        "KHR_materials_clearcoat":{"clearcoatFactor":0.8,"clearcoatRoughnessFactor":0.15},
        "KHR_materials_sheen":{"sheenColorFactor":[0.4,0.5,0.6],"sheenRoughnessFactor":0.35},
        "KHR_materials_diffuse_transmission":{"diffuseTransmissionFactor":0.45,"diffuseTransmissionColorFactor":[0.9,0.8,0.7]},
        "KHR_materials_volume":{"thicknessFactor":0.01,"attenuationDistance":0.5,"attenuationColor":[0.5,0.25,1]},
        "KHR_materials_volume_scatter":{"multiscatterColor":[0.8,0,1],"scatterAnisotropy":0.3}}}"#;
    let found = surfaces(&file.gltf(&material(all)));
    let interaction = below(&found, 0.3, 0.4).unwrap().1;
    let parameters = interaction.parameters;
    assert!((parameters.base_color - Vec3::new(0.1, 0.2, 0.3)).length() < 1e-6);
    assert_eq!([parameters.metallic, parameters.roughness, parameters.ior], [0.25, 0.75, 1.33]);
    assert_eq!((parameters.specular, parameters.specular_color), (0.6, Vec3::new(2.0, 1.0, 0.5)));
    assert_eq!([parameters.transmission, parameters.diffuse_transmission], [0.7, 0.45]);
    assert_eq!(parameters.diffuse_transmission_color, Vec3::new(0.9, 0.8, 0.7));
    assert_eq!([parameters.clearcoat, parameters.clearcoat_roughness], [0.8, 0.15]);
    assert_eq!(
        (parameters.sheen_color, parameters.sheen_roughness),
        (Vec3::new(0.4, 0.5, 0.6), 0.35)
    );
    assert!(!parameters.thin_walled && found.has_interiors());
    assert_eq!(interaction.emission, Vec3::new(4.0, 2.0, 0.0));
    let interior = interaction.interior.unwrap();
    let sigma_t = interior.sigma_a + interior.sigma_s;
    let expected = Vec3::new(2.0 * 2f32.ln(), 2.0 * 4f32.ln(), 0.0);
    assert!((sigma_t - expected).length() < 1e-5, "{sigma_t}");
    assert!(interior.sigma_s.y < 1e-3 && interior.sigma_s.x > 0.9 * sigma_t.x && interior.g == 0.3);
    let thin = all.replace("0.01", "0");
    let interaction = below(&surfaces(&file.gltf(&material(&thin))), 0.3, 0.4).unwrap().1;
    assert!(interaction.parameters.thin_walled && interaction.interior.is_none());
    let infinite = r#"{"extensions":{"KHR_materials_ior":{"ior":0}}}"#;
    let found = surfaces(&file.gltf(&material(infinite)));
    assert_eq!(below(&found, 0.3, 0.4).unwrap().1.parameters.ior, f32::INFINITY);
    let unlit = r#"{"pbrMetallicRoughness":{"baseColorFactor":[0.5,0.25,1,1]},"extensions":{"KHR_materials_unlit":{}}}"#;
    let found = surfaces(&file.gltf(&material(unlit)));
    let interaction = below(&found, 0.3, 0.4).unwrap().1;
    assert_eq!(interaction.emission, Vec3::new(0.5, 0.25, 1.0));
    assert_eq!(interaction.parameters.base_color, Vec3::ZERO);
    assert_eq!(found.emitters()[0].radiance, Vec3::new(0.5, 0.25, 1.0));
    for (broken, part) in [
        (
            r#"{"extensions":{"KHR_materials_ior":{"ior":0.5}}}"#,
            "/materials/0/extensions/KHR_materials_ior/ior",
        ),
        (r#"{"emissiveFactor":[-1,0,0]}"#, "/materials/0/emissiveFactor"),
        (
            r#"{"emissiveFactor":[1e38,0,0],"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":1e3}}}"#,
            "/materials/0/emissiveFactor",
        ),
        (r#"{"alphaMode":"MASKED"}"#, "/materials/0/alphaMode"),
        (
            r#"{"extensions":{"KHR_materials_volume":{"attenuationDistance":0}}}"#,
            "/materials/0/extensions/KHR_materials_volume/attenuationDistance",
        ),
        (r#"{"normalTexture":{"index":3}}"#, "/materials/0/normalTexture"),
        (
            r#"{"extensions":{"KHR_materials_sheen":{"sheenRoughnessFactor":"x"}}}"#,
            "/materials/0/extensions/KHR_materials_sheen/sheenRoughnessFactor",
        ),
    ] {
        let error = error(&file.gltf(&material(broken)));
        assert!(matches!(error, Error::Invalid { .. }), "{error}");
        assert_eq!(error.place().part.as_deref(), Some(part), "{error}");
    }
}

/// The glass rule asks for closed meshes; thin walls stay thin.
#[test]
fn only_closed_glass_is_solid() {
    let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
    let material =
        r#","materials":[{"extensions":{"KHR_materials_transmission":{"transmissionFactor":1}}}]"#;
    for (faces, solid) in [
        (vec![0u16, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3], true),
        (vec![0, 2, 1, 0, 1, 3, 1, 2, 3], false),
    ] {
        let mut file = File::default();
        file.floats(&corners.concat(), "VEC3");
        file.shorts(&faces);
        let text = file.gltf(&one(r#""POSITION":0"#, r#","indices":1,"material":0"#, material));
        let found = surfaces(&text);
        assert_eq!(found.mesh_is_closed(0), solid);
        let interaction = below(&found, 0.2, 0.2).unwrap().1;
        assert_eq!(interaction.parameters.thin_walled, !solid);
    }
}

/// Thousands of mutants of a text and of a binary file, bytes changed at random (fixed seed),
/// and a number in the JSON replaced by a hostile one: an error or surfaces, never a panic.
#[test]
fn mutants_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(asset("studio.bin"), folder.path().join("studio.bin")).unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(2024);
    let mut small = File::default();
    let image = small.view(&png(2, &[[9; 4], [200; 4], [90; 4], [255; 4]]), "");
    let places = small.view(&[0, 2], "");
    let corners = [0f32, 0., 0., 1., 1., 0.].map(f32::to_le_bytes).concat();
    let values = small.view(&corners, "");
    let material = r#"{"emissiveFactor":[1,1,1],"emissiveTexture":{"index":0},"alphaMode":"BLEND","normalTexture":{"index":0,"scale":0.5},"extensions":{"KHR_materials_volume":{"thicknessFactor":1,"attenuationDistance":2,"attenuationColor":[0.5,0.5,0.5]},"KHR_materials_transmission":{"transmissionFactor":0.5}}}"#;
    let mut more = textured(&mut small, material, &format!(r#"{{"bufferView":{image}}}"#), "");
    let sparse = format!(
        r#","sparse":{{"count":2,"indices":{{"bufferView":{places},"componentType":5121}},"values":{{"bufferView":{values}}}}}}}"#
    );
    small.accessors[0] = small.accessors[0].replace('}', &sparse);
    let _ = write!(more, r#","extensionsUsed":["KHR_mesh_quantization"]"#);
    let seeds = [
        (std::fs::read(asset("studio.gltf")).unwrap(), 700),
        (std::fs::read(asset("fire.glb")).unwrap(), 2500),
        (small.glb(&more), 4000),
        (small.gltf(&more).into_bytes(), 2500),
    ];
    assert!(parse(&seeds[2].0).unwrap().1.surfaces.is_some());
    let hostile: [&[u8]; 8] =
        [b"-1", b"0", b"1", b"255", b"4294967295", b"18446744073709551615", b"1e38", b"3"];
    let (mut errors, mut loaded) = (0, 0);
    for (seed, mutants) in seeds {
        for _ in 0..mutants {
            let mut bytes = seed.clone();
            let below = |rng: &mut Pcg64Mcg, n: usize| (rng.next_u64() % n as u64) as usize;
            for _ in 0..1 + below(&mut rng, 3) {
                let at = below(&mut rng, bytes.len());
                match below(&mut rng, 4) {
                    0 => bytes[at] ^= 1 << below(&mut rng, 8),
                    1 => bytes[at] = rng.next_u64() as u8,
                    _ => {
                        // The number at or after this place.
                        let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit) else {
                            continue;
                        };
                        let start = at + start;
                        let length =
                            bytes[start..].iter().take_while(|b| b.is_ascii_digit()).count();
                        let number = hostile[below(&mut rng, hostile.len())];
                        bytes.splice(start..start + length, number.iter().copied());
                        // The JSON chunk keeps its length in the header.
                        if bytes.starts_with(b"glTF") && start >= 20 {
                            let json = u32::from_le_bytes(bytes[12..16].try_into().unwrap());
                            let json =
                                json.wrapping_add(number.len() as u32).wrapping_sub(length as u32);
                            bytes[12..16].copy_from_slice(&json.to_le_bytes());
                        }
                    }
                }
            }
            let path = folder.path().join("a.gltf");
            match gltf::parse_with_surfaces(path, &bytes, 683.0, GlassRule::default()) {
                Ok((_, found)) => {
                    loaded += 1;
                    let Some(surfaces) = found.surfaces else { continue };
                    let Bounds3 { low, high } = surfaces.bounds();
                    let to = low + (high - low) * 0.5;
                    for along in [Vec3::NEG_Z, Vec3::new(0.3, -0.9, 0.2).normalize()] {
                        let origin = to - along.as_dvec3() * 10.0;
                        if let Some(hit) = surfaces.intersect(origin, along, 1e9, &mut rng) {
                            let interaction = surfaces.interaction(&hit, along);
                            assert!(interaction.shading_normal.is_finite());
                            assert!(interaction.spawn(along).is_finite());
                        }
                    }
                }
                Err(_) => errors += 1,
            }
        }
    }
    assert!(errors > 1000 && loaded > 1000, "{errors} errors, {loaded} loaded");
}

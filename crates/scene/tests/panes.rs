//! Materials as others write them: turned normal maps, drafts of scattering, keys that nobody
//! knows, materials that nothing uses, sheets with a back.

use base64::Engine;
use glam::{DVec3, Vec2, Vec3};
use pileus_scene::gltf::{self, GltfScene, GltfSurfaces};
use pileus_scene::{Error, GlassRule, Interaction, Surfaces};
use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;
use serde_json::{Value, json};

fn data(bytes: &[u8], kind: &str) -> String {
    let data = base64::engine::general_purpose::STANDARD.encode(bytes);
    format!("data:{kind};base64,{data}")
}

/// An image of one colour.
fn image(texel: [u8; 4]) -> Value {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::RgbaImage::from_pixel(2, 2, image::Rgba(texel))
        .write_to(&mut bytes, image::ImageFormat::Png)
        .unwrap();
    json!({"uri": data(&bytes.into_inner(), "image/png")})
}

/// What a corner of the square has besides its place.
#[derive(Clone)]
struct Corners {
    uv: [[f32; 2]; 4],
    tangent: Option<[f32; 4]>,
    /// Which set of coordinates `uv` is.
    set: usize,
}

/// The square from (-1, -1, 0) to (1, 1, 0), front up; the first coordinate grows with x, the
/// second with y.
const SQUARE: [[f32; 3]; 4] =
    [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];

impl Default for Corners {
    fn default() -> Self {
        Self { uv: [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], tangent: None, set: 0 }
    }
}

/// A file of the square with the first of these materials, and whatever else.
fn file(corners: &Corners, materials: Value, more: Value) -> Value {
    let mut bytes = Vec::new();
    let (mut views, mut accessors) = (Vec::new(), Vec::new());
    let mut add = |values: &[f32], kind: &str, n: usize| {
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": 4 * values.len()}));
        accessors.push(json!({"bufferView": views.len() - 1, "componentType": 5126, "type": kind,
            "count": values.len() / n}));
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        accessors.len() - 1
    };
    let mut attributes = json!({
        "POSITION": add(&SQUARE.concat(), "VEC3", 3),
        "NORMAL": add(&[[0.0, 0.0, 1.0]; 4].concat(), "VEC3", 3),
        "TEXCOORD_0": add(&[[0.0; 2]; 4].concat(), "VEC2", 2),
    });
    let set = format!("TEXCOORD_{}", corners.set);
    attributes[&set] = json!(add(&corners.uv.concat(), "VEC2", 2));
    if let Some(tangent) = corners.tangent {
        attributes["TANGENT"] = json!(add(&[tangent; 4].concat(), "VEC4", 4));
    }
    let mut file = json!({
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "mode": 6, "material": 0}]}],
        "materials": materials, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": bytes.len(), "uri": data(&bytes, "application/octet-stream")}],
    });
    for (key, value) in more.as_object().unwrap() {
        file[key] = value.clone();
    }
    file
}

fn parse(file: &Value) -> Result<(GltfScene, GltfSurfaces), Error> {
    let rule = GlassRule::default();
    gltf::parse_with_surfaces("folder/a.gltf", file.to_string().as_bytes(), 683.0, rule)
}

fn surfaces(file: &Value) -> Surfaces {
    parse(file).unwrap().1.surfaces.unwrap()
}

/// What a ray downwards meets at (x, y).
fn below(surfaces: &Surfaces, x: f64, y: f64) -> Interaction {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let hit = surfaces.intersect(DVec3::new(x, y, 9.0), Vec3::NEG_Z, 99.0, &mut rng).unwrap();
    surfaces.interaction(&hit, Vec3::NEG_Z)
}

/// Shading normal under a constant map that tilts by `texel`, transformed.
fn normal(corners: &Corners, transform: &Value, node: Value) -> Vec3 {
    let texture = json!({"index": 0, "texCoord": corners.set,
        "extensions": {"KHR_texture_transform": transform}});
    let more = json!({"images": [image([204, 128, 230, 255])], "textures": [{"source": 0}],
        "nodes": [node]});
    let file = file(corners, json!([{"normalTexture": texture, "doubleSided": true}]), more);
    below(&surfaces(&file), 0.3, 0.2).shading_normal
}

/// The texel of [`normal`] as a direction: along the first coordinate, against the second,
/// outwards.
const TILT: Vec3 = Vec3::new(204.0 / 127.5 - 1.0, 128.0 / 127.5 - 1.0, 230.0 / 127.5 - 1.0);

/// The normal as the frame of the transformed coordinates has it: the tangent is the direction in
/// which the first grows while the second stays, the bitangent is square to it on the side on which
/// the second falls.
fn expected(uv: [[f32; 2]; 4], (rotation, scale): (f32, [f32; 2])) -> Vec3 {
    let (sin, cos) = rotation.sin_cos();
    let place = |uv: [f32; 2]| {
        let [u, v] = [uv[0] * scale[0], uv[1] * scale[1]];
        Vec2::new(cos * u + sin * v, cos * v - sin * u)
    };
    // Derivatives by x and y over the square's width.
    let [a, b, _, d] = uv.map(place);
    let (by_x, by_y) = ((b - a) * 0.5, (d - a) * 0.5);
    let determinant = by_x.x * by_y.y - by_y.x * by_x.y;
    // The direction with `u` growing and `v` staying: the first column of the inverse.
    let along = Vec3::new(by_y.y, -by_x.y, 0.0) * determinant.signum();
    let tangent = along.normalize();
    let other = Vec3::Z.cross(tangent);
    let v_along_other = by_x.y * other.x + by_y.y * other.y;
    let bitangent = if v_along_other < 0.0 { other } else { -other };
    (tangent * TILT.x + bitangent * TILT.y + Vec3::Z * TILT.z).normalize()
}

/// `KHR_texture_transform` turns and mirrors the frame of a normal map, however the mesh gives its
/// tangents, in both sets of coordinates, on grids that are oblong, turned, oblique and mirrored.
#[test]
fn texture_transforms_turn_normal_maps() {
    let grids = [
        // As in a picture, mirrored, turned by a quarter, four times as long, oblique.
        [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]],
        [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
        [[0.0, 0.0], [0.0, 1.0], [-1.0, 1.0], [-1.0, 0.0]],
        [[0.0, 1.0], [4.0, 1.0], [4.0, 0.0], [0.0, 0.0]],
        [[0.0, 1.0], [1.0, 1.3], [1.5, 0.3], [0.5, 0.0]],
    ];
    let transforms = [
        (0.0, [1.0, 1.0]),
        (std::f32::consts::PI, [1.0, 1.0]),
        (std::f32::consts::FRAC_PI_2, [1.0, 1.0]),
        (-0.7, [1.0, 1.0]),
        (0.0, [-1.0, 1.0]),
        (0.0, [1.0, -1.0]),
        (1.1, [-2.0, 0.5]),
        (0.4, [3.0, 3.0]),
    ];
    for (grid, uv) in grids.into_iter().enumerate() {
        // The tangent and its sign as MikkTSpace gives them: of the coordinates as they are.
        let flat = |uv| expected(uv, (0.0, [1.0, 1.0])) * TILT.length() - Vec3::Z * TILT.z;
        let (x, y) = (TILT.x, TILT.y);
        let plain = flat(uv);
        // Of t x + b y with b = +-(z x t), t follows.
        let tangent_for = |sign: f32| {
            let across = Vec3::Z.cross(plain) * sign;
            (plain * x - across * y) / (x * x + y * y)
        };
        let [right, left] = [1.0f32, -1.0].map(tangent_for);
        let [[u0, v0], [u1, v1], _, [u3, v3]] = uv;
        let sign = if (u1 - u0) * (v3 - v0) - (u3 - u0) * (v1 - v0) < 0.0 { 1.0 } else { -1.0 };
        let t = if sign > 0.0 { right } else { left };
        for transform in transforms {
            let (rotation, scale) = transform;
            let json = json!({"rotation": rotation, "scale": scale, "offset": [0.3, -0.2]});
            let right = expected(uv, transform);
            for set in [0, 1] {
                for tangent in [None, Some([t.x, t.y, t.z, sign])] {
                    let corners = Corners { uv, tangent, set };
                    let found = normal(&corners, &json, json!({"mesh": 0}));
                    let what = format!("grid {grid} {transform:?} set {set} {tangent:?}");
                    assert!((found - right).length() < 1e-3, "{what}: {found} {right}");
                }
            }
            // A mirrored and stretched node has the mirror image, of the stretched grid.
            let corners = Corners { uv, ..Corners::default() };
            let found = normal(&corners, &json, json!({"mesh": 0, "scale": [-1, 1, 1]}));
            let mirrored = right * Vec3::new(-1.0, 1.0, 1.0);
            assert!((found - mirrored).length() < 1e-3, "grid {grid} {transform:?}: {found}");
        }
    }
    // A transform without area turns nothing and breaks nothing.
    let plain = Corners::default();
    let flat = json!({"rotation": 0.3, "scale": [0, 1]});
    assert!(normal(&plain, &flat, json!({"mesh": 0})).is_normalized());
    let huge = json!({"rotation": 0.3, "scale": [1e30, 1e30]});
    assert!(normal(&plain, &huge, json!({"mesh": 0})).is_finite());
}

/// Reflected irradiance of the closed forms: 3 / pi times the cosine to the sun, for the map whose
/// value is (204, 128, 230).
#[test]
fn turned_normal_maps_reflect_the_known_light() {
    let to_light = Vec3::new(0.7, 0.3, 0.6).normalize();
    for (transform, radiance) in [
        (json!({"rotation": 0}), 0.887),
        (json!({"rotation": std::f32::consts::PI}), 0.0601),
        (json!({"rotation": std::f32::consts::FRAC_PI_2}), 0.2996),
        (json!({"rotation": -0.7}), 0.9020),
        (json!({"scale": [-1, 1]}), 0.0624),
        (json!({"scale": [1, -1]}), 0.8848),
    ] {
        for tangent in [None, Some([1.0, 0.0, 0.0, 1.0])] {
            for set in [0, 1] {
                // As in a picture: the second coordinate falls where y grows.
                let uv = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
                let corners = Corners { uv, tangent, set };
                let texture = json!({"index": 0, "texCoord": set,
                    "extensions": {"KHR_texture_transform": transform}});
                let more = json!({"images": [image(NORMAL_TEXEL)], "textures": [{"source": 0}]});
                let file = file(&corners, json!([{"normalTexture": texture}]), more);
                let normal = below(&surfaces(&file), 0.0, 0.0).shading_normal;
                let found = 3.0 / std::f32::consts::PI * normal.dot(to_light).max(0.0);
                assert!((found - radiance).abs() < 6e-4, "{transform} {tangent:?}: {found}");
            }
        }
    }
}

const NORMAL_TEXEL: [u8; 4] = [204, 128, 230, 255];

/// Makes a pyramid of the square, so that it bounds a body: its tip is below.
fn close(file: &mut Value) {
    let tip = [0.0f32, 0.0, -1.0];
    let sides = (0..4).flat_map(|i| [SQUARE[(i + 1) % 4], SQUARE[i], tip]);
    let mut bytes: Vec<u8> = sides.flatten().flat_map(f32::to_le_bytes).collect();
    bytes.resize(12 * 12 + 12 * 8, 0);
    let count = |file: &Value, key: &str| file[key].as_array().unwrap().len();
    let (buffer, view) = (count(file, "buffers"), count(file, "bufferViews"));
    let accessor = count(file, "accessors");
    let mut push = |key: &str, value: Value| file[key].as_array_mut().unwrap().push(value);
    let uri = data(&bytes, "application/octet-stream");
    push("buffers", json!({"byteLength": bytes.len(), "uri": uri}));
    push("bufferViews", json!({"buffer": buffer, "byteLength": 144}));
    push("bufferViews", json!({"buffer": buffer, "byteOffset": 144, "byteLength": 96}));
    for (k, kind) in ["VEC3", "VEC2"].into_iter().enumerate() {
        let view = view + k;
        push(
            "accessors",
            json!({"bufferView": view, "componentType": 5126, "type": kind, "count": 12}),
        );
    }
    let sides =
        json!({"attributes": {"POSITION": accessor, "TEXCOORD_0": accessor + 1}, "material": 0});
    file["meshes"][0]["primitives"].as_array_mut().unwrap().push(sides);
}

/// The medium inside of a wall of glass with these extensions.
fn medium(extensions: Value, images: Value) -> (Interaction, GltfScene) {
    let mut extensions = extensions;
    extensions["KHR_materials_transmission"] = json!({"transmissionFactor": 1});
    extensions["KHR_materials_volume"] = json!({"thicknessFactor": 1, "attenuationDistance": 0.05,
        "attenuationColor": [0.4, 0.4, 0.4]});
    let textures: Vec<Value> =
        (0..images.as_array().unwrap().len()).map(|i| json!({"source": i})).collect();
    let more = json!({"images": images, "textures": textures});
    let mut file =
        file(&Corners::default(), json!([{"name": "wax", "extensions": extensions}]), more);
    close(&mut file);
    let (scene, found) = parse(&file).unwrap();
    (below(&found.surfaces.unwrap(), 0.3, 0.2), scene)
}

/// All keys of both drafts, with and without textures, say the same medium.
#[test]
fn both_drafts_of_scattering_are_read() {
    let color = [0.8f32, 0.5, 0.3];
    let (old, scene) = medium(
        json!({"KHR_materials_volume_scatter": {"multiscatterColor": color, "scatterAnisotropy": 0.2}}),
        json!([]),
    );
    assert!(scene.not_modelled.is_empty(), "{:?}", scene.not_modelled);
    let old = old.interior.unwrap();
    assert!(old.sigma_s.min_element() > 1.0 && old.g == 0.2);
    let half = image([188, 188, 188, 128]);
    let texture = json!({"index": 0});
    // sRGB 188 is 0.5028 in linear light, 128 is 0.50196.
    let (grey, alpha) = (0.502_886_5_f32, 128.0 / 255.0);
    let over = |factor: f32| color.map(|c| c / factor);
    for (name, mut body) in [
        ("KHR_materials_volume_scatter", json!({"multiscatterColorFactor": color})),
        (
            "KHR_materials_volume_scatter",
            json!({"multiscatterColorFactor": color, "multiscatterColor": [0, 0, 0]}),
        ),
        (
            "KHR_materials_volume_scatter",
            json!({"multiscatterColorFactor": over(grey), "multiscatterColorTexture": texture}),
        ),
        (
            "KHR_materials_scatter",
            json!({"multiscatterColorFactor": color, "scatterStrengthFactor": 1}),
        ),
        ("KHR_materials_scatter", json!({"multiscatterColorFactor": color, "scatterFactor": 1})),
        (
            "KHR_materials_scatter",
            json!({"multiscatterColorFactor": over(0.9), "scatterStrengthFactor": 0.9}),
        ),
        (
            "KHR_materials_scatter",
            json!({"multiscatterColorFactor": over(alpha), "scatterStrengthFactor": 1,
                "scatterStrengthTexture": texture}),
        ),
    ] {
        body["scatterAnisotropy"] = json!(0.2);
        let (found, scene) = medium(json!({name: body.clone()}), json!([half.clone()]));
        assert!(scene.not_modelled.is_empty(), "{body}: {:?}", scene.not_modelled);
        let found = found.interior.unwrap();
        assert!((found.sigma_s - old.sigma_s).abs().max_element() < 0.02, "{body}: {found:?}");
        assert!((found.sigma_a + found.sigma_s - old.sigma_a - old.sigma_s).length() < 1e-4);
        assert_eq!(found.g, old.g);
    }
    // A texture alone; both drafts at once: the newer one counts, with its default strength of
    // none.
    let (found, _) = medium(
        json!({"KHR_materials_volume_scatter": {"multiscatterColorTexture": texture}}),
        json!([half]),
    );
    assert!(found.interior.unwrap().sigma_s.min_element() > 1.0);
    let both = json!({"KHR_materials_volume_scatter": {"multiscatterColorFactor": color},
        "KHR_materials_scatter": {"multiscatterColorFactor": color}});
    let (found, _) = medium(both, json!([]));
    assert!(found.interior.unwrap().sigma_s.max_element() < 1e-3);
    // Of thin walls it is said.
    let thin = json!([{"name": "leaf", "extensions": {
        "KHR_materials_transmission": {"transmissionFactor": 1},
        "KHR_materials_scatter": {"scatterStrengthFactor": 0.5}}}]);
    let (scene, _) = parse(&file(&Corners::default(), thin, json!({}))).unwrap();
    let said = &scene.not_modelled;
    assert!(said.iter().any(|s| s.contains("thin walls") && s.contains("`leaf`")), "{said:?}");
}

/// Keys in extensions that are read which are not known are named with extension and material;
/// others are not.
#[test]
fn unknown_keys_of_known_extensions_are_said() {
    let (_, scene) = medium(
        json!({"KHR_materials_volume_scatter": {"scatterAlbedo": [1, 1, 1], "extras": {"a": 1}},
            "KHR_materials_sheen": {"sheenColourFactor": [1, 1, 1]},
            "KHR_materials_clearcoat": {"clearcoat": 1, "extensions": {"VENDOR_x": {"y": 1}}},
            "KHR_materials_emissive_strength": {"strength": 2},
            "KHR_materials_specular": {"specularTexture": {"index": 0, "extensions":
                {"KHR_texture_transform": {"rotate": 1, "rotation": 1}}}}}),
        json!([image([255; 4])]),
    );
    let said = scene.not_modelled;
    for (extension, key) in [
        ("KHR_materials_volume_scatter", "scatterAlbedo"),
        ("KHR_materials_sheen", "sheenColourFactor"),
        ("KHR_materials_clearcoat", "clearcoat"),
        ("KHR_materials_emissive_strength", "strength"),
        ("KHR_texture_transform", "rotate"),
    ] {
        let start = format!("key `{key}` of {extension} in material `wax`");
        assert!(said.iter().any(|s| s.starts_with(&start)), "{start}: {said:?}");
    }
    assert_eq!(said.len(), 5, "{said:?}");
    // Many materials with one unknown key are one sentence, and many keys do not flood the log.
    let many: serde_json::Map<String, Value> =
        (0..100).map(|i| (format!("key{i}"), json!(1))).collect();
    let materials: Vec<Value> = (0..3)
        .map(|i| json!({"name": format!("m{i}"), "extensions": {"KHR_materials_ior": many}}))
        .collect();
    let mut file = file(&Corners::default(), json!(materials), json!({}));
    let primitive = file["meshes"][0]["primitives"][0].clone();
    for i in 1..3 {
        let mut primitive = primitive.clone();
        primitive["material"] = json!(i);
        file["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive);
    }
    let said = parse(&file).unwrap().0.not_modelled;
    assert_eq!(said.len(), 33, "{said:?}");
    assert!(said[0].contains("`m0` and 2 more") && said[32].contains("68 more"), "{said:?}");
}

/// What is wrong with a material that no visible surface uses stops nothing and is not said; used,
/// it does.
#[test]
fn materials_that_nothing_uses_stop_nothing() {
    let faults = [
        (
            json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}),
            "lost.png (named by /images/0 of ",
        ),
        (
            json!({"emissiveTexture": {"index": 1, "texCoord": 2}}),
            "(/materials/0/emissiveTexture): the texture uses the set TEXCOORD_2",
        ),
        (json!({"normalTexture": {"index": 2}}), "(/textures/2): the texture has no image"),
        (
            json!({"normalTexture": {"index": 77}}),
            "(/materials/0/normalTexture): texture 77 does not exist",
        ),
        (json!({"alphaMode": "MAYBE"}), "(/materials/0/alphaMode): the alpha mode"),
        (
            json!({"extensions": {"KHR_materials_ior": {"ior": 0.5}}}),
            "(/materials/0/extensions/KHR_materials_ior/ior): the index of refraction",
        ),
        (
            json!({"extensions": {"KHR_materials_ior": {"ior": "glass"}}}),
            "(/materials/0/extensions/KHR_materials_ior/ior): string \"glass\"",
        ),
        (
            json!({"extensions": {"KHR_materials_volume": {"attenuationDistance": -1}}}),
            "(/materials/0/extensions/KHR_materials_volume/attenuationDistance): ",
        ),
    ];
    let more = json!({
        "images": [{"uri": "lost.png"}, image([255; 4]), {"uri": data(b"RIFF....WEBP", "image/webp")}],
        "textures": [{"source": 0}, {"source": 1}, {"extensions": {"EXT_texture_webp": {"source": 2}}}],
        "extensionsUsed": ["EXT_texture_webp", "KHR_texture_basisu"],
        "extensionsRequired": ["EXT_texture_webp", "KHR_texture_basisu"],
    });
    let quiet = json!({"name": "used", "emissiveFactor": [1, 0.5, 0]});
    for (fault, says) in &faults {
        let text = file(&Corners::default(), json!([quiet, fault]), more.clone());
        let (scene, found) = parse(&text).unwrap_or_else(|error| panic!("{fault}: {error}"));
        assert_eq!(below(&found.surfaces.unwrap(), 0.3, 0.2).emission, Vec3::new(1.0, 0.5, 0.0));
        assert!(scene.not_modelled.iter().all(|s| s.starts_with("extensions:")), "{fault}");
        let text = file(&Corners::default(), json!([fault, quiet]), more.clone());
        let error = parse(&text).err().unwrap_or_else(|| panic!("{fault} is used"));
        let says_more = matches!(error, Error::Io { .. }) || !error.remedy().is_empty();
        let said = error.to_string();
        assert!(says_more && said.contains("a.gltf") && said.contains(says), "{fault}: {said}");
    }
    // Lines, and meshes that no node shows, use no material.
    let mut lines = file(&Corners::default(), json!([quiet, faults[0].0]), more);
    let mut line = lines["meshes"][0]["primitives"][0].clone();
    (line["mode"], line["material"]) = (json!(1), json!(1));
    lines["meshes"][0]["primitives"].as_array_mut().unwrap().push(line.clone());
    line["mode"] = json!(6);
    lines["meshes"].as_array_mut().unwrap().push(json!({"primitives": [line]}));
    assert!(parse(&lines).unwrap().1.surfaces.is_some());
}

/// Two single-sided sheets back to back in one place: a ray meets the front that faces it,
/// whichever comes first in the file.
#[test]
fn sheets_back_to_back_show_their_fronts() {
    for order in [[0, 1], [1, 0]] {
        let colored = |name: &str| json!({"name": name});
        let mut text =
            file(&Corners::default(), json!([colored("up"), colored("down")]), json!({}));
        // The second mesh runs the other way around.
        let primitive = text["meshes"][0]["primitives"][0].clone();
        let indices: Vec<u8> = [0u16, 2, 1, 0, 3, 2].iter().flat_map(|i| i.to_le_bytes()).collect();
        text["buffers"]
            .as_array_mut()
            .unwrap()
            .push(json!({"byteLength": 12, "uri": data(&indices, "application/octet-stream")}));
        let views = text["bufferViews"].as_array_mut().unwrap();
        views.push(json!({"buffer": 1, "byteLength": 12}));
        let view = views.len() - 1;
        let accessors = text["accessors"].as_array_mut().unwrap();
        accessors
            .push(json!({"bufferView": view, "componentType": 5123, "type": "SCALAR", "count": 6}));
        let accessor = accessors.len() - 1;
        let mut down = primitive;
        (down["mode"], down["material"], down["indices"]) = (json!(4), json!(1), json!(accessor));
        text["meshes"].as_array_mut().unwrap().push(json!({"primitives": [down]}));
        text["nodes"] = json!([{"mesh": order[0]}, {"mesh": order[1]}]);
        text["scenes"] = json!([{"nodes": [0, 1]}]);
        let surfaces = surfaces(&text);
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        for (from, name) in [(1.0, "up"), (-1.0, "down")] {
            let (origin, along) = (DVec3::new(0.3, 0.2, from), Vec3::NEG_Z * from as f32);
            for hit in [
                surfaces.intersect(origin, along, 9.0, &mut rng).unwrap(),
                surfaces.seen(origin, along, 9.0, &mut rng).unwrap(),
            ] {
                let interaction = surfaces.interaction(&hit, along);
                assert!(interaction.front_face);
                assert_eq!(surfaces.material_name(interaction.material), name);
            }
        }
    }
}

//! Environment images as other programs write them. Inputs: `tests/data/cases/environment`; `plain`
//! is (u, v, 1/4) at texture coordinates (u, v), and so are most others in another guise.

use std::f32::consts::{PI, TAU};
use std::path::{Path, PathBuf};

use exr::prelude as x;
use glam::Vec3;
use pileus_scene::{EnvironmentImage, Error, GlassRule, gltf};

fn case(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/cases/environment").join(name)
}

fn open(path: impl AsRef<Path>) -> Result<EnvironmentImage, Error> {
    EnvironmentImage::open(path, 1.0, 0.0)
}

fn image(name: &str) -> EnvironmentImage {
    open(case(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// The direction at texture coordinates.
fn direction(u: f32, v: f32) -> Vec3 {
    let (phi, theta) = ((u - 0.5) * TAU, v * PI);
    Vec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos())
}

/// Coordinates away from the seam and the poles, where `plain` is linear.
fn places() -> impl Iterator<Item = (f32, f32)> {
    (1..8).flat_map(|i| (1..8).map(move |j| (0.04 + 0.115 * i as f32, 0.06 + 0.11 * j as f32)))
}

fn assert_close(name: &str, found: Vec3, expected: Vec3) {
    assert!((found - expected).abs().max_element() < 2e-4, "{name}: {found} {expected}");
}

/// Writes a file of R, G, B that is `value` at column and row of the display window.
fn write(
    path: &Path,
    data: [i32; 4],
    display: [i32; 4],
    change: impl FnOnce(&mut x::ImageAttributes, &mut x::LayerAttributes),
    value: impl Fn(i32, i32) -> [f32; 3] + Sync,
) {
    let size = (data[2] as usize, data[3] as usize);
    let channels = x::SpecificChannels::rgb(|at: x::Vec2<usize>| {
        let [r, g, b] =
            value(at.x() as i32 + data[0] - display[0], at.y() as i32 + data[1] - display[1]);
        (r, g, b)
    });
    let mut own = x::LayerAttributes::default().with_position(x::Vec2(data[0], data[1]));
    let mut shared = x::ImageAttributes::new(x::IntegerBounds::new(
        x::Vec2(display[0], display[1]),
        x::Vec2(display[2] as usize, display[3] as usize),
    ));
    change(&mut shared, &mut own);
    let layer = x::Layer::new(size, own, x::Encoding::FAST_LOSSLESS, channels);
    let mut picture = x::Image::from_layer(layer);
    picture.attributes = shared;
    x::WritableImage::write(&picture).non_parallel().to_file(path).unwrap();
}

fn no_change(_: &mut x::ImageAttributes, _: &mut x::LayerAttributes) {}

#[test]
fn layers_grey_and_radiance_signatures_are_read() {
    for (u, v) in places() {
        let d = direction(u, v);
        assert_close("plain", image("env_plain.exr").radiance(d), Vec3::new(u, v, 0.25));
        assert_close("layer", image("env_layer.exr").radiance(d), Vec3::new(u, v, 0.25));
        assert_close("y", image("env_y.exr").radiance(d), Vec3::splat(v));
    }
    let d = direction(0.3, 0.4);
    assert_eq!(image("env_rgbe.hdr").radiance(d), Vec3::new(1.0, 0.5, 0.25));
    // The same pixels behind EXPOSURE=2.
    assert_eq!(image("env_exposure.hdr").radiance(d), Vec3::new(0.5, 0.25, 0.125));
}

#[test]
fn colours_are_converted_to_rec_709_with_white_adapted() {
    let converted = image("env_ap1.exr");
    // Bradford from ACES' white to D65: OpenColorIO's matrix from ACEScg to linear Rec. 709.
    let rows = [
        Vec3::new(1.705_051, -0.621_792, -0.083_259),
        Vec3::new(-0.130_256, 1.140_805, -0.010_548),
        Vec3::new(-0.024_003, -0.128_969, 1.152_972),
    ];
    for (u, v) in places().filter(|(u, v)| (u - v).abs() < 0.2 && u + v > 0.6) {
        let own = Vec3::new(u, v, 0.25);
        let expected = Vec3::from_array(rows.map(|row| row.dot(own).max(0.0)));
        assert_close("ap1", converted.radiance(direction(u, v)), expected);
    }

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let window = [0, 0, 8, 4];
    let named = |id: &str| {
        let id = x::AttributeValue::Text(x::Text::from(id));
        move |_: &mut x::ImageAttributes, own: &mut x::LayerAttributes| {
            own.other.insert(x::Text::from("colorInteropID"), id);
        }
    };
    let ap1 = [1.3525, 0.4349, 0.4880];
    for (id, expected) in [
        ("lin_ap1_scene", ap1),
        ("lin_rec709_scene", [1.0, 0.5, 0.5]),
        // From the standards' matrices: ITU-R BT.2087 for Rec. 2020.
        ("lin_rec2020_scene", [1.3303, 0.4377, 0.4909]),
        ("a_space_of_my_own", [1.0, 0.5, 0.5]),
        ("srgb_rec709_scene", [1.0, 0.2140, 0.2140]),
    ] {
        write(&path, window, window, named(id), |_, _| [1.0, 0.5, 0.5]);
        assert_close(id, open(&path).unwrap().radiance(Vec3::X), Vec3::from_array(expected));
    }
    // Both attributes: the identifier counts, in either direction.
    let rec_709 = x::attribute::Chromaticities {
        red: x::Vec2(0.64, 0.33),
        green: x::Vec2(0.30, 0.60),
        blue: x::Vec2(0.15, 0.06),
        white: x::Vec2(0.3127, 0.3290),
    };
    let both = |shared: &mut x::ImageAttributes, own: &mut x::LayerAttributes| {
        shared.chromaticities = Some(rec_709);
        named("lin_ap1_scene")(shared, own);
    };
    write(&path, window, window, both, |_, _| [1.0, 0.5, 0.5]);
    assert_close("both", open(&path).unwrap().radiance(Vec3::X), Vec3::from_array(ap1));
}

#[test]
fn the_display_window_is_the_sphere() {
    let (full, trimmed) = (image("full.exr"), image("trimmed.exr"));
    assert_eq!(full.size(), trimmed.size());
    for (u, v) in places() {
        let d = direction(u, v);
        assert_eq!(full.radiance(d), trimmed.radiance(d), "{u} {v}");
    }
    assert_eq!(trimmed.radiance(Vec3::NEG_Y), Vec3::ZERO);
    let cropped = image("env_crop.exr");
    assert_eq!(cropped.size(), [16, 8]);
    assert_eq!(cropped.radiance(Vec3::new(0.0, -0.5, -1.0).normalize()), Vec3::ZERO);
    assert_close("crop", cropped.radiance(direction(0.3, 0.3)), Vec3::new(0.3, 0.3, 0.25));

    // Any window: inside, beyond an edge, larger than the picture, far from the origin.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let value = |x: i32, y: i32| [x as f32 + 100.0, y as f32 + 100.0, 1.0];
    for (display, data) in [
        ([0, 0, 12, 6], [3, 2, 4, 2]),
        ([0, 0, 12, 6], [-3, -2, 8, 5]),
        ([0, 0, 12, 6], [9, 4, 8, 5]),
        ([0, 0, 12, 6], [-2, -1, 17, 9]),
        ([1000, -500, 12, 6], [1003, -498, 4, 2]),
        ([-7, 5, 12, 6], [-7, 5, 12, 6]),
    ] {
        write(&path, data, display, no_change, value);
        let found = open(&path).unwrap();
        assert_eq!(found.size(), [12, 6]);
        for y in 0..6 {
            for x in 0..12 {
                let inside = (data[0]..data[0] + data[2]).contains(&(x + display[0]))
                    && (data[1]..data[1] + data[3]).contains(&(y + display[1]));
                let expected = if inside { value(x, y) } else { [0.0; 3] };
                let d = direction((x as f32 + 0.5) / 12.0, (y as f32 + 0.5) / 6.0);
                let error = (found.radiance(d) - Vec3::from_array(expected)).abs().max_element();
                assert!(error < 1e-2, "{display:?} {data:?} {x} {y}: {error}");
            }
        }
    }
    write(&path, [20, 0, 4, 4], [0, 0, 12, 6], no_change, value);
    let error = open(&path).unwrap_err();
    assert!(matches!(error, Error::Invalid { .. }) && error.to_string().contains("outside"));
    // A small file that claims a large picture.
    write(&path, [0, 0, 4, 4], [0, 0, 16000, 8000], no_change, value);
    assert!(matches!(open(&path), Err(Error::Invalid { .. })));
    write(&path, [0, 0, 4, 4], [0, 0, 60000, 30000], no_change, value);
    assert!(matches!(open(&path), Err(Error::Unsupported { .. })));
}

#[test]
fn what_cannot_be_used_is_named() {
    let refused = |path: &Path, words: &[&str]| {
        let error = open(path).unwrap_err();
        assert!(matches!(error, Error::Unsupported { .. }), "{error}");
        let text = format!("{error} / {}", error.remedy());
        assert!(words.iter().all(|word| text.contains(word)), "{text}");
    };
    refused(&case("env_cube.exr"), &["faces of a cube", "exrenvmap"]);
    refused(&case("env_ht.exr"), &["HTJ2K256", "ZIP or PIZ", "channels B, G, R"]);
    refused(&case("zstd.exr"), &["ZSTD", "ZIP or PIZ"]);
    refused(&case("lj2k.exr"), &["LJ2K", "ZIP or PIZ"]);

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    for (bytes, word) in [
        (&b""[..], "empty"),
        (b"\x89PNG\r\n\x1a\n", "PNG"),
        (b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        (b"\x1f\x8b\x08", "gzip"),
        (b"#", "neither OpenEXR nor Radiance"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        refused(&path, &[word]);
    }
    assert!(matches!(open(folder.path()), Err(Error::Invalid { .. })));
    assert!(matches!(open(folder.path().join("none.exr")), Err(Error::Io { .. })));
}

#[test]
fn lossy_dwa_lights_as_the_plain_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let channels = x::SpecificChannels::rgb(|at: x::Vec2<usize>| {
        let (u, v) = ((at.x() as f32 + 0.5) / 64.0, (at.y() as f32 + 0.5) / 32.0);
        (x::f16::from_f32(u), x::f16::from_f32(v), x::f16::from_f32(0.25))
    });
    let encoding = x::Encoding {
        compression: x::Compression::DWAA(None),
        blocks: x::Blocks::ScanLines,
        line_order: x::LineOrder::Increasing,
    };
    let layer = x::Layer::new((64, 32), x::LayerAttributes::default(), encoding, channels);
    x::WritableImage::write(&x::Image::from_layer(layer)).non_parallel().to_file(&path).unwrap();
    let found = open(&path).unwrap();
    for (u, v) in places() {
        let error = (found.radiance(direction(u, v)) - Vec3::new(u, v, 0.25)).abs();
        assert!(error.max_element() < 0.02, "{u} {v}: {error}");
    }
}

/// JPEG textures: whole, cut off at every fifth, with bytes behind the end.
#[test]
fn textures_that_are_cut_off_are_refused() {
    use base64::Engine;
    let engine = base64::engine::general_purpose::STANDARD;
    let picture = image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([(x * 4) as u8, y as u8, 9]));
    let mut jpeg = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut jpeg, image::ImageFormat::Jpeg).unwrap();
    let jpeg = jpeg.into_inner();
    let numbers = [0f32, 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 1.];
    let bytes: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
    let load = |image: &[u8]| {
        let text = serde_json::json!({
            "asset": { "version": "2.0" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{
                "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0
            }] }],
            "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
            "textures": [{ "source": 0 }],
            "images": [{ "uri": format!("data:image/jpeg;base64,{}", engine.encode(image)) }],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                  "min": [0, 0, 0], "max": [1, 1, 0] },
                { "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2" }
            ],
            "bufferViews": [
                { "buffer": 0, "byteLength": 36 },
                { "buffer": 0, "byteOffset": 36, "byteLength": 24 }
            ],
            "buffers": [{
                "byteLength": 60,
                "uri": format!("data:application/octet-stream;base64,{}", engine.encode(&bytes))
            }]
        });
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gltf");
        std::fs::write(&path, text.to_string()).unwrap();
        gltf::load_with_surfaces(&path, 683.0, GlassRule::default())
    };
    assert!(load(&jpeg).unwrap().1.surfaces.is_some());
    assert!(load(&[&jpeg[..], b"more"].concat()).is_ok());
    for fifth in 1..5 {
        let error = load(&jpeg[..jpeg.len() * fifth / 5]).unwrap_err();
        assert!(matches!(error, Error::Invalid { .. }), "{error}");
        assert_eq!(error.place().part.as_deref(), Some("/images/0"), "{error}");
    }
}

//! `pileus info`.

use std::path::Path;

use pileus_film::{ColorSpace, ExrHeader, ExrPart, Window, read_exr_header};
use pileus_media::{VoxelGrid, VoxelGridOptions};
use pileus_scene::gltf::{self, GltfScene};
use pileus_scene::volume::default_density_grid;
use pileus_scene::{Light, json::Document};
use pileus_vdb::{Compression, Coord, Grid, GridInfo, MetaValue, Metadata, Tree, Values, VdbFile};
use serde_json::{Map, Value, json};

use crate::cli::InfoOptions;
use crate::escape;
use crate::failure::Failure;
use crate::input::{Input, Kind, look};
use crate::job::GltfSpec;
use crate::report::Report;
use crate::settings::{Overrides, Settings};

pub(crate) fn run(options: &InfoOptions, report: &Report) -> Result<(), Failure> {
    if is_exr(&options.file) {
        let header = read_exr_header(&options.file)?;
        if options.json {
            report.json(&exr_json(&header))
        } else {
            report.text(exr_text(&options.file, &header))
        }
        return Ok(());
    }
    let (kind, text) = look(&options.file)?;
    match kind {
        Kind::Vdb => {
            let info = vdb(&options.file)?;
            if options.json {
                report.json(&info)
            } else {
                report.text(vdb_text(&options.file, &info))
            }
        }
        Kind::Gltf => {
            let scene = gltf::load(&options.file, GltfSpec::default().lumens_per_watt())?;
            let info = gltf_json(&scene);
            if options.json {
                report.json(&info)
            } else {
                report.text(gltf_text(&options.file, &scene))
            }
        }
        Kind::Job => {
            let input = Input::of_job(&options.file, text)?;
            let document = input.document.clone();
            let settings = Settings::resolve(input, &Overrides::default())?;
            let info = job_json(&settings, document.as_ref());
            if options.json {
                report.json(&info)
            } else {
                report.text(job_text(&options.file, &settings))
            }
        }
    }
    Ok(())
}

/// Whether a file is OpenEXR by its name, or by its first bytes.
fn is_exr(path: &Path) -> bool {
    use std::io::Read;
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr")) {
        return true;
    }
    // To open a pipe that nobody writes to never ends.
    let is_file = std::fs::metadata(path).is_ok_and(|meta| meta.is_file());
    let mut start = [0; 4];
    let read = |mut file: std::fs::File| file.read_exact(&mut start);
    is_file && std::fs::File::open(path).and_then(read).is_ok() && start == *b"\x76\x2f\x31\x01"
}

fn color_space(part: &ExrPart) -> String {
    ColorSpace::of_exr(part.color_interop_id.as_deref(), part.chromaticities).0.to_string()
}

/// The header of an image: parts, layers, colour space, and metadata. What this program wrote as
/// JSON (job, plan, counters) stands as JSON.
fn exr_json(header: &ExrHeader) -> Value {
    let window = |w: Window| json!([w.x, w.y, w.width, w.height]);
    let value = |value: &pileus_film::MetaValue| match value {
        pileus_film::MetaValue::Text(text) => match text.as_bytes().first() {
            Some(b'{' | b'[') => serde_json::from_str(text).unwrap_or_else(|_| json!(text)),
            _ => json!(text),
        },
        pileus_film::MetaValue::F32(v) => number(f64::from(*v)),
        pileus_film::MetaValue::F64(v) => number(*v),
        pileus_film::MetaValue::I32(v) => json!(v),
        other => json!(format!("{other:?}")),
    };
    let part = |part: &ExrPart| {
        let channels =
            part.channels.iter().map(|c| json!({ "name": c.name, "type": c.sample_type }));
        let metadata = part.metadata.iter().map(|(name, v)| (name.clone(), value(v)));
        json!({
            "name": part.name,
            "view": part.view,
            "compression": part.compression_name(),
            "deep": part.deep,
            "tiles": part.tiles,
            "data_window": window(part.data_window),
            "display_window": window(part.display_window),
            "cube_map": part.cube_map,
            "color_space": color_space(part),
            "layers": layers(part),
            "channels": channels.collect::<Vec<_>>(),
            "metadata": metadata.collect::<Map<_, _>>(),
        })
    };
    json!({ "parts": header.parts.iter().map(part).collect::<Vec<_>>() })
}

/// Names of layers in the order of the file.
fn layers(part: &ExrPart) -> Vec<&str> {
    let mut layers: Vec<&str> = Vec::new();
    for channel in &part.channels {
        if let Some((layer, _)) = channel.name.rsplit_once('.')
            && !layers.contains(&layer)
        {
            layers.push(layer);
        }
    }
    layers
}

fn exr_text(path: &Path, header: &ExrHeader) -> String {
    let escaped = |text: &str| text.escape_debug().to_string();
    let parts = header.parts.len();
    let mut lines = vec![format!(
        "{}: OpenEXR, {parts} {}",
        path.display(),
        if parts == 1 { "part" } else { "parts" },
    )];
    for (part, description) in header.parts.iter().zip(header.describe()) {
        lines.push(description);
        if part.data_window != part.display_window {
            let Window { x, y, .. } = part.data_window;
            let Window { width, height, x: left, y: top } = part.display_window;
            lines.push(format!(
                "  its pixels begin at ({x}, {y}) in a picture of {width} x {height} at \
                 ({left}, {top})"
            ));
        }
        lines.push(format!("  colour space: {}", color_space(part)));
        if part.cube_map {
            lines.push("  an environment on the faces of a cube".into());
        }
        let layers: Vec<_> = layers(part).into_iter().map(escaped).collect();
        if !layers.is_empty() {
            lines.push(format!("  layers: {}", layers.join(", ")));
        }
        for (name, value) in &part.metadata {
            let name = escaped(name);
            match value {
                pileus_film::MetaValue::Text(text) => {
                    let json = serde_json::from_str::<Value>(text).ok();
                    let json = json.filter(|v| v.is_object() || v.is_array());
                    match json.and_then(|v| serde_json::to_string_pretty(&v).ok()) {
                        // JSON has escaped what a terminal would obey, but for what is no ASCII.
                        Some(pretty) => {
                            lines.push(format!("{name}:"));
                            lines.extend(pretty.lines().map(|l| format!("  {}", shown(l))));
                        }
                        None if text.contains('\n') => {
                            lines.push(format!("{name}:"));
                            lines.extend(text.lines().map(|l| format!("  {}", shown(l))));
                        }
                        None => lines.push(format!("{name}: {}", shown(text))),
                    }
                }
                pileus_film::MetaValue::F32(v) => lines.push(format!("{name}: {v}")),
                pileus_film::MetaValue::F64(v) => lines.push(format!("{name}: {v}")),
                pileus_film::MetaValue::I32(v) => lines.push(format!("{name}: {v}")),
                _ => {}
            }
        }
    }
    lines.join("\n")
}

/// A line from a file without characters that a terminal obeys.
fn shown(line: &str) -> String {
    let escape = |c: char| {
        let escaped: String = c.escape_debug().collect();
        if c.is_control() { escaped } else { c.to_string() }
    };
    line.chars().map(escape).collect()
}

/// Lines that may hold names from files, as one text.
fn joined(lines: &[String]) -> String {
    lines.iter().map(|line| escape::line(line)).collect::<Vec<_>>().join("\n")
}

/// A number as JSON; what JSON does not have becomes a string.
pub(crate) fn number(value: f64) -> Value {
    match serde_json::Number::from_f64(value) {
        Some(number) => Value::Number(number),
        None if value.is_nan() => "nan".into(),
        None if value > 0.0 => "inf".into(),
        None => "-inf".into(),
    }
}

/// Values of a grid as JSON.
pub(crate) trait ToJson: Copy + PartialEq {
    fn to_json(self) -> Value;
}

impl ToJson for f32 {
    fn to_json(self) -> Value {
        number(f64::from(self))
    }
}

impl ToJson for f64 {
    fn to_json(self) -> Value {
        number(self)
    }
}

impl ToJson for i32 {
    fn to_json(self) -> Value {
        self.into()
    }
}

impl ToJson for i64 {
    fn to_json(self) -> Value {
        self.into()
    }
}

impl ToJson for bool {
    fn to_json(self) -> Value {
        self.into()
    }
}

impl<T: ToJson> ToJson for [T; 3] {
    fn to_json(self) -> Value {
        Value::Array(self.map(T::to_json).into())
    }
}

fn vdb(path: &Path) -> Result<Value, Failure> {
    let file = VdbFile::open(path)?;
    let density = default_density_grid(&file);
    let mut grids = Vec::new();
    let mut render_grid = Value::Null;
    for (index, info) in file.grids().iter().enumerate() {
        let mut entry = describe(info);
        match file.read(index) {
            Ok(grid) => {
                summarise(&mut entry, &grid);
                if density == Some(index) {
                    render_grid = build(grid)?;
                }
            }
            // A type that cannot be read is still worth listing.
            Err(error @ pileus_vdb::Error::Unsupported { .. }) => {
                entry.insert("unreadable".into(), error.to_string().into());
            }
            Err(error) => return Err(error.into()),
        }
        grids.push(Value::Object(entry));
    }
    let (major, minor) = file.library_version();
    Ok(json!({
        "file_version": file.version(),
        "library_version": format!("{major}.{minor}"),
        "metadata": metadata(file.metadata()),
        "grids": grids,
        "render_grid": render_grid,
    }))
}

/// What the header says about a grid.
fn describe(info: &GridInfo) -> Map<String, Value> {
    let matrix = info.transform.matrix().ok();
    let flat = matrix.map(|rows| rows.concat().into_iter().map(number).collect::<Vec<_>>());
    let mut entry = Map::new();
    for (key, value) in [
        ("name", json!(info.name)),
        ("index", json!(info.index)),
        ("type", json!(info.value_type.to_string())),
        ("class", json!(info.class.to_string())),
        ("compression", json!(compression(info.compression))),
        ("half", json!(info.saved_as_half)),
        ("instance_of", json!(info.instance_of)),
        ("transform", json!({ "kind": info.transform.kind().map_name(), "matrix": flat })),
        ("metadata", metadata(&info.metadata)),
    ] {
        entry.insert(key.into(), value);
    }
    entry
}

/// Named as OpenVDB names it.
fn compression(compression: Compression) -> String {
    let parts = [
        (compression.zip, "zip"),
        (compression.blosc, "blosc"),
        (compression.active_mask, "active values"),
    ];
    let names: Vec<&str> =
        parts.into_iter().filter_map(|(used, name)| used.then_some(name)).collect();
    if names.is_empty() { "none".into() } else { names.join(" + ") }
}

/// What the voxels say.
fn summarise(entry: &mut Map<String, Value>, grid: &Grid) {
    match &grid.values {
        Values::Float(tree) => fill(entry, tree, tree.min_max()),
        Values::Double(tree) => fill(entry, tree, tree.min_max()),
        Values::Int32(tree) => fill(entry, tree, tree.min_max()),
        Values::Int64(tree) => fill(entry, tree, tree.min_max()),
        Values::Bool(tree) | Values::Mask(tree) => fill(entry, tree, None),
        Values::Vec3f(tree) => fill(entry, tree, tree.min_max()),
        Values::Vec3d(tree) => fill(entry, tree, tree.min_max()),
        Values::Vec3i(tree) => fill(entry, tree, tree.min_max()),
    }
}

fn fill<T: ToJson>(entry: &mut Map<String, Value>, tree: &Tree<T>, range: Option<(T, T)>) {
    let corner = |c: Coord| json!(c);
    let bbox = tree.active_bbox().map(|(low, high)| json!([corner(low), corner(high)]));
    for (key, value) in [
        ("active_voxels", json!(tree.active_voxel_count())),
        ("leaf_count", json!(tree.leaves().len())),
        ("tile_count", json!(tree.tiles().iter().filter(|tile| tile.active).count())),
        ("bbox", bbox.unwrap_or(Value::Null)),
        ("background", tree.background().to_json()),
        ("min", range.map_or(Value::Null, |(min, _)| min.to_json())),
        ("max", range.map_or(Value::Null, |(_, max)| max.to_json())),
    ] {
        entry.insert(key.into(), value);
    }
}

/// Builds the render grid and tells what it takes.
fn build(grid: Grid) -> Result<Value, Failure> {
    let name = grid.info.full_name();
    let tree = grid.to_float()?;
    let active = tree.active_voxel_count();
    let built = VoxelGrid::from_tree(&tree, &VoxelGridOptions::default())?;
    let report = built.report();
    let bytes = report.bytes_voxels + report.bytes_bounds + report.bytes_index;
    let per =
        |count: u64| if count == 0 { Value::Null } else { json!(bytes as f64 / count as f64) };
    Ok(json!({
        "grid": name,
        "build_seconds": report.seconds,
        "bricks": report.bricks,
        "voxels": report.voxels,
        "stored_as_half": report.stored_as_half,
        "bytes": bytes,
        "bytes_voxels": report.bytes_voxels,
        "bytes_bounds": report.bytes_bounds,
        "bytes_index": report.bytes_index,
        "bytes_per_voxel": per(report.voxels),
        "bytes_per_active_voxel": per(active),
        "replaced_non_finite": report.replaced_non_finite,
        "replaced_negative": report.replaced_negative,
    }))
}

fn metadata(metadata: &Metadata) -> Value {
    let pairs = metadata.iter().map(|(name, value)| {
        let numbers = |values: &[f64]| Value::Array(values.iter().map(|&v| number(v)).collect());
        let value = match value {
            MetaValue::Bool(v) => json!(v),
            MetaValue::Int32(v) => json!(v),
            MetaValue::Int64(v) => json!(v),
            MetaValue::Float(v) => number(f64::from(*v)),
            MetaValue::Double(v) => number(*v),
            MetaValue::String(v) => json!(v),
            MetaValue::Vec2i(v) => json!(v),
            MetaValue::Vec3i(v) => json!(v),
            MetaValue::Vec4i(v) => json!(v),
            MetaValue::Vec2f(v) => numbers(&v.map(f64::from)),
            MetaValue::Vec3f(v) => numbers(&v.map(f64::from)),
            MetaValue::Vec4f(v) => numbers(&v.map(f64::from)),
            MetaValue::Vec2d(v) => numbers(v),
            MetaValue::Vec3d(v) => numbers(v),
            MetaValue::Vec4d(v) => numbers(v),
            MetaValue::Mat4f(v) => numbers(&v.map(f64::from)),
            MetaValue::Mat4d(v) => numbers(v),
            other => json!(other.to_string()),
        };
        (name.to_owned(), value)
    });
    Value::Object(pairs.collect())
}

fn vdb_text(path: &Path, info: &Value) -> String {
    let at = |value: &Value, key: &str| match value.get(key) {
        Some(Value::String(text)) => text.clone(),
        Some(Value::Null) | None => "-".into(),
        Some(value) => value.to_string(),
    };
    let mut lines = vec![format!(
        "{}: OpenVDB, file format {}, library {}",
        path.display(),
        at(info, "file_version"),
        at(info, "library_version"),
    )];
    for grid in info.get("grids").and_then(Value::as_array).into_iter().flatten() {
        let half =
            if grid.get("half") == Some(&Value::Bool(true)) { ", saved as half" } else { "" };
        lines.push(format!("grid {}[{}]", at(grid, "name"), at(grid, "index")));
        lines.push(format!(
            "  {}, {}, {}{half}",
            at(grid, "type"),
            at(grid, "class"),
            at(grid, "compression"),
        ));
        if let Some(error) = grid.get("unreadable") {
            lines.push(format!("  cannot be read: {error}"));
            continue;
        }
        lines.push(format!(
            "  {} active voxels in {}, {} leaves, {} tiles",
            at(grid, "active_voxels"),
            at(grid, "bbox"),
            at(grid, "leaf_count"),
            at(grid, "tile_count"),
        ));
        lines.push(format!(
            "  values {} to {}, background {}",
            at(grid, "min"),
            at(grid, "max"),
            at(grid, "background"),
        ));
        if let Some(transform) = grid.get("transform") {
            lines.push(format!("  {} {}", at(transform, "kind"), at(transform, "matrix")));
        }
    }
    if let Some(built) = info.get("render_grid").filter(|built| built.is_object()) {
        let float = |key: &str| built.get(key).and_then(Value::as_f64).unwrap_or(0.0);
        lines.push(format!(
            "render grid of {}: built in {:.3} s, {:.2} MB, {:.2} bytes per stored voxel, {:.2} per active voxel, {}",
            at(built, "grid"),
            float("build_seconds"),
            float("bytes") * 1e-6,
            float("bytes_per_voxel"),
            float("bytes_per_active_voxel"),
            if built.get("stored_as_half") == Some(&Value::Bool(true)) { "binary16" } else { "binary32" },
        ));
    }
    joined(&lines)
}

fn matrix(transform: &glam::DAffine3) -> Vec<f64> {
    // Column-major, as glTF writes node matrices.
    glam::DMat4::from(*transform).to_cols_array().to_vec()
}

fn gltf_json(scene: &GltfScene) -> Value {
    let cameras: Vec<Value> = scene
        .cameras
        .iter()
        .map(|camera| {
            json!({
                "node": camera.node,
                "type": if camera.magnification.is_some() { "orthographic" } else { "perspective" },
                "fov_y": camera.fov_y_degrees,
                "height": camera.magnification.map(|[_, ymag]| 2.0 * ymag),
                "aspect_ratio": camera.aspect_ratio,
                "matrix": matrix(&camera.to_world),
            })
        })
        .collect();
    let volumes: Vec<Value> = scene
        .volumes
        .iter()
        .map(|volume| {
            json!({
                "node": volume.node,
                "volume": *volume.spec,
                "matrix": matrix(&volume.to_world),
            })
        })
        .collect();
    json!({
        "counts": scene.counts,
        "cameras": cameras,
        "lights": scene.lights.iter().map(Light::description).collect::<Vec<_>>(),
        "volumes": volumes,
        "warnings": scene.warnings,
        "not_modelled": scene.not_modelled,
    })
}

fn gltf_text(path: &Path, scene: &GltfScene) -> String {
    let counts = &scene.counts;
    let mut lines = vec![format!(
        "{}: glTF 2.0, {} nodes, {} meshes, {} materials, {} animations",
        path.display(),
        counts.nodes,
        counts.meshes,
        counts.materials,
        counts.animations,
    )];
    for camera in &scene.cameras {
        let view = match (camera.fov_y_degrees, camera.magnification) {
            (Some(angle), _) => format!("{angle:.2} degrees high"),
            (None, Some([_, ymag])) => format!("orthographic, {:.4} high", 2.0 * ymag),
            (None, None) => "of no known type".into(),
        };
        lines.push(format!(
            "camera `{}`: {view}, at {:.4}",
            camera.node, camera.to_world.translation
        ));
    }
    for light in &scene.lights {
        lines.push(format!("light {}", light.description()));
    }
    for volume in &scene.volumes {
        let spec = serde_json::to_string(&*volume.spec).unwrap_or_default();
        lines.push(format!(
            "volume `{}`: {spec}, at {:.4}",
            volume.node, volume.to_world.translation
        ));
    }
    lines.extend(scene.warnings.iter().map(|item| format!("warning: {item}")));
    lines.extend(scene.not_modelled.iter().map(|item| format!("not modelled: {item}")));
    joined(&lines)
}

fn job_json(settings: &Settings, document: Option<&Document>) -> Value {
    let files: Vec<Value> = settings
        .files()
        .iter()
        .map(|path| json!({ "path": path.to_string_lossy(), "exists": path.is_file() }))
        .collect();
    json!({
        "job": settings.job(),
        "bytes": document.map(|document| document.text().len()),
        "files": files,
        "outputs": {
            "image": settings.outputs.image.to_string_lossy(),
            "preview": settings.outputs.preview.as_ref().map(|path| path.to_string_lossy()),
            "stats": settings.outputs.stats.as_ref().map(|path| path.to_string_lossy()),
        },
        "samples": settings.render.samples.end,
        "seed": settings.render.seed,
        "max_bounces": settings.render.max_bounces,
    })
}

fn job_text(path: &Path, settings: &Settings) -> String {
    let job = settings.job();
    let mut lines = vec![format!(
        "{}: job, {} volumes, {} lights, {} samples per pixel, seed {}",
        path.display(),
        job.volumes.iter().flatten().count(),
        job.lights.iter().flatten().count(),
        settings.render.samples.end,
        settings.render.seed,
    )];
    for file in settings.files() {
        let missing = if file.is_file() { "" } else { " (missing)" };
        lines.push(format!("reads {}{missing}", file.display()));
    }
    let targets = settings.targets(0);
    lines.extend(targets.iter().map(|target| format!("writes {}", target.path.display())));
    joined(&lines)
}

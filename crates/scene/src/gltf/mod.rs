//! Reads what Pileus renders out of a glTF 2.0 file: cameras, punctual lights, volumes, surfaces.
//!
//! [`load`] and [`parse`] need the JSON part of a file alone (and the buffers that place instances
//! of volumes and lights); [`load_with_surfaces`] and [`parse_with_surfaces`] read its buffers and
//! images as well. What is left out is listed.

mod accessor;
mod buffer;
mod contents;
mod extensions;
mod image_guard;
mod instances;
mod material;
mod mesh;
mod names;
mod phase;
mod pose;
mod texture;
mod volume;
mod walk;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use gltf::json;

pub use contents::{GltfCamera, GltfCounts, GltfMesh, GltfScene, GltfVolume};
pub use mesh::GltfSurfaces;
pub(crate) use names::list_names;

use crate::error::{Error, Place};
use crate::json::{Document, acceptable_gltf};
use crate::surface::GlassRule;
use extensions::{MODELLED, is_modelled};
use volume::flat_keys;
use walk::walk;

/// Largest JSON part of a glTF file.
const MAX_JSON: u64 = 64 << 20;
/// Largest .glb file.
const MAX_GLB: u64 = 4 << 30;

/// The custom properties (flat keys of `extras`) by which a node becomes a volume: name and
/// meaning.
pub fn custom_properties() -> Vec<(&'static str, &'static str)> {
    flat_keys()
}

/// Reads a .gltf or .glb file.
///
/// `lumens_per_watt` turns the candela and lux of `KHR_lights_punctual` into radiometric units:
/// intensities are divided by it.
pub fn load(path: impl AsRef<Path>, lumens_per_watt: f64) -> Result<GltfScene, Error> {
    let path = path.as_ref();
    parse(path, &read(path)?, lumens_per_watt)
}

/// Reads a .gltf or .glb file and the meshes, materials and images that its scene shows.
pub fn load_with_surfaces(
    path: impl AsRef<Path>,
    lumens_per_watt: f64,
    rule: GlassRule,
) -> Result<(GltfScene, GltfSurfaces), Error> {
    let path = path.as_ref();
    parse_with_surfaces(path, &read(path)?, lumens_per_watt, rule)
}

fn read(path: &Path) -> Result<Vec<u8>, Error> {
    let io = |source| Error::io(Place::file(path), source);
    let large = |length: u64| {
        Error::unsupported(
            Place::file(path),
            format!("the file has {length} bytes or more"),
            "split the scene: files of up to 4 GiB are read",
        )
    };
    let file = File::open(path).map_err(io)?;
    let metadata = file.metadata().map_err(io)?;
    // This file the user names himself: it may come through a pipe, whose length is not known.
    let (length, limit) =
        if metadata.is_file() { (metadata.len(), MAX_GLB) } else { (0, MAX_JSON) };
    if length > limit {
        return Err(large(length));
    }
    let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
    file.take(limit + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > limit {
        return Err(large(bytes.len() as u64));
    }
    Ok(bytes)
}

/// Reads a glTF file from its bytes; `path` names it and is what its files are relative to.
pub fn parse(
    path: impl AsRef<Path>,
    bytes: &[u8],
    lumens_per_watt: f64,
) -> Result<GltfScene, Error> {
    let parts = Parts::split(path.as_ref(), bytes)?;
    let document = Document::new(path.as_ref(), parts.json);
    let (root, animations) = read_root(&document)?;
    walk(&document, &root, parts.bin, animations, lumens_per_watt)
}

/// Reads a glTF file and its surfaces from its bytes, with the buffers and images that it names.
///
/// `path` names the file and is what its files are relative to.
pub fn parse_with_surfaces(
    path: impl AsRef<Path>,
    bytes: &[u8],
    lumens_per_watt: f64,
    rule: GlassRule,
) -> Result<(GltfScene, GltfSurfaces), Error> {
    let parts = Parts::split(path.as_ref(), bytes)?;
    let document = Document::new(path.as_ref(), parts.json);
    let (root, animations) = read_root(&document)?;
    let mut scene = walk(&document, &root, parts.bin, animations, lumens_per_watt)?;
    let surfaces = mesh::load(&document, &root, parts.bin, &scene, rule)?;
    scene.not_modelled.extend(surfaces.not_modelled.iter().cloned());
    Ok((scene, surfaces))
}

/// The file without its animations, and how many these are.
fn read_root(document: &Document) -> Result<(json::Root, usize), Error> {
    document.check_syntax()?;
    let (text, animations) = acceptable_gltf(document.text());
    let root: json::Root = document.parse_edited(&text)?;
    if !root.asset.version.starts_with("2.") {
        return Err(Error::unsupported(
            document.place("/asset/version"),
            format!("glTF version `{}`", root.asset.version),
            "export the scene as glTF 2.0",
        ));
    }
    check_required(document, &root)?;
    Ok((root, animations))
}

/// The parts of a file.
struct Parts<'a> {
    json: &'a str,
    /// The binary chunk of a .glb file.
    bin: Option<&'a [u8]>,
}

impl<'a> Parts<'a> {
    fn split(path: &Path, bytes: &'a [u8]) -> Result<Self, Error> {
        let json = json_text(path, bytes)?;
        let bin =
            if bytes.starts_with(b"glTF") { bin_chunk(path, bytes, json.len())? } else { None };
        Ok(Self { json, bin })
    }
}

/// The binary chunk of a .glb file, the second one if there is one; unknown chunks after it are
/// ignored.
fn bin_chunk<'a>(path: &Path, bytes: &'a [u8], json: usize) -> Result<Option<&'a [u8]>, Error> {
    let Some(rest) = json.checked_add(20).and_then(|start| bytes.get(start..)) else {
        return Ok(None);
    };
    let (Some(length), Some(kind)) = (rest.first_chunk::<4>(), rest.get(4..8)) else {
        return Ok(None);
    };
    if kind != b"BIN\0" {
        return Ok(None);
    }
    let length = usize::try_from(u32::from_le_bytes(*length)).ok();
    let chunk = length.and_then(|length| rest.get(8..length.checked_add(8)?));
    chunk.map(Some).ok_or_else(|| {
        Error::invalid(
            Place::file(path),
            "the .glb file ends inside its binary chunk",
            "export the file again, it is damaged",
        )
    })
}

/// The JSON part of a .gltf or .glb file (glTF 2.0, section 4.4).
fn json_text<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a str, Error> {
    let invalid = |what: &str| {
        Error::invalid(Place::file(path), what, "export the file again, it is damaged")
    };
    let word = |at: usize| {
        let word = bytes.get(at..at + 4)?;
        Some(u32::from_le_bytes(word.try_into().ok()?))
    };
    let json = if bytes.starts_with(b"glTF") {
        let (Some(version), Some(length), Some(kind)) = (word(4), word(12), word(16)) else {
            return Err(invalid("the .glb file ends in its header"));
        };
        if version != 2 {
            return Err(Error::unsupported(
                Place::file(path),
                format!("version {version} of the .glb container"),
                "export the scene as glTF 2.0",
            ));
        }
        if kind != u32::from_le_bytes(*b"JSON") {
            return Err(invalid("the first chunk of the .glb file is not JSON"));
        }
        let end = usize::try_from(length).ok().and_then(|l| l.checked_add(20));
        end.and_then(|end| bytes.get(20..end))
            .ok_or_else(|| invalid("the .glb file ends inside its JSON"))?
    } else {
        // A byte order mark is not allowed, but harmless.
        bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
    };
    if json.len() as u64 > MAX_JSON {
        return Err(Error::unsupported(
            Place::file(path),
            format!("the JSON has {} bytes", json.len()),
            "keep meshes in a binary buffer: JSON of up to 64 MiB is read",
        ));
    }
    std::str::from_utf8(json).map_err(|_| invalid("the JSON is not UTF-8"))
}

fn check_required(document: &Document, root: &json::Root) -> Result<(), Error> {
    let required = root.extensions_required.iter().map(String::as_str);
    let unknown: Vec<&str> = required
        .filter(|name| !is_modelled(name) && !texture::IMAGE_FORMATS.contains(name))
        .collect();
    if unknown.is_empty() {
        return Ok(());
    }
    let modelled: Vec<&str> = MODELLED.into_iter().chain(material::MODELLED).collect();
    Err(Error::unsupported(
        document.place("/extensionsRequired"),
        format!("the file requires extensions that are not supported: {}", unknown.join(", ")),
        format!(
            "export without them (compression of meshes and textures can be switched off in the \
             exporter); supported are {}",
            modelled.join(", ")
        ),
    ))
}

#[cfg(test)]
mod tests;

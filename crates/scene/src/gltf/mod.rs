//! Reads what Pileus renders out of a glTF 2.0 file: cameras, punctual lights, volumes, surfaces.
//!
//! [`load`] and [`parse`] need the JSON part of a file alone (and the buffers that place instances
//! of volumes and lights); [`load_with_surfaces`] and [`parse_with_surfaces`] read its buffers and
//! images as well. What is left out is listed.

mod accessor;
mod buffer;
mod image_guard;
mod instances;
mod material;
mod mesh;
mod phase;
mod pose;
mod texture;
mod volume;

use std::collections::BTreeSet;
use std::f32::consts::{FRAC_PI_4, PI};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use gltf::json;
use serde_json::{Map, Value};

pub use mesh::{GltfMesh, GltfSurfaces};

use crate::error::{Error, Place};
use crate::json::{Document, acceptable_gltf};
use crate::light::{Light, Point, Spot, Sun};
use crate::spec::volume_spec::VolumeSpec;
use crate::surface::GlassRule;
use accessor::Accessors;
use buffer::Buffers;
use instances::{INSTANCING, instances};
use pose::default_weights;
use volume::{EXTENSION, KEPT, flat_keys, volume_of_node};

/// What a glTF file contributes to a scene.
#[derive(Debug, Clone)]
pub struct GltfScene {
    /// Cameras of the file, in the order of the node walk.
    pub cameras: Vec<GltfCamera>,
    /// Punctual lights of the file in radiometric units.
    pub lights: Vec<Light>,
    /// Volumes of the file.
    pub volumes: Vec<GltfVolume>,
    /// Nodes of the file that have meshes.
    pub meshes: Vec<GltfMesh>,
    /// What it contains and this version leaves out, as sentences.
    pub not_modelled: Vec<String>,
    /// What was chosen in it, as sentences for people.
    pub notes: Vec<String>,
    /// What is likely not meant so, as sentences for people.
    pub warnings: Vec<String>,
    /// The program that wrote it, by its own name.
    pub generator: Option<String>,
    /// Whether it has nodes that hold nothing: an empty that lost its properties, perhaps.
    pub has_empties: bool,
    /// World transforms of the nodes, if a mesh is placed by the joints of a skin; `None` for nodes
    /// that are their own ancestors.
    pub(crate) transforms: Vec<Option<DAffine3>>,
    /// Numbers of things in the file, for `info`.
    pub counts: GltfCounts,
    /// The files that its buffers and images are in, whether they are needed or not.
    pub files: Vec<PathBuf>,
}

/// A perspective camera of a glTF file.
#[derive(Debug, Clone, PartialEq)]
pub struct GltfCamera {
    /// Name of its node; empty if it has none.
    pub node: String,
    /// Number of its node in the file.
    pub index: usize,
    /// Name of the camera itself; empty if it has none.
    pub name: String,
    /// From the camera's space (it looks along -Z) to the world.
    pub to_world: DAffine3,
    /// Full vertical opening angle in degrees; `None` for an orthographic camera.
    pub fov_y_degrees: Option<f64>,
    /// Width over height of the view it was made for.
    pub aspect_ratio: Option<f64>,
}

/// A volume of a glTF file.
#[derive(Debug, Clone, PartialEq)]
pub struct GltfVolume {
    /// Name of its node; empty if it has none.
    pub node: String,
    /// What the node says; its file names are resolved. Instances of a node share it.
    pub spec: Arc<VolumeSpec>,
    /// World transform of the node, or of its instance.
    pub to_world: DAffine3,
    /// Where the specification stands, a JSON pointer.
    pub pointer: String,
    /// File, line and column of the specification.
    pub place: Place,
}

/// Numbers of things in a glTF file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
#[expect(missing_docs, reason = "named as glTF names them")]
pub struct GltfCounts {
    pub nodes: usize,
    pub meshes: usize,
    pub materials: usize,
    pub textures: usize,
    pub animations: usize,
    pub skins: usize,
}

/// Largest JSON part of a glTF file.
const MAX_JSON: u64 = 64 << 20;
/// Largest .glb file.
const MAX_GLB: u64 = 4 << 30;

/// The extension that hides nodes with all that is below them.
const VISIBILITY: &str = "KHR_node_visibility";

/// Extensions that are modelled, besides those of materials. `KHR_mesh_quantization` only allows
/// more types of components, `KHR_animation_pointer` more targets of animations, which are not
/// played.
const MODELLED: [&str; 7] = [
    EXTENSION,
    INSTANCING,
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    VISIBILITY,
    "KHR_texture_transform",
];

/// Names that a list in a message shows.
const SHOWN: usize = 8;
/// The custom properties (flat keys of `extras`) by which a node becomes a volume: name and
/// meaning.
pub fn custom_properties() -> Vec<(&'static str, &'static str)> {
    flat_keys()
}

fn is_modelled(extension: &str) -> bool {
    MODELLED.contains(&extension) || material::MODELLED.contains(&extension)
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

fn walk(
    document: &Document,
    root: &json::Root,
    bin: Option<&[u8]>,
    animations: usize,
    lumens_per_watt: f64,
) -> Result<GltfScene, Error> {
    if !(lumens_per_watt > 0.0 && lumens_per_watt.is_finite()) {
        return Err(Error::invalid(
            Place::part(document.path(), "lumens_per_watt"),
            format!("{lumens_per_watt} lumens per watt"),
            "use a number above 0; 683 is the default",
        ));
    }
    let buffers = Buffers::new(document, root, bin);
    let mut walk = Walk {
        document,
        root,
        accessors: Accessors::new(&buffers),
        lumens_per_watt,
        transforms: vec![None; root.nodes.len()],
        hidden: 0,
        flat: Vec::new(),
        kept: BTreeSet::new(),
        scene: GltfScene {
            cameras: Vec::new(),
            lights: Vec::new(),
            volumes: Vec::new(),
            meshes: Vec::new(),
            not_modelled: Vec::new(),
            notes: Vec::new(),
            warnings: Vec::new(),
            generator: root.asset.generator.clone(),
            has_empties: false,
            transforms: Vec::new(),
            counts: GltfCounts {
                nodes: root.nodes.len(),
                meshes: root.meshes.len(),
                materials: root.materials.len(),
                textures: root.textures.len(),
                animations,
                skins: root.skins.len(),
            },
            files: crate::files::of_gltf(document, root),
        },
    };
    walk.run()?;
    if walk.scene.meshes.iter().any(|mesh| mesh.skin.is_some()) {
        walk.place_others()?;
    }
    Ok(walk.finish())
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

struct Walk<'a> {
    document: &'a Document,
    root: &'a json::Root,
    accessors: Accessors<'a>,
    lumens_per_watt: f64,
    /// World transforms of the nodes that were visited.
    transforms: Vec<Option<DAffine3>>,
    /// Nodes that hide themselves and what is below them.
    hidden: usize,
    /// Names of nodes whose volume or light is scaled to nothing.
    flat: Vec<String>,
    /// Names of extensions that `extras` keep and that are not read there.
    kept: BTreeSet<String>,
    scene: GltfScene,
}

/// A node's `extras` as far as they can mean something here: an object.
fn object(extras: &json::Extras) -> Option<Map<String, Value>> {
    extras.as_ref().and_then(|extras| serde_json::from_str(extras.get()).ok())
}

impl Walk<'_> {
    /// Visits every node of the default scene once, parents before children, in file order.
    fn run(&mut self) -> Result<(), Error> {
        let mut stack: Vec<(usize, DAffine3, bool)> = Vec::new();
        let mut roots = self.roots()?;
        roots.reverse();
        stack.extend(roots.into_iter().map(|node| (node, DAffine3::IDENTITY, false)));
        while let Some((index, parent, hidden)) = stack.pop() {
            let pointer = format!("/nodes/{index}");
            let (Some(node), Some(place)) =
                (self.root.nodes.get(index), self.transforms.get(index))
            else {
                return Err(Error::invalid(
                    self.document.place("/nodes"),
                    format!("node {index} does not exist"),
                    "export the file again, its node tree is damaged",
                ));
            };
            if place.is_some() {
                return Err(Error::invalid(
                    self.document.place(&pointer),
                    format!("node {index} has two parents or is its own ancestor"),
                    "export the file again, its node tree is damaged",
                ));
            }
            let to_world = parent * self.local_transform(&pointer, node)?;
            if !to_world.is_finite() {
                return Err(Error::invalid(
                    self.document.place(&pointer),
                    "the node's world transform is not finite",
                    "check the scales of the node and its parents",
                ));
            }
            if let Some(place) = self.transforms.get_mut(index) {
                *place = Some(to_world);
            }
            let extras = object(&node.extras);
            // What is below a hidden node is hidden, whatever it says itself.
            let hides = !hidden && !self.is_visible(&pointer, node, extras.as_ref())?;
            self.hidden += usize::from(hides);
            let hidden = hidden || hides;
            self.visit(index, node, extras.as_ref(), &to_world, hidden)?;
            let children = node.children.as_deref().unwrap_or_default();
            stack.extend(children.iter().rev().map(|child| (child.value(), to_world, hidden)));
        }
        Ok(())
    }

    /// Places the nodes that are not part of the scene: joints need not be, in files as found.
    fn place_others(&mut self) -> Result<(), Error> {
        let mut stack: Vec<(usize, DAffine3)> =
            self.orphans().into_iter().map(|node| (node, DAffine3::IDENTITY)).collect();
        while let Some((index, parent)) = stack.pop() {
            let (Some(node), Some(None)) = (self.root.nodes.get(index), self.transforms.get(index))
            else {
                continue;
            };
            let to_world = parent * self.local_transform(&format!("/nodes/{index}"), node)?;
            if let Some(place) = self.transforms.get_mut(index) {
                *place = Some(to_world);
            }
            let children = node.children.as_deref().unwrap_or_default();
            stack.extend(children.iter().map(|child| (child.value(), to_world)));
        }
        Ok(())
    }

    /// What a node says about its visibility (`KHR_node_visibility`).
    fn is_visible(
        &self,
        pointer: &str,
        node: &json::scene::Node,
        extras: Option<&Map<String, Value>>,
    ) -> Result<bool, Error> {
        let own = node.extensions.as_ref().and_then(|e| e.others.get(VISIBILITY));
        let kept = || extras.and_then(|extras| extras.get(KEPT)?.get(VISIBILITY));
        match own.or_else(kept).and_then(|said| said.get("visible")) {
            None => Ok(true),
            Some(Value::Bool(visible)) => Ok(*visible),
            Some(_) => Err(Error::invalid(
                self.document.place(pointer),
                format!("`visible` of {VISIBILITY} is not true or false"),
                "export the file again",
            )),
        }
    }

    fn finish(mut self) -> GltfScene {
        let count = |n: usize, one: &str, many: &str| match n {
            1 => format!("1 {one}"),
            _ => format!("{n} {many}"),
        };
        let scenes = self.root.scenes.len();
        if scenes > 1 {
            let index = self.root.scene.map_or(0, |scene| scene.value());
            let name = self.root.scenes.get(index).and_then(|scene| scene.name.clone());
            let name = name.map_or(String::new(), |name| format!(" `{name}`"));
            self.scene.notes.push(format!("scene {index}{name} of {scenes} is rendered"));
        }
        if self.hidden > 0 {
            let nodes = count(self.hidden, "node is", "nodes are");
            self.scene.notes.push(format!(
                "{nodes} hidden with all that is below ({VISIBILITY}); cameras there count"
            ));
        }
        if !self.flat.is_empty() {
            let things = count(self.flat.len(), "volume or light is", "volumes and lights are");
            self.scene.warnings.push(format!(
                "{things} scaled to nothing and left out, at {}",
                list_names(&self.flat)
            ));
        }
        let kept = |extras: &json::Extras| {
            // Most materials have none, and few of those the key.
            extras.as_ref().filter(|e| e.get().contains(KEPT)).and_then(|_| object(extras))
        };
        for extras in self.root.materials.iter().filter_map(|material| kept(&material.extras)) {
            if let Some(Value::Object(extensions)) = extras.get(KEPT) {
                self.kept.extend(extensions.keys().cloned());
            }
        }
        if !self.kept.is_empty() {
            let names = self.kept.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
            self.scene
                .not_modelled
                .push(format!("extensions that were moved to `extras.{KEPT}`: {names}"));
        }
        if self.scene.meshes.iter().any(|mesh| mesh.skin.is_some()) {
            self.scene.transforms = self.transforms;
        }
        list_not_modelled(self.root, &mut self.scene);
        self.scene
    }

    fn roots(&self) -> Result<Vec<usize>, Error> {
        let index = self.root.scene.map_or(0, |scene| scene.value());
        if let Some(scene) = self.root.scenes.get(index) {
            return Ok(scene.nodes.iter().map(json::Index::value).collect());
        }
        if self.root.scene.is_some() {
            return Err(Error::invalid(
                self.document.place("/scene"),
                format!("scene {index} does not exist"),
                "export the file again",
            ));
        }
        // Without scenes all of these are roots.
        Ok(self.orphans())
    }

    /// The nodes that are nobody's children.
    fn orphans(&self) -> Vec<usize> {
        let mut is_child = vec![false; self.root.nodes.len()];
        for child in self.root.nodes.iter().filter_map(|n| n.children.as_ref()).flatten() {
            if let Some(flag) = is_child.get_mut(child.value()) {
                *flag = true;
            }
        }
        (0..is_child.len()).filter(|&i| is_child.get(i) == Some(&false)).collect()
    }

    fn local_transform(&self, pointer: &str, node: &json::scene::Node) -> Result<DAffine3, Error> {
        if let Some(matrix) = node.matrix {
            let [x, y, z, w] = [0, 4, 8, 12].map(|column| {
                let at = |row: usize| matrix.get(column + row).map_or(0.0, |&v| f64::from(v));
                DVec3::new(at(0), at(1), at(2))
            });
            return Ok(DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: w });
        }
        let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let rotation = match node.rotation {
            None => DQuat::IDENTITY,
            Some(json::scene::UnitQuaternion(q)) => {
                let q = DQuat::from_array(q.map(f64::from));
                if !(q.length_squared() > 1e-12 && q.is_finite()) {
                    return Err(Error::invalid(
                        self.document.place(&format!("{pointer}/rotation")),
                        "the rotation is not a unit quaternion",
                        "export the file again",
                    ));
                }
                q.normalize()
            }
        };
        Ok(DAffine3::from_scale_rotation_translation(
            node.scale.map_or(DVec3::ONE, vector),
            rotation,
            node.translation.map_or(DVec3::ZERO, vector),
        ))
    }

    fn visit(
        &mut self,
        index: usize,
        node: &json::scene::Node,
        extras: Option<&Map<String, Value>>,
        to_world: &DAffine3,
        hidden: bool,
    ) -> Result<(), Error> {
        let name = node.name.clone().unwrap_or_default();
        if let Some(camera) = node.camera {
            self.camera(index, &name, camera.value(), to_world)?;
        }
        if hidden {
            return Ok(());
        }
        if let Some(Value::Object(extensions)) = extras.and_then(|extras| extras.get(KEPT)) {
            let read = [EXTENSION, VISIBILITY];
            let others = extensions.keys().filter(|name| !read.contains(&name.as_str()));
            self.kept.extend(others.cloned());
        }
        let extensions = node.extensions.as_ref();
        if let Some(mesh) = node.mesh {
            let Some(found) = self.root.meshes.get(mesh.value()) else {
                return Err(self.no_such("mesh", mesh.value(), &name));
            };
            self.scene.meshes.push(GltfMesh {
                name: name.clone(),
                node: index,
                mesh: mesh.value(),
                to_world: *to_world,
                skin: node.skin.map(|skin| skin.value()),
                weights: default_weights(node, found),
            });
        }
        let has_extension = extensions.is_some_and(|e| e.others.contains_key(EXTENSION));
        let volume = volume_of_node(self.document, index, has_extension, extras)?;
        let light = extensions.and_then(|e| e.khr_lights_punctual.as_ref());
        if volume.is_none() && light.is_none() {
            // The tips of skeletons hold nothing either.
            self.scene.has_empties |= self.root.skins.is_empty()
                && node.mesh.is_none()
                && node.camera.is_none()
                && node.children.as_ref().is_none_or(Vec::is_empty);
            return Ok(());
        }
        let shown = if name.is_empty() { format!("node {index}") } else { name.clone() };
        if node.mesh.is_some_and(|mesh| self.is_quantised(mesh.value())) {
            self.scene.warnings.push(format!(
                "node `{shown}` holds a volume or a light beside a mesh with quantised positions: \
                 tools that quantise a mesh move and scale its node, and all that is on it; give \
                 the volume or light a node of its own before"
            ));
        }
        let places = match instances(&self.accessors, index, 512 + 2 * name.len() as u64)? {
            None => vec![*to_world],
            Some(places) => places.into_iter().map(|place| *to_world * place).collect(),
        };
        if !places.iter().all(DAffine3::is_finite) {
            return Err(Error::invalid(
                self.document.place(&format!("/nodes/{index}")),
                "the world transform of an instance is not finite",
                "check the scales of the node and its instances",
            ));
        }
        if let Some(light) = light {
            self.light(&shown, light.light.value(), &places)?;
        }
        if let Some((spec, pointer)) = volume {
            let place = self.document.place(&pointer);
            let spec = Arc::new(spec);
            for to_world in places {
                // As meshes: what has no extent is not seen.
                if !to_world.matrix3.determinant().is_normal() {
                    self.flat.push(shown.clone());
                    continue;
                }
                self.scene.volumes.push(GltfVolume {
                    node: name.clone(),
                    spec: spec.clone(),
                    to_world,
                    pointer: pointer.clone(),
                    place: place.clone(),
                });
            }
        }
        Ok(())
    }

    /// Whether a mesh has positions that are integers.
    fn is_quantised(&self, mesh: usize) -> bool {
        let position = json::validation::Checked::Valid(json::mesh::Semantic::Positions);
        let primitives = self.root.meshes.get(mesh).map(|mesh| mesh.primitives.as_slice());
        let mut positions =
            primitives.unwrap_or_default().iter().filter_map(|p| p.attributes.get(&position));
        positions.any(|accessor| self.accessors.is_integer(accessor.value()))
    }

    fn camera(
        &mut self,
        index: usize,
        node: &str,
        camera: usize,
        to_world: &DAffine3,
    ) -> Result<(), Error> {
        let Some(camera) = self.root.cameras.get(camera) else {
            return Err(self.no_such("camera", camera, node));
        };
        let fov_y_degrees = camera.perspective.as_ref().map(|p| f64::from(p.yfov).to_degrees());
        let aspect_ratio = camera
            .perspective
            .as_ref()
            .and_then(|p| p.aspect_ratio)
            .map(f64::from)
            .filter(|a| (1e-3..=1e3).contains(a));
        self.scene.cameras.push(GltfCamera {
            node: node.to_owned(),
            index,
            name: camera.name.clone().unwrap_or_default(),
            to_world: *to_world,
            fov_y_degrees,
            aspect_ratio,
        });
        Ok(())
    }

    /// A light of node `node` at each of its places.
    fn light(&mut self, node: &str, index: usize, places: &[DAffine3]) -> Result<(), Error> {
        use json::extensions::scene::khr_lights_punctual::Type;
        use json::validation::Checked;

        let lights = self.root.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
        let Some(light) = lights.and_then(|l| l.lights.get(index)) else {
            return Err(self.no_such("light", index, node));
        };
        let pointer = format!("/extensions/KHR_lights_punctual/lights/{index}");
        let invalid = |what: &str| {
            Error::invalid(
                self.document.place(&pointer),
                what,
                "correct the light and export again",
            )
        };
        let scale = f64::from(light.intensity) / self.lumens_per_watt;
        let intensity = Vec3::from_array(light.color.map(|c| (f64::from(c) * scale) as f32));
        if !(intensity.is_finite() && intensity.min_element() >= 0.0) {
            return Err(invalid("the light's colour times intensity is negative or not finite"));
        }
        let kind = match light.type_ {
            Checked::Valid(kind) => kind,
            Checked::Invalid => {
                return Err(invalid("the light's type is not directional, point or spot"));
            }
        };
        let (inner, outer) = light
            .spot
            .as_ref()
            .filter(|_| kind == Type::Spot)
            .map_or((0.0, FRAC_PI_4), |s| (s.inner_cone_angle, s.outer_cone_angle));
        // The specification allows outer angles up to a quarter turn; a whole half turn still has
        // a meaning.
        if !(inner >= 0.0 && inner <= outer && outer <= PI) {
            return Err(invalid("the spot's cone angles are not 0 <= inner <= outer"));
        }
        let (cos_inner, cos_outer) = (libm::cosf(inner), libm::cosf(outer));
        for to_world in places {
            let axis = |axis: DVec3| to_world.transform_vector3(axis).try_normalize();
            let along = axis(DVec3::NEG_Z);
            // A point light has no direction; it is gone where nothing is left of its node.
            let directed = along.or((kind == Type::Point)
                .then(|| axis(DVec3::X).or_else(|| axis(DVec3::Y)))
                .flatten());
            let Some(along) = directed else {
                self.flat.push(node.to_owned());
                continue;
            };
            let (position, direction) = (to_world.translation, along.as_vec3().normalize());
            self.scene.lights.push(match kind {
                Type::Directional => Light::Sun(Sun {
                    to_light: -direction,
                    irradiance: intensity,
                    angular_diameter: 0.0,
                }),
                Type::Point => Light::Point(Point { position, intensity }),
                Type::Spot => {
                    Light::Spot(Spot { position, direction, intensity, cos_inner, cos_outer })
                }
            });
        }
        if let Some(range) = light.range {
            self.scene.not_modelled.push(format!(
                "the range of {range} of light `{node}`: light falls off with the square of the \
                 distance and never ends"
            ));
        }
        Ok(())
    }

    fn no_such(&self, what: &str, index: usize, node: &str) -> Error {
        Error::invalid(
            self.document.place("/nodes"),
            format!("node `{node}` names {what} {index}, which does not exist"),
            "export the file again",
        )
    }
}

/// Names in backticks, of which a few are shown.
pub(crate) fn list_names<T: AsRef<str>>(names: &[T]) -> String {
    let mut list: Vec<String> =
        names.iter().take(SHOWN).map(|name| format!("`{}`", name.as_ref())).collect();
    if let Some(more) = names.len().checked_sub(SHOWN).filter(|&more| more > 0) {
        list.push(format!("and {more} more"));
    }
    list.join(", ")
}

fn list_not_modelled(root: &json::Root, scene: &mut GltfScene) {
    let plural = |n: usize, one: &str, many: &str| {
        if n == 1 { format!("1 {one}") } else { format!("{n} {many}") }
    };
    let [lines, without_positions] = mesh::not_surfaces(root);
    if lines > 0 {
        let primitives = plural(lines, "primitive", "primitives");
        scene.not_modelled.push(format!("points and lines: {primitives}"));
    }
    if without_positions > 0 {
        let primitives = plural(without_positions, "primitive", "primitives");
        scene.not_modelled.push(format!("{primitives} without positions"));
    }
    let occluded = root.materials.iter().filter(|m| m.occlusion_texture.is_some()).count();
    if occluded > 0 {
        let materials = plural(occluded, "material", "materials");
        scene.not_modelled.push(format!(
            "occlusion textures of {materials}: what they stand for is computed by tracing light"
        ));
    }
    let bumpy_coats = root.materials.iter().filter(|material| {
        let others = material.extensions.as_ref().map(|extensions| &extensions.others);
        let coat = others.and_then(|others| others.get("KHR_materials_clearcoat"));
        coat.is_some_and(|coat| coat.get("clearcoatNormalTexture").is_some())
    });
    let bumpy_coats = bumpy_coats.count();
    if bumpy_coats > 0 {
        let materials = plural(bumpy_coats, "material", "materials");
        scene.not_modelled.push(format!("normal textures of the clear coats of {materials}"));
    }
    if scene.counts.animations > 0 {
        let animations = plural(scene.counts.animations, "animation", "animations");
        scene.not_modelled.push(format!("{animations}: the rest pose is rendered"));
    }
    let used = root.extensions_used.iter().map(String::as_str);
    let left_out: Vec<&str> = used.filter(|name| !is_modelled(name)).collect();
    if !left_out.is_empty() {
        scene.not_modelled.push(format!("extensions: {}", left_out.join(", ")));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::volume_spec::LawSpec;

    fn read(text: &str) -> Result<GltfScene, Error> {
        parse("folder/a.gltf", text.as_bytes(), 683.0)
    }

    fn with_nodes(nodes: &str, more: &str) -> String {
        format!(
            "{{\"asset\":{{\"version\":\"2.0\"}},\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":{nodes}{more}}}"
        )
    }

    #[test]
    fn extension_extras_object_and_flat_keys_say_the_same() {
        let object = r#"{"vdb":"a b.vdb","density":{"grid":"d","scale":8},"up_axis":"z",
            "albedo":[0.8,0.8,0.85],"phase":{"type":"henyey_greenstein","g":0.3},
            "law":{"type":"table","file":"a b.csv"}}"#;
        let uri = object.replace("a b", "a%20b");
        let flat = r#"{"pileus_vdb":"a b.vdb","pileus_grid":"d","pileus_density_scale":8,
            "pileus_up_axis":"z","pileus_albedo":[0.8,0.8,0.85],"pileus_g":0.3,
            "pileus_law":"table","pileus_law_file":"a b.csv","other":[]}"#;
        let nodes = [
            format!(r#"[{{"extensions":{{"PILEUS_volume":{uri}}}}}]"#),
            format!(r#"[{{"extras":{{"pileus_volume":{object}}}}}]"#),
            format!(r#"[{{"extras":{flat}}}]"#),
        ];
        let specs = nodes.map(|nodes| {
            let scene = read(&with_nodes(&nodes, "")).unwrap();
            assert_eq!(scene.volumes.len(), 1);
            scene.volumes[0].spec.clone()
        });
        assert_eq!(specs[0], specs[1]);
        assert_eq!(specs[0], specs[2]);
        assert_eq!(Path::new(specs[0].vdb.as_ref().unwrap()), Path::new("folder/a b.vdb"));
        let Some(LawSpec::Table { file }) = &specs[0].law else { panic!("{:?}", specs[0].law) };
        assert_eq!(Path::new(file), Path::new("folder/a b.csv"));
    }

    #[test]
    fn wrong_volume_keys_are_placed() {
        let text = with_nodes(
            "[{\n\"extensions\":{\"PILEUS_volume\":{\"vdb\":\"a\",\n \"albdo\":1}}}]",
            "",
        );
        let error = read(&text).unwrap_err();
        assert_eq!((error.place().line, error.place().column), (Some(3), Some(2)));
        assert_eq!(error.place().part.as_deref(), Some("/nodes/0/extensions/PILEUS_volume/albdo"));
        assert!(error.remedy().contains("did you mean `albedo`?"), "{}", error.remedy());

        let error = read(&with_nodes(r#"[{"extras":{"pileus_vdb":"a","pileus_albdo":1}}]"#, ""));
        let error = error.unwrap_err();
        assert!(error.remedy().contains("did you mean `pileus_albedo`?"));
        assert_eq!(error.place().part.as_deref(), Some("/nodes/0/extras/pileus_albdo"));
        for extras in [
            r#"{"pileus_g":1}"#,
            r#"{"pileus_vdb":1}"#,
            r#"{"pileus_vdb":"a","pileus_g":"x"}"#,
            r#"{"pileus_vdb":"a","pileus_albedo":[1,2]}"#,
            r#"{"pileus_vdb":"a","pileus_up_axis":"x"}"#,
            r#"{"pileus_vdb":"a","pileus_law":"power"}"#,
            r#"{"pileus_vdb":"a","pileus_law":"mixture"}"#,
            r#"{"pileus_vdb":"a","pileus_law_k":2}"#,
            r#"{"pileus_vdb":"a","pileus_law":"erlang","pileus_law_n":2.5}"#,
            r#"{"pileus_vdb":"a","pileus_law":"erlang","pileus_law_n":2,"pileus_law_k":2}"#,
        ] {
            let error = read(&with_nodes(&format!(r#"[{{"extras":{extras}}}]"#), ""));
            assert!(matches!(error, Err(Error::Invalid { .. })), "{extras}");
        }
        for extras in ["3", "[1]", "null", "{\"density\":3}"] {
            let scene = read(&with_nodes(&format!(r#"[{{"extras":{extras}}}]"#), "")).unwrap();
            assert!(scene.volumes.is_empty());
        }
    }

    #[test]
    fn lights_get_radiometric_units_and_directions() {
        let lights = |lights: &str| {
            format!(r#","extensions":{{"KHR_lights_punctual":{{"lights":[{lights}]}}}}"#)
        };
        // A quarter turn about X takes -Z to -Y... seen from the light: it shines upwards for +.
        let node = r#"[{"rotation":[0.70710678,0,0,0.70710678],"translation":[1,2,3],
            "extensions":{"KHR_lights_punctual":{"light":0}}}]"#;
        let read_one =
            |text: &str| read(&with_nodes(node, &lights(text))).map(|s| s.lights[0].clone());
        let sun = read_one(r#"{"type":"directional","color":[1,0.5,0],"intensity":1366}"#).unwrap();
        let Light::Sun(sun) = sun else { panic!("{sun:?}") };
        assert!((sun.irradiance - Vec3::new(2.0, 1.0, 0.0)).length() < 1e-6);
        assert!((sun.to_light - Vec3::NEG_Y).length() < 1e-6, "{}", sun.to_light);
        let spot =
            read_one(r#"{"type":"spot","intensity":683,"spot":{"outerConeAngle":0.5}}"#).unwrap();
        let Light::Spot(spot) = spot else { panic!("{spot:?}") };
        assert!((spot.direction - Vec3::Y).length() < 1e-6);
        assert_eq!((spot.cos_inner, spot.cos_outer), (1.0, 0.5f32.cos()));
        assert_eq!(spot.position, DVec3::new(1.0, 2.0, 3.0));
        let point = read_one(r#"{"type":"point","intensity":6830}"#).unwrap();
        let Light::Point(point) = point else { panic!("{point:?}") };
        assert!((point.intensity.x - 10.0).abs() < 1e-6);
        for bad in [
            r#"{"type":"area"}"#,
            r#"{"type":"point","intensity":-1}"#,
            r#"{"type":"point","intensity":1e300}"#,
            r#"{"type":"spot","spot":{"innerConeAngle":1,"outerConeAngle":0.5}}"#,
        ] {
            assert!(matches!(read_one(bad), Err(Error::Invalid { .. })), "{bad}");
        }
    }

    #[test]
    fn damaged_trees_are_errors() {
        let invalid = |text: &str| matches!(read(text), Err(Error::Invalid { .. }));
        assert!(invalid(&with_nodes(r#"[{"children":[0]}]"#, "")));
        assert!(invalid(&with_nodes(r#"[{"children":[1]},{"children":[0]}]"#, "")));
        assert!(invalid(&with_nodes(r#"[{"children":[1,1]},{}]"#, "")));
        assert!(invalid(&with_nodes(r#"[{"children":[7]}]"#, "")));
        assert!(invalid(&with_nodes(r#"[{"camera":3}]"#, "")));
        assert!(invalid(&with_nodes("[{}]", ",\"scene\":4")));
        assert!(invalid(&with_nodes("[]", "")));
        assert!(invalid(&with_nodes(r#"[{"rotation":[0,0,0,0]}]"#, "")));
        assert!(!invalid(&with_nodes(r#"[{"scale":[1e30,1,1]}]"#, "")));
        assert!(invalid(&with_nodes(r#"[{"scale":[1e300,1,1]}]"#, "")));
        assert!(invalid(&with_nodes(
            r#"[{"extensions":{"KHR_lights_punctual":{"light":0}}}]"#,
            ""
        )));
        assert!(invalid("{}"));
        assert!(invalid("glTF"));
        // Ten thousand levels deep: no recursion.
        let chain: Vec<String> =
            (1..10_000).map(|i| format!("{{\"children\":[{i}]}}")).chain(["{}".into()]).collect();
        assert!(read(&with_nodes(&format!("[{}]", chain.join(",")), "")).is_ok());
    }

    #[test]
    fn required_extensions_are_listed_when_unknown() {
        let more = r#","extensionsRequired":["KHR_lights_punctual","VENDOR_a","KHR_materials_ior","VENDOR_b"]"#;
        let error = read(&with_nodes("[{}]", more)).unwrap_err();
        assert!(matches!(error, Error::Unsupported { .. }));
        assert!(error.to_string().contains("VENDOR_a, VENDOR_b"), "{error}");
        let more = r#","extensionsRequired":["PILEUS_volume","KHR_materials_ior"]"#;
        assert!(read(&with_nodes("[{}]", more)).is_ok());
        let old = with_nodes("[{}]", "").replace("2.0", "1.0");
        assert!(matches!(read(&old), Err(Error::Unsupported { .. })));
    }

    #[test]
    fn binary_containers_are_split_and_checked() {
        let text = with_nodes("[{}]", "");
        let mut glb = b"glTF".to_vec();
        for word in [2, 20 + text.len() as u32, text.len() as u32] {
            glb.extend(word.to_le_bytes());
        }
        glb.extend(b"JSON");
        glb.extend(text.as_bytes());
        assert!(parse("a.glb", &glb, 683.0).is_ok());
        for length in 0..glb.len() {
            assert!(parse("a.glb", &glb[..length], 683.0).is_err(), "{length}");
        }
        let mut wrong = glb.clone();
        wrong[4] = 1;
        assert!(matches!(parse("a.glb", &wrong, 683.0), Err(Error::Unsupported { .. })));
        wrong = glb;
        wrong[12..16].fill(0xff);
        assert!(parse("a.glb", &wrong, 683.0).is_err());
    }

    #[test]
    fn transforms_multiply_down_the_tree() {
        let nodes = r#"[{"translation":[1,0,0],"scale":[2,2,2],"children":[1]},
            {"matrix":[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,3,0,1],"camera":0,"name":"C"}]"#;
        let camera = r#","cameras":[{"type":"perspective","perspective":{"yfov":0.5,"znear":0.1,"aspectRatio":1.5}}]"#;
        let scene = read(&with_nodes(nodes, camera)).unwrap();
        let camera = &scene.cameras[0];
        assert_eq!(camera.node, "C");
        assert_eq!(camera.to_world.translation, DVec3::new(1.0, 6.0, 0.0));
        assert!((camera.fov_y_degrees.unwrap() - 0.5f64.to_degrees()).abs() < 1e-5);
        assert_eq!(camera.aspect_ratio, Some(1.5));
    }
}

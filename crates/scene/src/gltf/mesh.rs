//! Meshes of a glTF file and where its nodes place them.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use glam::{DAffine3, DVec3, Vec3};
use gltf::json;
use gltf::json::mesh::{Mode, Semantic};
use gltf::json::validation::Checked;

use super::accessor::{Accessors, Use};
use super::buffer::Buffers;
use super::contents::{GltfMesh, GltfScene};
use super::instances::instances;
use super::material;
use super::pose::{Pose, PoseKey, Poses, pose_key};
use super::texture::Textures;
use crate::error::Error;
use crate::json::Document;
use crate::surface::shells::{Closure, Shells};
use crate::surface::{GlassRule, Material, Mesh, Part, Refusal, Surfaces, Tag};

/// The surfaces of a file, and what was decided about them.
#[derive(Debug, Default)]
pub struct GltfSurfaces {
    /// `None` if there is no triangle.
    pub surfaces: Option<Surfaces>,
    /// What was chosen or left out, as sentences for people.
    pub notes: Vec<String>,
    /// What its materials say and the picture leaves out.
    pub not_modelled: Vec<String>,
    /// What is wrong in the file and was mended or got round, as sentences for people.
    pub warnings: Vec<String>,
}

/// Triangles that a file may have however small it is: primitives may share their vertices.
const FREE_TRIANGLES: u64 = 1 << 22;
/// Most triangles of all.
const MAX_TRIANGLES: u64 = 1 << 27;

/// Reads the meshes of a scene and everything that they need.
pub(crate) fn load(
    document: &Document,
    root: &json::Root,
    bin: Option<&[u8]>,
    scene: &GltfScene,
    rule: GlassRule,
) -> Result<GltfSurfaces, Error> {
    let placed = &scene.meshes;
    if placed.is_empty() {
        return Ok(GltfSurfaces::default());
    }
    let buffers = Buffers::new(document, root, bin);
    let mut not_modelled = Vec::new();
    let used = used_materials(root, placed);
    let mut textures = Textures::new(&buffers);
    let materials = material::load(document, &mut textures, &used, &mut not_modelled)?;
    let mut loader = Loader {
        accessors: Accessors::new(&buffers),
        poses: Poses::new(&scene.transforms),
        buffers: &buffers,
        materials: &materials,
        rule,
        triangles: 0,
        without_area: 0,
        without_data: 0,
        made_solid: Vec::new(),
        node: String::new(),
        doubts: Vec::new(),
    };
    let mut numbers: HashMap<PoseKey, Option<usize>> = HashMap::new();
    let mut meshes = Vec::new();
    let mut instances = Vec::new();
    let mut nodes = Vec::new();
    for node in placed {
        let pose = loader.poses.pose(&loader.accessors, node)?;
        let key = pose_key(node);
        let number = match numbers.get(&key) {
            Some(number) => *number,
            None => {
                loader.node = called(&node.name, node.node);
                let number = loader.mesh(node.mesh, &pose)?.map(|mesh| {
                    meshes.push(mesh);
                    meshes.len() - 1
                });
                numbers.insert(key, number);
                number
            }
        };
        let Some(number) = number else { continue };
        for to_world in loader.transforms(node, &pose)? {
            instances.push((number, node.name.clone(), to_world));
            nodes.push(node.node);
        }
    }
    let (mut notes, warnings) = (loader.notes(), loader.warnings());
    let built = Surfaces::new(materials, meshes, instances).map_err(|refusal| match refusal {
        Refusal::TooFar(instance) => {
            let node = nodes.get(instance).copied().unwrap_or_default();
            Error::invalid(
                document.place(&format!("/nodes/{node}")),
                "the node's mesh has coordinates that are too large to compute with",
                "check the scales of the node and its parents",
            )
        }
        Refusal::TooManyEmitters => Error::unsupported(
            document.place("/meshes"),
            "there are more emissive triangles than can be chosen from",
            "use fewer instances of emissive meshes",
        ),
    });
    let (surfaces, flat) = built?;
    if flat > 0 {
        notes.push(format!("{flat} meshes are scaled to nothing by their nodes and not shown"));
    }
    Ok(GltfSurfaces { surfaces, notes, not_modelled, warnings })
}

/// Numbers of the materials of all surfaces that are placed: others stop no picture.
fn used_materials(root: &json::Root, placed: &[GltfMesh]) -> BTreeSet<usize> {
    let meshes: BTreeSet<usize> = placed.iter().map(|node| node.mesh).collect();
    let meshes = meshes.into_iter().filter_map(|mesh| root.meshes.get(mesh));
    meshes
        .flat_map(|mesh| &mesh.primitives)
        .filter(|primitive| matches!(primitive.mode, Checked::Valid(mode) if is_surface(mode)))
        .filter_map(|primitive| primitive.material)
        .map(|material| material.value())
        .collect()
}

struct Loader<'a> {
    accessors: Accessors<'a>,
    poses: Poses<'a>,
    buffers: &'a Buffers<'a>,
    materials: &'a [Material],
    rule: GlassRule,
    triangles: u64,
    without_area: u64,
    /// Primitives whose buffers name no file.
    without_data: u64,
    /// Materials that bound bodies by [`GlassRule::ClosedMeshesAreSolid`], with their mesh.
    made_solid: Vec<(String, String)>,
    /// The first node of the mesh that is being read, as it is called.
    node: String,
    /// Surfaces that do not bound bodies as they should.
    doubts: Vec<Doubt>,
}

/// A surface that does not bound a body as it should.
struct Doubt {
    mesh: String,
    node: String,
    material: String,
    what: Wrong,
    /// Of so many triangles.
    triangles: u32,
}

/// What is wrong with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Wrong {
    Open,
    Flat,
    Holed,
    InsideOut,
    /// Some of its triangles face the other way than the rest: this many of one shell.
    Mixed(u32),
}

/// Why a surface may bound a body.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Claim {
    /// The material has `KHR_materials_volume`.
    Volume,
    /// The material transmits, by [`GlassRule::ClosedMeshesAreSolid`].
    Glass,
}

/// Most surfaces that are named one by one in warnings.
const MAX_NAMED: usize = 16;

impl Loader<'_> {
    /// A mesh of all primitives of triangles; `None` if there is no triangle.
    fn mesh(&mut self, index: usize, pose: &Pose) -> Result<Option<Mesh>, Error> {
        let document = self.buffers.document;
        let Some(mesh) = self.buffers.root.meshes.get(index) else {
            return Err(Error::invalid(
                document.place("/nodes"),
                format!("a node names mesh {index}, which does not exist"),
                "export the file again",
            ));
        };
        let name = mesh.name.clone().unwrap_or_default();
        let mut parts = Vec::new();
        let mut triangles: Vec<([Vec3; 3], Tag)> = Vec::new();
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let pointer = format!("/meshes/{index}/primitives/{number}");
            let part = parts.len();
            if let Some(part) = self.primitive(primitive, pose, &pointer, part, &mut triangles)? {
                parts.push(part);
            }
        }
        let closed = self.make_solid((&name, index), &mut parts, &mut triangles);
        let all = triangles.len();
        triangles.retain(|([a, b, c], _)| {
            let [a, b, c] = [a, b, c].map(|p| p.as_dvec3());
            (b - a).cross(c - a) != DVec3::ZERO
        });
        self.without_area += (all - triangles.len()) as u64;
        let mesh = Mesh::new(parts, triangles, self.materials);
        if let (Some(mesh), Some(closed)) = (&mesh, closed) {
            mesh.set_closed(closed);
        }
        Ok(mesh)
    }

    /// Decides which surfaces bound bodies, per connected part of the mesh, and turns those round
    /// that are inside out; says whether the mesh is closed if it had to be known. Parts of which
    /// some triangles bound bodies and others do not become several.
    fn make_solid(
        &mut self,
        (name, index): (&str, usize),
        parts: &mut Vec<Part>,
        triangles: &mut [([Vec3; 3], Tag)],
    ) -> Option<bool> {
        let claims: Vec<Option<Claim>> = parts
            .iter_mut()
            .map(|part| {
                let material = self.materials.get(part.material as usize)?;
                part.solid = material.volume == Some(true);
                let glass =
                    material.transmission > 0.0 && self.rule == GlassRule::ClosedMeshesAreSolid;
                match material.volume {
                    Some(true) => material.transmits().then_some(Claim::Volume),
                    Some(false) => None,
                    None => glass.then_some(Claim::Glass),
                }
            })
            .collect();
        if claims.iter().all(Option::is_none) {
            return None;
        }
        let corners: Vec<[Vec3; 3]> = triangles.iter().map(|(corners, _)| *corners).collect();
        let shells = Shells::new(&corners);
        // What became of each part so far: first itself, then copies.
        let mut variants: HashMap<(u32, bool, bool), u32> = HashMap::new();
        let originals = parts.clone();
        let mut taken = vec![false; parts.len()];
        let mut doubts: BTreeMap<(u32, u32), (Wrong, u32)> = BTreeMap::new();
        let mut solid_materials: Vec<u32> = Vec::new();
        for (i, (corners, tag)) in triangles.iter_mut().enumerate() {
            let part = tag.part;
            let Some(claim) = claims.get(part as usize).copied().flatten() else { continue };
            // Triangles of fewer than three places are left out later.
            let (Some(shell), Some(own)) = (shells.shell(i), originals.get(part as usize)) else {
                continue;
            };
            let material = own.material;
            let solid = match shell.closure {
                Closure::Closed => true,
                Closure::Holed => claim == Claim::Volume,
                Closure::Flat | Closure::Open => false,
            };
            let turned = solid && shells.is_turned(i);
            let wrong = match shell.closure {
                Closure::Open => (claim == Claim::Volume).then_some(Wrong::Open),
                Closure::Flat => (claim == Claim::Volume).then_some(Wrong::Flat),
                Closure::Holed => solid.then_some(Wrong::Holed),
                Closure::Closed if shell.turned == 0 => None,
                Closure::Closed if shell.turned == shell.triangles => Some(Wrong::InsideOut),
                Closure::Closed => Some(Wrong::Mixed(shell.turned)),
            };
            if let Some(wrong) = wrong {
                let key = (material, shells.number(i));
                doubts.entry(key).or_insert((wrong, shell.triangles));
            }
            if solid && claim == Claim::Glass && !solid_materials.contains(&material) {
                solid_materials.push(material);
            }
            tag.part = match variants.get(&(part, solid, turned)) {
                Some(number) => *number,
                None => {
                    let made = if turned { own.turned() } else { own.clone() };
                    let made = Part { solid, ..made };
                    let first = !std::mem::replace(&mut taken[part as usize], true);
                    let number = if first { part } else { parts.len() as u32 };
                    match parts.get_mut(number as usize) {
                        Some(slot) => *slot = made,
                        None => parts.push(made),
                    }
                    variants.insert((part, solid, turned), number);
                    number
                }
            };
            if turned {
                corners.swap(1, 2);
                tag.vertices.swap(1, 2);
            }
        }
        let named = |material: u32| {
            self.materials.get(material as usize).map_or(String::new(), |m| m.name.clone())
        };
        self.made_solid.extend(solid_materials.into_iter().map(|m| (named(m), name.to_owned())));
        let mesh = called(name, index);
        // One warning for all shells of a material with the same fault.
        let mut by_fault: BTreeMap<(u32, Wrong), u32> = BTreeMap::new();
        for ((material, _), (wrong, count)) in doubts {
            let (wrong, more) = match wrong {
                Wrong::Mixed(turned) => (Wrong::Mixed(0), turned),
                other => (other, count),
            };
            let sum = by_fault.entry((material, wrong)).or_default();
            *sum = sum.saturating_add(more);
        }
        for ((material, what), triangles) in by_fault {
            let (mesh, node) = (mesh.clone(), self.node.clone());
            let material = called(&named(material), material as usize);
            self.doubts.push(Doubt { mesh, node, material, what, triangles });
        }
        Some(shells.are_closed())
    }

    /// Reads a primitive and appends its triangles; `None` for points, lines and primitives
    /// without positions, which have no surface.
    fn primitive(
        &mut self,
        primitive: &json::mesh::Primitive,
        pose: &Pose,
        pointer: &str,
        part: usize,
        triangles: &mut Vec<([Vec3; 3], Tag)>,
    ) -> Result<Option<Part>, Error> {
        let document = self.buffers.document;
        let invalid =
            |what: String| Error::invalid(document.place(pointer), what, "export the file again");
        let others = primitive.extensions.as_ref().map(|extensions| &extensions.others);
        if others.is_some_and(|others| others.contains_key("KHR_draco_mesh_compression")) {
            return Err(Error::unsupported(
                document.place(pointer),
                "the primitive is compressed (KHR_draco_mesh_compression)",
                "export without compression",
            ));
        }
        let indices = primitive.indices.iter();
        let mut used = primitive.attributes.values().chain(indices).map(|index| index.value());
        if used.any(|accessor| self.buffers.lacks_data(accessor)) {
            self.without_data += 1;
            return Ok(None);
        }
        let mode = match primitive.mode {
            Checked::Valid(mode) if is_surface(mode) => mode,
            Checked::Valid(_) => return Ok(None),
            Checked::Invalid => return Err(invalid("the primitive's mode is unknown".into())),
        };
        let attribute = |semantic: Semantic| {
            primitive.attributes.get(&Checked::Valid(semantic)).map(|index| index.value())
        };
        let Some(position) = attribute(Semantic::Positions) else { return Ok(None) };
        let mut positions = self.accessors.vec3(position, Use::Position)?;
        let material = match primitive.material {
            // The default material stands at the end.
            None => self.materials.len().saturating_sub(1),
            Some(index) if index.value() + 1 < self.materials.len() => index.value(),
            Some(index) => {
                let what =
                    format!("the primitive names material {}, which does not exist", index.value());
                return Err(invalid(what));
            }
        };
        let same_length = |name: &str, length: usize| {
            if length == positions.len() {
                return Ok(());
            }
            let n = positions.len();
            Err(invalid(format!("the primitive has {n} positions, but {length} values of {name}")))
        };
        let mut found = Part { material: material as u32, ..Part::default() };
        if let Some(index) = attribute(Semantic::Normals) {
            let values = self.accessors.vec3(index, Use::Normal)?;
            same_length("NORMAL", values.len())?;
            found.normals = Some(values);
        }
        let used = self.materials.get(material);
        if let Some(index) = attribute(Semantic::Tangents)
            && used.is_some_and(|material| material.normal_texture.is_some())
        {
            let values = self.accessors.vec4(index, Use::Tangent)?;
            same_length("TANGENT", values.len())?;
            found.tangents = Some(values);
        }
        for set in 0..2u32 {
            if let Some(index) = attribute(Semantic::TexCoords(set))
                && used.is_some_and(|material| material.uses_set(set as usize))
            {
                let values = self.accessors.vec2(index, Use::Uv)?;
                same_length(&format!("TEXCOORD_{set}"), values.len())?;
                if let Some(slot) = found.uv.get_mut(set as usize) {
                    *slot = Some(values);
                }
            }
        }
        if let Some(index) = attribute(Semantic::Colors(0)) {
            let values = self.accessors.vec4(index, Use::Color)?;
            same_length("COLOR_0", values.len())?;
            found.colors = Some(values);
        }
        let indices = match primitive.indices {
            Some(index) => Some(self.accessors.indices(index.value(), positions.len())?),
            None => None,
        };
        let (poses, accessors) = (&mut self.poses, &self.accessors);
        poses.apply(pose, accessors, primitive, pointer, &mut positions, &mut found)?;
        let count = indices.as_ref().map_or(positions.len(), Vec::len);
        self.count_triangles(count as u64, mode, pointer)?;
        let remainder = if mode == Mode::Triangles { count % 3 } else { 0 };
        if remainder != 0 {
            return Err(invalid(format!("{count} vertices do not make whole triangles")));
        }
        let vertex = |i: usize| match &indices {
            Some(indices) => indices.get(i).copied(),
            None => u32::try_from(i).ok(),
        };
        let corner = |vertex: u32| positions.get(vertex as usize).copied();
        for i in 0..triangles_of(count as u64, mode) as usize {
            // glTF 2.0, section 3.7.2.1: every second triangle of a strip is turned around.
            let places = match mode {
                Mode::TriangleStrip => [i, i + 1 + i % 2, i + 2 - i % 2],
                Mode::TriangleFan => [i + 1, i + 2, 0],
                _ => [3 * i, 3 * i + 1, 3 * i + 2],
            };
            let [Some(a), Some(b), Some(c)] = places.map(vertex) else { continue };
            let [Some(p0), Some(p1), Some(p2)] = [a, b, c].map(corner) else { continue };
            triangles.push(([p0, p1, p2], Tag { part: part as u32, vertices: [a, b, c] }));
        }
        Ok(Some(found))
    }

    /// Accounts for the triangles that `count` vertices make.
    fn count_triangles(&mut self, count: u64, mode: Mode, pointer: &str) -> Result<(), Error> {
        self.triangles = self.triangles.saturating_add(triangles_of(count, mode));
        let most = FREE_TRIANGLES.saturating_add(self.buffers.total()).min(MAX_TRIANGLES);
        if self.triangles <= most {
            return Ok(());
        }
        Err(Error::unsupported(
            self.buffers.document.place(pointer),
            format!("the meshes have more than {most} triangles"),
            "use instances of fewer meshes, or simplify them",
        ))
    }

    /// World transforms of a node's mesh: one, or one for each instance.
    fn transforms(&self, node: &GltfMesh, pose: &Pose) -> Result<Vec<DAffine3>, Error> {
        /// What an instance takes at least.
        const BYTES: u64 = 64;
        let Some(instances) = instances(&self.accessors, node.node, BYTES)? else {
            return Ok(vec![pose.to_world(&node.to_world)]);
        };
        let (outer, inner) = pose.around_instances(&node.to_world);
        Ok(instances.into_iter().map(|instance| outer * instance * inner).collect())
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings: Vec<String> = self
            .doubts
            .iter()
            .take(MAX_NAMED)
            .map(|Doubt { mesh, node, material, what, triangles }| {
                let body = format!(
                    "mesh {mesh} of node {node}: {triangles} triangles of material {material}"
                );
                let thin = "so they are taken for a thin wall with nothing inside";
                match what {
                    Wrong::Open => format!(
                        "{body} do not close, although KHR_materials_volume wants a body: what would be inside has no end, {thin}; close the mesh, or set thicknessFactor to 0"
                    ),
                    Wrong::Flat => format!(
                        "{body} close without any room inside, although KHR_materials_volume wants a body: {thin}; give the mesh a thickness"
                    ),
                    Wrong::Holed => format!(
                        "{body} have small holes: they are taken for a body all the same, and light that passes a hole is wrong; close the mesh"
                    ),
                    Wrong::InsideOut => format!(
                        "{body} are inside out (their fronts face inwards): they were turned round; flip the normals of the mesh"
                    ),
                    Wrong::Mixed(_) => format!(
                        "{body} face the other way than their neighbours: they were turned round; make the normals of the mesh consistent"
                    ),
                }
            })
            .collect();
        if self.doubts.len() > MAX_NAMED {
            let more = self.doubts.len() - MAX_NAMED;
            warnings.push(format!("{more} more surfaces do not bound bodies as they should"));
        }
        warnings
    }

    fn notes(&mut self) -> Vec<String> {
        let mut notes = Vec::new();
        self.made_solid.sort();
        self.made_solid.dedup_by(|a, b| a.0 == b.0);
        for (material, mesh) in &self.made_solid {
            notes.push(format!(
                "material `{material}` fills closed meshes (`{mesh}`): it bends light, although \
                 without KHR_materials_volume glTF takes it for a thin wall"
            ));
        }
        if self.without_data > 0 {
            tracing::warn!(
                "{}: {} primitives of meshes are left out: their buffers have neither a `uri` nor a \
                 binary chunk",
                self.buffers.document.path().display(),
                self.without_data
            );
        }
        if self.without_area > 0 {
            notes.push(format!("{} triangles have no area and are left out", self.without_area));
        }
        notes
    }
}

/// A thing's name in quotes, or its number in the file if it has none.
fn called(name: &str, number: usize) -> String {
    if name.is_empty() { number.to_string() } else { format!("`{name}`") }
}

fn is_surface(mode: Mode) -> bool {
    matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)
}

/// Triangles that `count` vertices make.
fn triangles_of(count: u64, mode: Mode) -> u64 {
    match mode {
        Mode::Triangles => count / 3,
        _ => count.saturating_sub(2),
    }
}

/// Numbers of primitives in the meshes of nodes that have no surface: points and lines, and those
/// without positions.
pub(crate) fn not_surfaces(root: &json::Root) -> [usize; 2] {
    let mut counts = [0; 2];
    for primitive in root.meshes.iter().flat_map(|mesh| &mesh.primitives) {
        match primitive.mode {
            Checked::Valid(mode) if !is_surface(mode) => counts[0] += 1,
            _ if !primitive.attributes.contains_key(&Checked::Valid(Semantic::Positions)) => {
                counts[1] += 1;
            }
            _ => {}
        }
    }
    counts
}

//! The walk through a glTF file's nodes, which collects what the scene shows.

use std::collections::BTreeSet;
use std::f32::consts::{FRAC_PI_4, PI};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use gltf::json;
use serde_json::{Map, Value};

use super::accessor::Accessors;
use super::buffer::Buffers;
use super::contents::{GltfCamera, GltfCounts, GltfMesh, GltfScene, GltfVolume};
use super::extensions::{VISIBILITY, is_modelled};
use super::instances::instances;
use super::mesh;
use super::names::{SHOWN, list_names};
use super::pose::default_weights;
use super::volume::{EXTENSION, KEPT, volume_of_node};
use crate::error::{Error, Place};
use crate::json::Document;
use crate::light::punctual::{Light, Point, Spot, Sun};

/// What the default scene of a file contributes.
pub(super) fn walk(
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
        // The type decides, should a file have both.
        let flat =
            camera.type_ == json::validation::Checked::Valid(json::camera::Type::Orthographic);
        let perspective = camera.perspective.as_ref().filter(|_| !flat);
        let orthographic = camera.orthographic.as_ref().filter(|_| flat);
        let fov_y_degrees = perspective.map(|p| f64::from(p.yfov).to_degrees());
        let magnification = orthographic.map(|o| [o.xmag, o.ymag].map(f64::from));
        let aspect_ratio = perspective
            .and_then(|p| p.aspect_ratio)
            .map(f64::from)
            .or_else(|| magnification.map(|[x, y]| x / y))
            .filter(|a| (1e-3..=1e3).contains(a));
        self.scene.cameras.push(GltfCamera {
            node: node.to_owned(),
            index,
            name: camera.name.clone().unwrap_or_default(),
            to_world: *to_world,
            fov_y_degrees,
            magnification,
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

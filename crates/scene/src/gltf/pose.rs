//! Meshes at rest: morph targets by their default weights, skins by their joints as the nodes
//! stand (glTF 2.0, sections 3.7.2.2 and 3.7.3.3).

use std::collections::HashMap;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3, Vec3, Vec4};
use gltf::json;
use gltf::json::mesh::Semantic;
use gltf::json::validation::Checked;

use super::accessor::{Accessors, Use};
use super::contents::GltfMesh;
use crate::error::Error;
use crate::surface::Part;

/// The shape in which a node shows its mesh.
pub(crate) struct Pose {
    weights: Vec<f32>,
    joints: Option<Arc<Joints>>,
}

/// What tells poses of meshes apart: mesh, skin, and the bits of the weights.
pub(crate) type PoseKey = (usize, Option<usize>, Vec<u32>);

/// The joints of a skin at rest.
struct Joints {
    /// Of each joint, from the mesh's space to that of `frame`.
    matrices: Vec<DAffine3>,
    /// From the space in which the posed mesh is kept to the world: near the mesh, so that its
    /// coordinates keep their precision, and mirrored where the joints mirror, so that triangles
    /// keep their fronts.
    frame: DAffine3,
}

/// Poses of a file's meshes.
pub(crate) struct Poses<'a> {
    /// World transforms of the nodes; `None` for those that are their own ancestors.
    transforms: &'a [Option<DAffine3>],
    skins: HashMap<usize, Arc<Joints>>,
    /// Vertices that were posed so far.
    vertices: u64,
}

/// Vertices that may be posed however small the file is: many nodes may pose one mesh.
const FREE_VERTICES: u64 = 1 << 22;
/// Most sets of joints of a primitive: 64 joints for a vertex.
const MAX_SETS: u32 = 16;

impl<'a> Poses<'a> {
    pub(crate) fn new(transforms: &'a [Option<DAffine3>]) -> Self {
        Self { transforms, skins: HashMap::new(), vertices: 0 }
    }

    /// The pose in which `node` shows its mesh.
    pub(crate) fn pose(
        &mut self,
        accessors: &Accessors<'_>,
        node: &GltfMesh,
    ) -> Result<Pose, Error> {
        let joints = match node.skin {
            None => None,
            Some(skin) => Some(match self.skins.get(&skin) {
                Some(joints) => joints.clone(),
                None => {
                    let joints = Arc::new(self.joints(accessors, skin, node.node)?);
                    self.skins.insert(skin, joints.clone());
                    joints
                }
            }),
        };
        Ok(Pose { weights: node.weights.clone(), joints })
    }

    fn joints(
        &self,
        accessors: &Accessors<'_>,
        index: usize,
        node: usize,
    ) -> Result<Joints, Error> {
        let (document, root) = (accessors.buffers.document, accessors.buffers.root);
        let invalid = |pointer: &str, what: String| {
            Error::invalid(document.place(pointer), what, "export the file again")
        };
        let Some(skin) = root.skins.get(index) else {
            let what = format!("the node names skin {index}, which does not exist");
            return Err(invalid(&format!("/nodes/{node}"), what));
        };
        let pointer = format!("/skins/{index}");
        let inverse = match skin.inverse_bind_matrices {
            None => None,
            Some(matrices) => Some(accessors.mat4(matrices.value(), Use::Matrix)?),
        };
        let mut matrices = Vec::new();
        for (number, joint) in skin.joints.iter().enumerate() {
            let Some(Some(to_world)) = self.transforms.get(joint.value()) else {
                let what = format!("joint {} of the skin is no node with a place", joint.value());
                return Err(invalid(&pointer, what));
            };
            let from_mesh = match &inverse {
                None => DAffine3::IDENTITY,
                Some(inverse) => match inverse.get(number) {
                    Some(matrix) => DAffine3::from_mat4(matrix.as_dmat4()),
                    None => {
                        let what = "the skin has fewer inverse bind matrices than joints";
                        return Err(invalid(&pointer, what.into()));
                    }
                },
            };
            matrices.push(*to_world * from_mesh);
        }
        let Some(first) = matrices.first().copied() else {
            return Err(invalid(&pointer, "the skin has no joints".into()));
        };
        if !matrices.iter().all(DAffine3::is_finite) {
            return Err(invalid(&pointer, "a matrix of the skin is not finite".into()));
        }
        let mirror = if first.matrix3.determinant() < 0.0 { -1.0 } else { 1.0 };
        let mirror = DMat3::from_diagonal(DVec3::new(mirror, 1.0, 1.0));
        let frame = DAffine3 { matrix3: mirror, translation: first.translation };
        // The mirror is its own inverse.
        let inverse = DAffine3 { matrix3: mirror, translation: -(mirror * first.translation) };
        matrices.iter_mut().for_each(|matrix| *matrix = inverse * *matrix);
        Ok(Joints { matrices, frame })
    }

    /// Poses a primitive that stands at `pointer`.
    pub(crate) fn apply(
        &mut self,
        pose: &Pose,
        accessors: &Accessors<'_>,
        primitive: &json::mesh::Primitive,
        pointer: &str,
        positions: &mut Arc<[Vec3]>,
        part: &mut Part,
    ) -> Result<(), Error> {
        if pose.weights.is_empty() && pose.joints.is_none() {
            return Ok(());
        }
        let document = accessors.buffers.document;
        self.vertices = self.vertices.saturating_add(positions.len() as u64);
        let most = FREE_VERTICES.saturating_add(accessors.buffers.total());
        if self.vertices > most {
            return Err(Error::unsupported(
                document.place(pointer),
                format!("more than {most} vertices are moved by skins and morph targets"),
                "use fewer nodes with skins or weights of their own",
            ));
        }
        let targets = primitive.targets.as_deref().unwrap_or_default();
        for (target, &weight) in targets.iter().zip(&pose.weights) {
            if weight == 0.0 {
                continue;
            }
            let shifts = |index: Option<json::Index<json::Accessor>>,
                          wanted: Use,
                          length: usize| {
                let Some(index) = index else { return Ok(None) };
                let shifts = accessors.vec3(index.value(), wanted)?;
                if shifts.len() != length {
                    let found = shifts.len();
                    let what = format!("{length} vertices, but {found} shifts by a morph target");
                    return Err(Error::invalid(
                        document.place(pointer),
                        what,
                        "export the file again",
                    ));
                }
                Ok(Some(shifts))
            };
            let add = |shift: &Vec3| *shift * weight;
            if let Some(shifts) = shifts(target.positions, Use::PositionShift, positions.len())? {
                *positions = positions.iter().zip(&*shifts).map(|(p, s)| p + add(s)).collect();
            }
            if let Some(normals) = &mut part.normals
                && let Some(shifts) = shifts(target.normals, Use::DirectionShift, normals.len())?
            {
                *normals = normals.iter().zip(&*shifts).map(|(n, s)| n + add(s)).collect();
            }
            if let Some(tangents) = &mut part.tangents
                && let Some(shifts) = shifts(target.tangents, Use::DirectionShift, tangents.len())?
            {
                let tangent = |t: &Vec4, s| (t.truncate() + add(s)).extend(t.w);
                *tangents = tangents.iter().zip(&*shifts).map(|(t, s)| tangent(t, s)).collect();
            }
        }
        if let Some(joints) = &pose.joints {
            let blended = blended(joints, accessors, primitive, pointer, positions.len())?;
            let move_all = |moved: &mut dyn FnMut(usize, &DAffine3)| {
                blended.iter().enumerate().for_each(|(i, matrix)| moved(i, matrix));
            };
            let mut new: Vec<Vec3> = positions.to_vec();
            move_all(&mut |i, matrix| {
                if let Some(p) = new.get_mut(i) {
                    *p = matrix.transform_point3(p.as_dvec3()).as_vec3();
                }
            });
            *positions = new.into();
            if let Some(normals) = &mut part.normals {
                let mut new: Vec<Vec3> = normals.to_vec();
                move_all(&mut |i, matrix| {
                    if let Some(n) = new.get_mut(i) {
                        *n = turned_normal(&matrix.matrix3, *n);
                    }
                });
                *normals = new.into();
            }
            if let Some(tangents) = &mut part.tangents {
                let mut new: Vec<Vec4> = tangents.to_vec();
                move_all(&mut |i, matrix| {
                    if let Some(t) = new.get_mut(i) {
                        let along = matrix.matrix3 * t.truncate().as_dvec3();
                        *t = along.normalize_or_zero().as_vec3().extend(t.w);
                    }
                });
                *tangents = new.into();
            }
        }
        let normals = part.normals.iter().flat_map(|normals| normals.iter());
        let mut tangents = part.tangents.iter().flat_map(|tangents| tangents.iter());
        if positions.iter().chain(normals).all(|vector| vector.is_finite())
            && tangents.all(|tangent| tangent.is_finite())
        {
            return Ok(());
        }
        Err(Error::invalid(
            document.place(pointer),
            "a vertex is moved to coordinates, or turned to directions, that are not finite",
            "check the weights of morph targets and the joints of the skin",
        ))
    }
}

impl Pose {
    /// From the space of the posed mesh to the world, given the node's transform: a skin's
    /// joints place a mesh, whatever its node does.
    pub(crate) fn to_world(&self, node: &DAffine3) -> DAffine3 {
        self.joints.as_ref().map_or(*node, |joints| joints.frame)
    }

    /// From the space of instances to the world, and from the posed mesh to that of an instance.
    pub(crate) fn around_instances(&self, node: &DAffine3) -> (DAffine3, DAffine3) {
        match &self.joints {
            None => (*node, DAffine3::IDENTITY),
            Some(joints) => (DAffine3::IDENTITY, joints.frame),
        }
    }
}

/// The pose's key of a node.
pub(crate) fn pose_key(node: &GltfMesh) -> PoseKey {
    (node.mesh, node.skin, node.weights.iter().map(|weight| weight.to_bits()).collect())
}

/// The weights of morph targets with which a node shows its mesh: its own, or those of the mesh.
/// Empty if all are zero or the mesh has no targets.
pub(crate) fn default_weights(node: &json::scene::Node, mesh: &json::Mesh) -> Vec<f32> {
    let targets = mesh.primitives.iter().filter_map(|p| p.targets.as_ref()).map(Vec::len);
    let targets = targets.max().unwrap_or(0);
    let weights = node.weights.as_ref().or(mesh.weights.as_ref()).map_or(&[][..], Vec::as_slice);
    let weights = weights.get(..targets.min(weights.len())).unwrap_or_default();
    match weights.iter().rposition(|&weight| weight != 0.0) {
        Some(last) => weights.get(..=last).unwrap_or_default().to_vec(),
        None => Vec::new(),
    }
}

/// Of each vertex the mean of its joints' matrices, by its weights.
fn blended(
    joints: &Joints,
    accessors: &Accessors<'_>,
    primitive: &json::mesh::Primitive,
    pointer: &str,
    count: usize,
) -> Result<Vec<DAffine3>, Error> {
    const NONE: DAffine3 = DAffine3 { matrix3: DMat3::ZERO, translation: DVec3::ZERO };
    let document = accessors.buffers.document;
    let invalid =
        |what: String| Error::invalid(document.place(pointer), what, "export the file again");
    let attribute = |semantic: Semantic| {
        primitive.attributes.get(&Checked::Valid(semantic)).map(|index| index.value())
    };
    let mut sums = vec![(NONE, 0.0f64); count];
    for set in 0..MAX_SETS {
        let (Some(numbers), Some(weights)) =
            (attribute(Semantic::Joints(set)), attribute(Semantic::Weights(set)))
        else {
            break;
        };
        let numbers = accessors.vec4(numbers, Use::Joints)?;
        let weights = accessors.vec4(weights, Use::Weights)?;
        if numbers.len() != count || weights.len() != count {
            return Err(invalid(format!(
                "the primitive has {count} positions, but {} values of JOINTS_{set} and {} of \
                 WEIGHTS_{set}",
                numbers.len(),
                weights.len()
            )));
        }
        for ((sum, numbers), weights) in sums.iter_mut().zip(&*numbers).zip(&*weights) {
            for (number, weight) in numbers.to_array().into_iter().zip(weights.to_array()) {
                if !(weight > 0.0) {
                    continue;
                }
                let Some(matrix) = joints.matrices.get(number as usize) else {
                    let joints = joints.matrices.len();
                    return Err(invalid(format!(
                        "a vertex names a joint beyond the skin's {joints}"
                    )));
                };
                let weight = f64::from(weight);
                sum.0.matrix3 += matrix.matrix3 * weight;
                sum.0.translation += matrix.translation * weight;
                sum.1 += weight;
            }
        }
    }
    // What no joint holds goes with the first one, as in other programs.
    let first = joints.matrices.first().copied().unwrap_or(DAffine3::IDENTITY);
    let mean = |(sum, weight): (DAffine3, f64)| match weight > 0.0 {
        true => DAffine3 { matrix3: sum.matrix3 / weight, translation: sum.translation / weight },
        false => first,
    };
    Ok(sums.into_iter().map(mean).collect())
}

/// A normal turned by the inverse transpose of a matrix, or rather by its cofactors, which a matrix
/// that flattens has too.
fn turned_normal(matrix: &DMat3, normal: Vec3) -> Vec3 {
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    let turned = cofactors * normal.as_dvec3() * matrix.determinant().signum();
    turned.normalize_or_zero().as_vec3()
}

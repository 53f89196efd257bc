//! Meshes: triangles in the space of their node, with what their vertices carry.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use glam::{DVec3, Vec2, Vec3, Vec4};
use pileus_math::Bounds3;

use super::material::{Alpha, Material, Point};
use super::shells::{Closure, Shells};
use super::texture::Texture;
use super::tree::Tree;

/// What the vertices of a glTF primitive carry, and what its surface is made of.
#[derive(Debug, Clone, Default)]
pub(crate) struct Part {
    pub(crate) material: u32,
    /// Whether the surface bounds a body, so that light is bent at it.
    pub(crate) solid: bool,
    pub(crate) normals: Option<Arc<[Vec3]>>,
    /// Tangents; `w` is the sign of the bitangent.
    pub(crate) tangents: Option<Arc<[Vec4]>>,
    pub(crate) uv: [Option<Arc<[Vec2]>>; 2],
    pub(crate) colors: Option<Arc<[Vec4]>>,
}

impl Part {
    /// This part for triangles that are turned round: normals to the other side, and bitangents
    /// where they were.
    pub(crate) fn turned(&self) -> Self {
        let normals = self.normals.as_deref().map(|all| all.iter().map(|n| -*n).collect());
        let turn = |t: &Vec4| t.truncate().extend(-t.w);
        let tangents = self.tangents.as_deref().map(|all| all.iter().map(turn).collect());
        Self { normals, tangents, ..self.clone() }
    }
}

/// Where a triangle comes from: its part and its vertices' numbers there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tag {
    pub(crate) part: u32,
    pub(crate) vertices: [u32; 3],
}

/// A mesh; its triangles stand in the order of its tree's leaves.
#[derive(Debug)]
pub(crate) struct Mesh {
    pub(crate) parts: Vec<Part>,
    corners: Vec<[Vec3; 3]>,
    tags: Vec<Tag>,
    /// Of each part whether the camera passes its back and whether it may have holes; empty if no
    /// part does.
    filters: Vec<Filter>,
    /// Whether any part may have holes.
    has_holes: bool,
    pub(crate) tree: Tree,
    pub(crate) bounds: Bounds3,
    /// Of each part the size of its bounds.
    sizes: Vec<DVec3>,
    closed: OnceLock<bool>,
    /// Of each triangle whether it belongs to a closed shell.
    bodies: OnceLock<Box<[bool]>>,
}

#[derive(Debug, Clone, Copy)]
struct Filter {
    culls_back: bool,
    has_holes: bool,
}

/// What has to be asked before a triangle counts as hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Presence {
    Present,
    Absent,
    /// Ask the material's coverage.
    Partial,
}

impl Mesh {
    /// Builds a mesh of triangles with finite vertices and an area; `None` without triangles.
    pub(crate) fn new(
        parts: Vec<Part>,
        triangles: Vec<([Vec3; 3], Tag)>,
        materials: &[Material],
    ) -> Option<Self> {
        if triangles.is_empty() {
            return None;
        }
        let boxes: Vec<Bounds3> = triangles
            .iter()
            .map(|(corners, _)| Bounds3::of_points(corners.map(Vec3::as_dvec3)))
            .collect();
        let bounds = boxes.iter().copied().reduce(Bounds3::union)?;
        let mut of_parts: Vec<Option<Bounds3>> = vec![None; parts.len()];
        for ((_, tag), bounds) in triangles.iter().zip(&boxes) {
            if let Some(part) = of_parts.get_mut(tag.part as usize) {
                *part = Some(part.map_or(*bounds, |part| part.union(*bounds)));
            }
        }
        let size = |part: Option<Bounds3>| part.map_or(DVec3::ZERO, Bounds3::size);
        let sizes = of_parts.into_iter().map(size).collect();
        let tree = Tree::new(&boxes);
        let ordered: Vec<([Vec3; 3], Tag)> =
            tree.order().iter().filter_map(|&i| triangles.get(i as usize).copied()).collect();
        let (corners, tags) = ordered.into_iter().unzip();
        let filters: Vec<Filter> = parts
            .iter()
            .map(|part| match materials.get(part.material as usize) {
                Some(material) => Filter {
                    culls_back: material.culls_back(),
                    has_holes: material.alpha != Alpha::Opaque,
                },
                None => Filter { culls_back: false, has_holes: false },
            })
            .collect();
        let plain = filters.iter().all(|filter| !filter.culls_back && !filter.has_holes);
        let has_holes = filters.iter().any(|filter| filter.has_holes);
        let filters = if plain { Vec::new() } else { filters };
        let (closed, bodies) = (OnceLock::new(), OnceLock::new());
        Some(Self { parts, corners, tags, filters, has_holes, tree, bounds, sizes, closed, bodies })
    }

    pub(crate) fn len(&self) -> usize {
        self.corners.len()
    }

    /// Bytes of triangles and tree.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.corners.as_slice()) + size_of_val(self.tags.as_slice()) + self.tree.bytes()
    }

    #[inline]
    pub(crate) fn corners(&self, triangle: usize) -> &[Vec3; 3] {
        &self.corners[triangle]
    }

    pub(crate) fn tag(&self, triangle: usize) -> &Tag {
        &self.tags[triangle]
    }

    /// Size of the bounds of a part's triangles, in the mesh's space.
    pub(crate) fn size_of_part(&self, part: u32) -> DVec3 {
        self.sizes.get(part as usize).copied().unwrap_or(DVec3::ZERO)
    }

    pub(crate) fn part(&self, triangle: usize) -> &Part {
        &self.parts[self.tags[triangle].part as usize]
    }

    /// Whether a ray that meets a triangle from this side is stopped by it. `CAMERA`: it is the
    /// camera's own, which backs of single-sided surfaces do not stop.
    #[inline]
    pub(crate) fn presence<const CAMERA: bool>(
        &self,
        triangle: usize,
        front_face: bool,
    ) -> Presence {
        if if CAMERA { self.filters.is_empty() } else { !self.has_holes } {
            return Presence::Present;
        }
        let filter = self.filters[self.tags[triangle].part as usize];
        match (CAMERA && filter.culls_back && !front_face, filter.has_holes) {
            (true, _) => Presence::Absent,
            (false, true) => Presence::Partial,
            (false, false) => Presence::Present,
        }
    }

    /// Whether this side of a triangle is one that the camera does not see: the back of a
    /// single-sided surface.
    #[inline]
    pub(crate) fn is_unseen(&self, triangle: usize, front_face: bool) -> bool {
        !front_face
            && self.filters.get(self.tags[triangle].part as usize).is_some_and(|f| f.culls_back)
    }

    /// The point of a triangle with these weights of its second and third vertex.
    pub(crate) fn position(&self, triangle: usize, [b1, b2]: [f64; 2]) -> DVec3 {
        let [p0, p1, p2] = self.corners[triangle].map(|p| p.as_dvec3());
        p0 * (1.0 - b1 - b2) + p1 * b1 + p2 * b2
    }

    /// Coordinates and colour there; 0 and white where the mesh has none.
    pub(crate) fn point(&self, triangle: usize, barycentrics: [f32; 2]) -> Point {
        let (part, tag) = (self.part(triangle), self.tags[triangle]);
        let uv = |set: &Option<Arc<[Vec2]>>| {
            let values = set.as_deref().map(|values| at(values, tag));
            values.map_or(Vec2::ZERO, |v| mix(v, barycentrics))
        };
        let color = part.colors.as_deref().map(|values| mix(at(values, tag), barycentrics));
        Point { uv: [uv(&part.uv[0]), uv(&part.uv[1])], color: color.unwrap_or(Vec4::ONE) }
    }

    /// The geometric normal in the mesh's space, not normalised: towards the side on which the
    /// vertices run counter-clockwise.
    pub(crate) fn geometric_normal(&self, triangle: usize) -> DVec3 {
        let [p0, p1, p2] = self.corners[triangle].map(|p| p.as_dvec3());
        (p1 - p0).cross(p2 - p0)
    }

    /// The vertices' normals interpolated, in the mesh's space, not normalised.
    pub(crate) fn normal(&self, triangle: usize, barycentrics: [f32; 2]) -> Option<Vec3> {
        let normals = self.part(triangle).normals.as_deref()?;
        Some(mix(at(normals, self.tags[triangle]), barycentrics))
    }

    /// The tangent of a normal texture in the mesh's space and the sign of the bitangent: the
    /// vertices' tangents, or the direction in which the texture's coordinates grow on this
    /// triangle; either way in the frame that `KHR_texture_transform` has turned and mirrored.
    pub(crate) fn tangent(
        &self,
        triangle: usize,
        barycentrics: [f32; 2],
        texture: &Texture,
    ) -> Option<(Vec3, f32)> {
        let (part, tag) = (self.part(triangle), self.tags[triangle]);
        let turned = texture.turned_frame();
        if let Some(tangents) = part.tangents.as_deref() {
            let [a, b, c] = at(tangents, tag);
            let (tangent, sign) = (mix([a, b, c], barycentrics).truncate(), a.w);
            let Some(([x, y], flip)) = turned else { return Some((tangent, sign)) };
            let normal = self
                .normal(triangle, barycentrics)
                .unwrap_or_else(|| self.geometric_normal(triangle).as_vec3());
            // Lengths and angle of the coordinates' directions on the triangle; a square grid
            // where it has none.
            let gradient = self.gradient(triangle, texture.set);
            let (dpdu, dpdv) = gradient.map_or((Vec3::X, Vec3::Y), |(dpdu, dpdv, _)| (dpdu, dpdv));
            let (u2, uv) = (dpdu.length_squared(), dpdu.dot(dpdv));
            let across = (u2 * dpdv.length_squared() - uv * uv).max(0.0).sqrt();
            // The second coordinate grows against the bitangent.
            let [along, against] = [x * u2 + y * uv, y * across];
            let t = tangent.normalize_or_zero();
            let b = (normal.cross(t) * sign).normalize_or_zero();
            return Some((t * along - b * against, sign * flip));
        }
        let (dpdu, dpdv, sign) = self.gradient(triangle, texture.set)?;
        Some(match turned {
            None => (dpdu, sign),
            Some(([x, y], flip)) => (dpdu * x + dpdv * y, sign * flip),
        })
    }

    /// How a point of a triangle moves with the coordinates of `set`, and the sign of the
    /// bitangent; `None` where the triangle has no area in them.
    #[inline(always)]
    fn gradient(&self, triangle: usize, set: usize) -> Option<(Vec3, Vec3, f32)> {
        let (part, tag) = (self.part(triangle), self.tags[triangle]);
        let [uv0, uv1, uv2] = at(part.uv.get(set)?.as_deref()?, tag);
        let [p0, p1, p2] = self.corners[triangle];
        let (dp1, dp2) = (p1 - p0, p2 - p0);
        let (d1, d2) = (uv1 - uv0, uv2 - uv0);
        let area = d1.x * d2.y - d2.x * d1.y;
        if area == 0.0 || !area.is_finite() {
            return None;
        }
        // Images have their second coordinate downwards, normal maps their green upwards: seen
        // from outside, coordinates that are not mirrored run clockwise.
        let dpdu = (dp1 * d2.y - dp2 * d1.y) / area;
        let dpdv = (dp2 * d1.x - dp1 * d2.x) / area;
        Some((dpdu, dpdv, if area < 0.0 { 1.0 } else { -1.0 }))
    }

    /// Whether no edge is open: each belongs to an even number of triangles (two, or more where
    /// bodies touch), vertices at equal places taken for one. Counted at the first call.
    pub(crate) fn is_closed(&self) -> bool {
        *self.closed.get_or_init(|| is_closed(&self.corners))
    }

    /// Whether a triangle belongs to a connected part that is closed. Found out at the first call:
    /// only where faces coincide anyone asks.
    pub(crate) fn bounds_body(&self, triangle: usize) -> bool {
        let bodies = self.bodies.get_or_init(|| {
            let shells = Shells::new(&self.corners);
            let closed = |i| shells.shell(i).is_some_and(|shell| shell.closure == Closure::Closed);
            (0..self.corners.len()).map(closed).collect()
        });
        bodies.get(triangle).is_some_and(|closed| *closed)
    }

    /// Says beforehand what [`Self::is_closed`] is.
    pub(crate) fn set_closed(&self, closed: bool) {
        // A second answer would be the same.
        let _ = self.closed.set(closed);
    }
}

fn at<T: Copy + Default>(values: &[T], tag: Tag) -> [T; 3] {
    tag.vertices.map(|vertex| values.get(vertex as usize).copied().unwrap_or_default())
}

fn mix<V>(values: [V; 3], [b1, b2]: [f32; 2]) -> V
where
    V: std::ops::Mul<f32, Output = V> + std::ops::Add<Output = V>,
{
    let [a, b, c] = values;
    a * (1.0 - b1 - b2) + b * b1 + c * b2
}

/// Whether no edge is open: each belongs to an even number of triangles, vertices at equal places
/// taken for one. Triangles with fewer than three places are nothing.
pub(crate) fn is_closed(triangles: &[[Vec3; 3]]) -> bool {
    let mut vertices: HashMap<[u32; 3], u32> = HashMap::new();
    // How often each edge is met, lower vertex first.
    let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
    for triangle in triangles {
        let [a, b, c] = triangle.map(|p| {
            let next = vertices.len() as u32;
            // Adding 0 makes the two zeros one.
            *vertices.entry(p.to_array().map(|c| (c + 0.0).to_bits())).or_insert(next)
        });
        if a == b || b == c || c == a {
            continue;
        }
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry((from.min(to), from.max(to))).or_default() += 1;
        }
    }
    !edges.is_empty() && edges.values().all(|&count| count % 2 == 0)
}

#[cfg(test)]
mod tests {
    use super::super::texture::Wrap;
    use super::super::texture::tests::{image, texture};
    use super::*;

    #[test]
    fn closed_means_no_open_edge() {
        let [a, b, c, d] = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
        let tetrahedron = [[a, c, b], [a, b, d], [b, c, d], [c, a, d]];
        assert!(is_closed(&tetrahedron));
        assert!(!is_closed(&tetrahedron[..3]));
        assert!(!is_closed(&[]));
        // A vertex at minus zero is the same, a degenerate triangle is nothing.
        let mut other = tetrahedron.to_vec();
        other[0][0] = Vec3::splat(-0.0);
        other.push([a, a, b]);
        assert!(is_closed(&other));
        // Another body that touches it in a face.
        let twice: Vec<[Vec3; 3]> = other
            .iter()
            .copied()
            .chain([[b, c, d], [b, Vec3::ONE, c], [c, Vec3::ONE, d], [d, Vec3::ONE, b]])
            .collect();
        assert!(is_closed(&twice));
        // A fin on an edge.
        other.push([a, b, Vec3::splat(5.0)]);
        assert!(!is_closed(&other));
    }

    #[test]
    fn derived_tangents_follow_the_coordinates() {
        // A unit square's lower half seen from +z: u to the right, v down.
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let uv: Arc<[Vec2]> = vec![Vec2::new(0.0, 1.0), Vec2::ONE, Vec2::ZERO].into();
        let part = Part { uv: [Some(uv), None], ..Part::default() };
        let tag = Tag { part: 0, vertices: [0, 1, 2] };
        let mesh = Mesh::new(vec![part], vec![(corners, tag)], &[]).unwrap();
        let map = texture(image(1, &[0]), Wrap::Repeat);
        let (tangent, sign) = mesh.tangent(0, [0.2, 0.2], &map).unwrap();
        assert_eq!((tangent, sign), (Vec3::X, 1.0));
        // The bitangent is up.
        assert_eq!(Vec3::Z.cross(tangent) * sign, Vec3::Y);
        let second = Texture { set: 1, ..map };
        assert!(mesh.tangent(0, [0.2, 0.2], &second).is_none());
        assert_eq!(mesh.point(0, [0.5, 0.25]).uv[0], Vec2::new(0.5, 0.75));
    }
}

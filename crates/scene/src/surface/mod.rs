//! Surfaces of triangles: what a ray hits, and what is there.
//!
//! Triangles are stored in the space of their mesh, in single precision as the file has them;
//! instances place meshes in the world. A tree over instances and one over each mesh's triangles
//! find candidates in single precision with padded boxes; what decides is a watertight test in
//! double precision.

mod emitter;
mod interaction;
mod layers;
mod material;
mod mesh;
mod pane;
mod parameters;
pub(crate) mod shells;
mod split;
mod texture;
mod tree;
pub mod triangle;

use glam::{DAffine3, DMat3, DVec3, Vec3};
use pileus_math::Bounds3;
use pileus_media::method::Named;
use rand_core::Rng;

pub use emitter::EmissiveTriangle;
pub use interaction::{Hit, Interaction};
pub use material::Interior;
pub use pane::Obstacle;
pub use parameters::SurfaceParameters;

pub(crate) use material::{Alpha, Material, Scatter};
pub(crate) use mesh::{Mesh, Part, Tag};
pub(crate) use texture::{Image, Texels, Texture, Wrap, srgb_to_linear};

use emitter::{Peaks, mean_radiance};
use interaction::{Rounding, consistent_normal};
use layers::Misfit;
use mesh::Presence;
use tree::{DRay, Tree};
use triangle::ShearedRay;

/// What makes a transmissive surface without `KHR_materials_volume` a body or a thin wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GlassRule {
    /// What glTF says: such a surface is infinitely thin and bends nothing.
    Strict,
    /// Where a connected part of its mesh is closed (no edge is open, vertices at equal places
    /// taken for one) and holds a volume, that part bounds a body. Exporters leave the extension
    /// out where an artist made a glass ball (Blender's does).
    #[default]
    ClosedMeshesAreSolid,
}

impl Named for GlassRule {
    const ALL: &'static [GlassRule] = &[GlassRule::Strict, GlassRule::ClosedMeshesAreSolid];
    const TITLE: &'static str = "Glass";
    const QUESTION: &'static str = "What a transmissive surface without `KHR_materials_volume` is";

    fn name(self) -> &'static str {
        match self {
            GlassRule::Strict => "by_the_letter",
            GlassRule::ClosedMeshesAreSolid => "closed_meshes_are_solid",
        }
    }

    fn about(self) -> &'static str {
        match self {
            GlassRule::Strict => "An infinitely thin wall that bends nothing, as glTF says.",
            GlassRule::ClosedMeshesAreSolid => {
                "A body that bends light if its mesh is closed, as modelling programs mean it; \
                 else a thin wall."
            }
        }
    }
}

/// All surfaces of a scene, immutable.
#[derive(Debug)]
pub struct Surfaces {
    materials: Vec<Material>,
    meshes: Vec<Mesh>,
    instances: Vec<Instance>,
    tree: Tree,
    emitters: Vec<EmissiveTriangle>,
    /// Of each mesh the place of each triangle among its emissive ones; empty if there are none.
    ranks: Vec<Vec<u32>>,
    bounds: Bounds3,
    /// The bounds, padded by more than rounding can move a ray against them.
    padded: Bounds3,
    /// Whether light may go straight through some surface.
    has_panes: bool,
}

/// A mesh in the world.
#[derive(Debug)]
struct Instance {
    mesh: usize,
    name: String,
    to_world: DAffine3,
    to_local: DAffine3,
    /// Inverse transpose of the matrix to the world: for normals.
    normals: DMat3,
    mirrored: bool,
    rounding: Rounding,
    misfit: Misfit,
    bounds: Bounds3,
    /// Number of the first of its emissive triangles.
    first_emitter: u32,
}

/// Numbers of things, for reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SurfaceCounts {
    /// Meshes with triangles.
    pub meshes: usize,
    /// Meshes placed in the world.
    pub instances: usize,
    /// Triangles of all meshes, each counted once.
    pub triangles: usize,
    /// Triangles that emit light, counted per instance.
    pub emitters: usize,
    /// Bytes of triangles and trees.
    pub bytes: usize,
}

/// Rank of a triangle that emits nothing.
const NO_EMITTER: u32 = u32::MAX;
/// Most triangles that may emit light.
const MAX_EMITTERS: usize = 1 << 24;
/// Largest coordinate in the world that leaves room for products of three.
const FARTHEST: f64 = 1e60;

/// Why surfaces cannot be built; the numbers are of meshes placed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// The instance's vertices are too far away.
    TooFar(usize),
    /// There are too many emissive triangles.
    TooManyEmitters,
}

impl Surfaces {
    /// Places meshes: each instance is a mesh's number, the name of its node and its transform.
    ///
    /// Instances whose transform cannot be inverted show nothing and are left out; the second
    /// value is their number. `None` if nothing is left.
    pub(crate) fn new(
        materials: Vec<Material>,
        meshes: Vec<Mesh>,
        placed: Vec<(usize, String, DAffine3)>,
    ) -> Result<(Option<Self>, usize), Refusal> {
        let mut flat = 0;
        let mut instances = Vec::new();
        for (number, (index, name, to_world)) in placed.into_iter().enumerate() {
            let Some(mesh) = meshes.get(index) else { continue };
            let to_local = to_world.inverse();
            if to_world.matrix3.determinant() == 0.0 || !to_local.is_finite() {
                flat += 1;
                continue;
            }
            let bounds = placed_bounds(&to_world, mesh.bounds);
            if !(bounds.low.abs().max(bounds.high.abs()).max_element() < FARTHEST) {
                return Err(Refusal::TooFar(number));
            }
            instances.push(Instance {
                mesh: index,
                name,
                to_world,
                to_local,
                normals: to_local.matrix3.transpose(),
                mirrored: to_world.matrix3.determinant() < 0.0,
                rounding: Rounding::new(&to_world, &to_local),
                misfit: Misfit::default(),
                bounds,
                first_emitter: 0,
            });
        }
        layers::measure(&meshes, &mut instances);
        let boxes: Vec<Bounds3> = instances.iter().map(|i| i.bounds).collect();
        let Some(bounds) = boxes.iter().copied().reduce(Bounds3::union) else {
            return Ok((None, flat));
        };
        let tree = Tree::new(&boxes);
        let mut surfaces = Self {
            materials,
            meshes,
            instances,
            tree,
            emitters: vec![],
            ranks: vec![],
            bounds,
            padded: padded(bounds),
            has_panes: false,
        };
        surfaces.find_emitters()?;
        surfaces.find_panes();
        Ok((Some(surfaces), flat))
    }

    fn find_emitters(&mut self) -> Result<(), Refusal> {
        let peaks: Vec<Option<Peaks>> = self
            .materials
            .iter()
            .map(|material| {
                let texture = match material.unlit {
                    true => material.base_color_texture.as_ref(),
                    false => material.emission_texture.as_ref().filter(|_| material.emits()),
                };
                texture.map(|texture| Peaks::new(&texture.image))
            })
            .collect();
        // Of each mesh its emissive triangles and their radiance.
        let mut emissive: Vec<Vec<(u32, Vec3)>> = Vec::new();
        for mesh in &self.meshes {
            let mut found = Vec::new();
            let mut ranks = Vec::new();
            let emits = mesh.parts.iter().any(|part| self.material(part).emits());
            if emits {
                ranks = vec![NO_EMITTER; mesh.len()];
                for (triangle, rank) in ranks.iter_mut().enumerate() {
                    let number = mesh.part(triangle).material as usize;
                    let material = &self.materials[number];
                    if !material.emits() {
                        continue;
                    }
                    let radiance = mean_radiance(mesh, triangle, material, peaks[number].as_ref());
                    if radiance != Vec3::ZERO {
                        *rank = found.len() as u32;
                        found.push((triangle as u32, radiance));
                    }
                }
            }
            emissive.push(found);
            self.ranks.push(ranks);
        }
        for (number, instance) in self.instances.iter_mut().enumerate() {
            let found = &emissive[instance.mesh];
            instance.first_emitter = self.emitters.len() as u32;
            if self.emitters.len().saturating_add(found.len()) > MAX_EMITTERS {
                return Err(Refusal::TooManyEmitters);
            }
            let mesh = &self.meshes[instance.mesh];
            for &(triangle, radiance) in found {
                let [p0, p1, p2] = mesh
                    .corners(triangle as usize)
                    .map(|p| instance.to_world.transform_point3(p.as_dvec3()));
                let normal = instance.geometric_normal(mesh, triangle as usize);
                let (e1, e2) = (p1 - p0, p2 - p0);
                self.emitters.push(EmissiveTriangle {
                    p0,
                    e1,
                    e2,
                    normal,
                    area: e1.cross(e2).length() * 0.5,
                    radiance,
                    two_sided: self.materials[mesh.part(triangle as usize).material as usize]
                        .double_sided,
                    instance: number as u32,
                    triangle,
                    offset: instance.offset(
                        mesh,
                        triangle as usize,
                        p0.abs().max(p1.abs()).max(p2.abs()),
                        normal,
                    ),
                });
            }
        }
        Ok(())
    }

    fn material(&self, part: &Part) -> &Material {
        &self.materials[part.material as usize]
    }

    /// The nearest hit of a ray with a `t` in (0, `t_max`), in lengths of `direction`.
    ///
    /// Holes are passed: where alpha is below the cutoff, and where a surface that blends is drawn
    /// to be absent, each with probability one minus alpha, independently. For these draws a
    /// number is taken from `rng`, at most one a ray; rays that meet no such surface take none.
    /// Backs of single-sided surfaces count as their fronts do: what stops light must not depend
    /// on the way it goes; see [`Self::seen`] for the rays of a camera. Of faces that coincide the
    /// one is hit that comes first if there is a gap of no width between them (see
    /// [`Self::next_layer`]). Origin and direction that are not finite hit nothing.
    pub fn intersect(
        &self,
        origin: DVec3,
        direction: Vec3,
        t_max: f64,
        rng: &mut impl Rng,
    ) -> Option<Hit> {
        let ray = DRay { origin, direction: direction.as_dvec3() };
        self.trace::<false, false>(ray, t_max, rng)
    }

    /// Whether a ray comes near the surfaces within `t_max`, in lengths of `direction`; if not it
    /// hits nothing. A quick test for callers whose rays mostly pass by.
    #[inline(always)]
    pub fn may_be_met(&self, origin: DVec3, direction: Vec3, t_max: f64) -> bool {
        let inverse = direction.as_dvec3().recip();
        let (a, b) = ((self.padded.low - origin) * inverse, (self.padded.high - origin) * inverse);
        let (from, to) = (a.min(b), a.max(b));
        // One instruction each, unlike the methods of the same meaning.
        let larger = |a: f64, b: f64| if a > b { a } else { b };
        let smaller = |a: f64, b: f64| if a < b { a } else { b };
        let start = larger(larger(from.x, from.y), larger(from.z, 0.0));
        let end = smaller(smaller(to.x, to.y), smaller(to.z, t_max));
        // Also true for what is not a number: the walk decides.
        !(start > end)
    }

    /// The nearest hit of a camera's ray: as [`Self::intersect`], but backs of single-sided
    /// surfaces are passed unless they transmit, as glTF has it for what is shown.
    pub fn seen(
        &self,
        origin: DVec3,
        direction: Vec3,
        t_max: f64,
        rng: &mut impl Rng,
    ) -> Option<Hit> {
        let ray = DRay { origin, direction: direction.as_dvec3() };
        self.trace::<false, true>(ray, t_max, rng)
    }

    /// Whether a surface lies in (0, `t_max`) along a ray; holes and backs as in
    /// [`Self::intersect`].
    pub fn occluded(&self, origin: DVec3, direction: Vec3, t_max: f64, rng: &mut impl Rng) -> bool {
        let ray = DRay { origin, direction: direction.as_dvec3() };
        self.trace::<true, false>(ray, t_max, rng).is_some()
    }

    /// Whether a surface lies strictly between two points. Both ends have to be off surfaces, as
    /// [`Interaction::spawn`] and [`EmissiveTriangle::point`] make them; no length is cut off.
    pub fn occluded_between(&self, from: DVec3, to: DVec3, rng: &mut impl Rng) -> bool {
        let ray = DRay { origin: from, direction: to - from };
        self.trace::<true, false>(ray, 1.0, rng).is_some()
    }

    #[inline]
    fn trace<const ANY: bool, const CAMERA: bool>(
        &self,
        ray: DRay,
        t_max: f64,
        rng: &mut impl Rng,
    ) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let mut seed: Option<u64> = None;
        // Hits so close to the nearest one that their faces may coincide.
        let mut near: Vec<Hit> = Vec::new();
        let per_length = if ANY { 0.0 } else { 1.0 / ray.direction.length() };
        self.walk(&ray, t_max, |instance, mesh, hit, end| {
            // The end of the ray is not part of it.
            if hit.t >= t_max {
                return end;
            }
            let window = instance.misfit.window * per_length;
            let mut first = true;
            if !ANY && let Some(nearest) = best {
                if hit.t - nearest.t > window {
                    return end;
                }
                // Of equally near ones the first counts, in whatever order the trees are walked,
                // backs of single-sided surfaces last.
                let key = |hit: &Hit| (self.is_unseen(hit), hit.instance, hit.triangle);
                first = hit.t < nearest.t || hit.t == nearest.t && key(&hit) < key(&nearest);
                if !self.is_present::<CAMERA>(mesh, &hit, &mut seed, rng) {
                    return end;
                }
                if nearest.t - hit.t <= window {
                    near.push(if first { nearest } else { hit });
                }
            } else if !self.is_present::<CAMERA>(mesh, &hit, &mut seed, rng) {
                return end;
            }
            if !first {
                return end;
            }
            best = Some(hit);
            if ANY { -1.0 } else { (hit.t + window).min(end) }
        });
        match best {
            Some(nearest) if !near.is_empty() => Some(self.first_layer(&ray, nearest, &near)),
            _ => best,
        }
    }

    /// Calls `visit` with every hit of a ray with a `t` in (0, `t_max`], near ones roughly first,
    /// whether the surface is present there or not. `visit` gets the present end of the ray and
    /// returns the new one, which may be closer; a negative end stops the walk.
    #[inline(always)]
    fn walk(
        &self,
        ray: &DRay,
        t_max: f64,
        mut visit: impl FnMut(&Instance, &Mesh, Hit, f64) -> f64,
    ) {
        self.tree.walk(ray, t_max, |place, mut end| {
            let number = self.tree.order()[place];
            let instance = &self.instances[number as usize];
            let mesh = &self.meshes[instance.mesh];
            let local = DRay {
                origin: instance.to_local.transform_point3(ray.origin),
                direction: instance.to_local.transform_vector3(ray.direction),
            };
            let sheared = ShearedRay::new(local.origin, local.direction);
            mesh.tree.walk(&local, end, |triangle, closest| {
                let Some(found) = sheared.intersect(mesh.corners(triangle), closest) else {
                    return closest;
                };
                let hit = Hit {
                    t: found.t,
                    instance: number,
                    triangle: triangle as u32,
                    barycentrics: found.barycentrics,
                    front_face: found.front_face,
                    slack: 0.0,
                    outer_front: found.front_face,
                };
                end = visit(instance, mesh, hit, closest);
                end
            });
            end
        });
    }

    /// Whether a ray meets the surface where it hits its triangle, or passes a hole, or, if it is
    /// the `CAMERA`'s own, the back of a single-sided surface.
    #[inline(always)]
    fn is_present<const CAMERA: bool>(
        &self,
        mesh: &Mesh,
        hit: &Hit,
        seed: &mut Option<u64>,
        rng: &mut impl Rng,
    ) -> bool {
        match mesh.presence::<CAMERA>(hit.triangle as usize, hit.front_face) {
            Presence::Present => true,
            Presence::Absent => false,
            Presence::Partial => {
                let coverage = self.coverage(hit);
                if !(coverage > 0.0) {
                    return false;
                }
                if coverage < 1.0 {
                    let seed = *seed.get_or_insert_with(|| rng.next_u64());
                    return uniform(seed, hit) < coverage;
                }
                true
            }
        }
    }

    /// Whether a hit is on the back of a single-sided surface.
    fn is_unseen(&self, hit: &Hit) -> bool {
        let mesh = &self.meshes[self.instances[hit.instance as usize].mesh];
        mesh.is_unseen(hit.triangle as usize, hit.front_face)
    }

    fn coverage(&self, hit: &Hit) -> f32 {
        let mesh = &self.meshes[self.instances[hit.instance as usize].mesh];
        let triangle = hit.triangle as usize;
        let point = mesh.point(triangle, hit.barycentrics.map(|b| b as f32));
        self.material(mesh.part(triangle)).coverage(&point)
    }

    /// Everything about a hit of a ray along `direction`.
    pub fn interaction(&self, hit: &Hit, direction: Vec3) -> Interaction {
        let instance = &self.instances[hit.instance as usize];
        let mesh = &self.meshes[instance.mesh];
        let triangle = hit.triangle as usize;
        let barycentrics = hit.barycentrics.map(|b| b as f32);
        let p = instance.to_world.transform_point3(mesh.position(triangle, hit.barycentrics));
        let geometric_normal = instance.geometric_normal(mesh, triangle);
        let part = mesh.part(triangle);
        let material = self.material(part);
        let point = mesh.point(triangle, barycentrics);
        let normal = mesh
            .normal(triangle, barycentrics)
            .map(|normal| (instance.normals * normal.as_dvec3()).normalize_or_zero().as_vec3())
            .filter(|normal| *normal != Vec3::ZERO)
            .unwrap_or(geometric_normal);
        let normal = match &material.normal_texture {
            Some((texture, scale)) => {
                let tangent = mesh.tangent(triangle, barycentrics, texture);
                let texel = texture.eval(&point.uv).truncate() * 2.0 - 1.0;
                let texel = Vec3::new(texel.x * scale, texel.y * scale, texel.z);
                tangent
                    .and_then(|tangent| instance.bumped(normal, tangent, texel))
                    .unwrap_or(normal)
            }
            None => normal,
        };
        let emits = hit.front_face || material.double_sided;
        Interaction {
            p,
            geometric_normal,
            shading_normal: consistent_normal(normal, geometric_normal, -direction),
            front_face: hit.front_face,
            parameters: material.parameters(&point, part.solid),
            emission: if emits { material.emission(&point) } else { Vec3::ZERO },
            interior: if part.solid { material.interior_at(&point) } else { None },
            material: part.material,
            instance: hit.instance,
            triangle: hit.triangle,
            emitter: self.emitter_of(hit),
            // Of faces that coincide all have to be left behind.
            offset: instance
                .offset(mesh, triangle, p.abs(), geometric_normal)
                .max(2.0 * f64::from(hit.slack)),
            slack: hit.slack,
            outer_front: hit.outer_front,
        }
    }

    /// All triangles that emit light.
    pub fn emitters(&self) -> &[EmissiveTriangle] {
        &self.emitters
    }

    /// Whether any triangle emits light.
    pub fn emits(&self) -> bool {
        !self.emitters.is_empty()
    }

    /// The number among [`Self::emitters`] of the triangle that was hit.
    pub fn emitter_of(&self, hit: &Hit) -> Option<u32> {
        let instance = &self.instances[hit.instance as usize];
        let rank = *self.ranks[instance.mesh].get(hit.triangle as usize)?;
        (rank != NO_EMITTER).then(|| instance.first_emitter + rank)
    }

    /// Radiance that the point of an emitter with these barycentrics emits against a ray along
    /// `direction`, times the probability that the ray does not pass it as a hole: what a
    /// connection to the point carries. Exact.
    pub fn emitted(&self, emitter: u32, barycentrics: [f32; 2], direction: Vec3) -> Vec3 {
        let Some(found) = self.emitters.get(emitter as usize) else { return Vec3::ZERO };
        if !(found.two_sided || direction.dot(found.normal) < 0.0) {
            return Vec3::ZERO;
        }
        let mesh = &self.meshes[self.instances[found.instance as usize].mesh];
        let triangle = found.triangle as usize;
        let material = self.material(mesh.part(triangle));
        let point = mesh.point(triangle, barycentrics);
        material.emission(&point) * material.coverage(&point)
    }

    /// Lowest and highest corner of all surfaces in world space.
    pub fn bounds(&self) -> Bounds3 {
        self.bounds
    }

    /// Lowest and highest corner of each instance in world space.
    pub fn instance_bounds(&self) -> impl Iterator<Item = Bounds3> + '_ {
        self.instances.iter().map(|instance| instance.bounds)
    }

    /// Whether no edge of an instance's mesh is open: each belongs to an even number of triangles,
    /// vertices at equal places taken for one; `false` for instances that do not exist.
    pub fn mesh_is_closed(&self, instance: u32) -> bool {
        let instance = self.instances.get(instance as usize);
        instance.is_some_and(|instance| self.meshes[instance.mesh].is_closed())
    }

    /// Name of an instance's node; empty if it has none.
    pub fn instance_name(&self, instance: u32) -> &str {
        self.instances.get(instance as usize).map_or("", |instance| &instance.name)
    }

    /// Name of a material; empty if it has none.
    pub fn material_name(&self, material: u32) -> &str {
        self.materials.get(material as usize).map_or("", |material| &material.name)
    }

    /// Whether any surface bounds a medium of its own.
    pub fn has_interiors(&self) -> bool {
        let parts = self.meshes.iter().flat_map(|mesh| &mesh.parts);
        parts.filter(|part| part.solid).any(|part| self.material(part).interior.is_some())
    }

    /// Lowest and highest corner of each instance that a path can be inside of, in world space: one
    /// with a surface that bounds a body, of a material that light passes through.
    pub fn body_bounds(&self) -> impl Iterator<Item = Bounds3> + '_ {
        let is_body = |part: &Part| part.solid && self.material(part).transmits();
        let bodies = move |i: &&Instance| self.meshes[i.mesh].parts.iter().any(is_body);
        self.instances.iter().filter(bodies).map(|instance| instance.bounds)
    }

    /// Numbers of things, for reports.
    pub fn counts(&self) -> SurfaceCounts {
        SurfaceCounts {
            meshes: self.meshes.len(),
            instances: self.instances.len(),
            triangles: self.meshes.iter().map(Mesh::len).sum(),
            emitters: self.emitters.len(),
            bytes: self.tree.bytes() + self.meshes.iter().map(Mesh::bytes).sum::<usize>(),
        }
    }
}

impl Instance {
    /// Unit normal in the world on the front side of a triangle. glTF turns the winding of
    /// mirrored instances around, so that the front stays where it is in the mesh's space.
    fn geometric_normal(&self, mesh: &Mesh, triangle: usize) -> Vec3 {
        let local = mesh.geometric_normal(triangle);
        // First to unit size: cofactors of large scales are larger still.
        let normal = (self.normals * (local / local.abs().max_element())).normalize_or_zero();
        if normal == DVec3::ZERO { Vec3::Z } else { normal.as_vec3() }
    }

    /// How far points of a triangle may be off it, see [`Interaction::spawn`].
    fn offset(&self, mesh: &Mesh, triangle: usize, p_world: DVec3, normal: Vec3) -> f64 {
        let [a, b, c] = mesh.corners(triangle).map(Vec3::abs);
        self.rounding.offset(a.max(b).max(c).as_dvec3(), p_world, normal)
    }

    /// A unit normal turned by a normal map's value; `None` if the tangent is along the normal.
    fn bumped(&self, normal: Vec3, (tangent, sign): (Vec3, f32), texel: Vec3) -> Option<Vec3> {
        let n = normal.as_dvec3();
        let along = self.to_world.transform_vector3(tangent.as_dvec3());
        let along = along.try_normalize()?;
        let tangent = (along - n * n.dot(along)).try_normalize()?;
        let sign = f64::from(if self.mirrored { -sign } else { sign });
        let bitangent = n.cross(tangent) * sign;
        let texel = texel.as_dvec3();
        let turned = tangent * texel.x + bitangent * texel.y + n * texel.z;
        Some(turned.try_normalize()?.as_vec3())
    }
}

/// Bounds with room for the rounding of rays in double precision, and more than a tree of surfaces
/// pads its boxes by.
fn padded(Bounds3 { low, high }: Bounds3) -> Bounds3 {
    let largest = low.abs().max(high.abs()).max_element();
    let padding = (high - low).max_element() * (1.0 / 65_536.0) + largest * 1e-12;
    Bounds3::new(low - padding, high + padding)
}

/// Bounds of a box's eight corners in the world, rounding included.
fn placed_bounds(to_world: &DAffine3, bounds: Bounds3) -> Bounds3 {
    let corners = bounds.corners().map(|corner| to_world.transform_point3(corner));
    let Bounds3 { low, mut high } = Bounds3::of_points(corners);
    if corners.iter().any(|corner| corner.is_nan()) {
        high = DVec3::INFINITY;
    }
    let pad = low.abs().max(high.abs()) * 1e-14;
    Bounds3::new(low - pad, high + pad)
}

/// A uniform number in [0, 1) for whether a ray's blending triangle is there: a function of the
/// ray's seed and the triangle (by the finaliser of Steele's and Lea's SplitMix64), so that the
/// order in which trees are walked does not matter.
fn uniform(seed: u64, hit: &Hit) -> f32 {
    let key = u64::from(hit.instance) << 32 | u64::from(hit.triangle);
    let mix = |mut z: u64| {
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    let bits = mix(seed ^ mix(key.wrapping_add(0x9e37_79b9_7f4a_7c15)));
    (bits >> 40) as f32 / (1u32 << 24) as f32
}

#[cfg(test)]
mod tests;

//! Surfaces that coincide: in which order rays meet them.
//!
//! Faces in one place mean faces with a gap of no width between them, with air in it. So they have
//! an order, and rays meet one after the other. Along a ray come first the bodies that it leaves,
//! then sheets, then the bodies that it enters; opaque things are bodies where they are closed. Of
//! bodies that face the same way the smaller one is inside of the larger. Of sheets those that are
//! opaque lie between those that let light through, which are on both sides of them (a pane on a
//! floor, a label on a wall: seen before it from either side); then a sheet whose front faces the
//! ray comes before one whose back does, and of two that face the same way the smaller lies on the
//! front of the larger. What is left, sheets of the same size or bodies of the same size, is
//! ordered by the materials' names and values, then by place. Nothing depends on the order of
//! nodes, and a ray that comes the other way meets the same order from its other end.
//!
//! All that is decided where a ray finds faces in one place; scenes without such faces are not
//! searched for them.

use std::cmp::Ordering;
use std::hash::Hasher;

use fnv::FnvHasher;
use glam::{DAffine3, DVec3, Vec3};
use pileus_math::Bounds3;
use rand_core::Rng;

use super::interaction::{Hit, Interaction};
use super::material::{Alpha, Material};
use super::mesh::Mesh;
use super::tree::DRay;
use super::{EmissiveTriangle, Instance, Surfaces};

/// How far faces of an instance may be from where they are meant to be, in the world.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Misfit {
    /// By the single precision of vertices and transforms in files.
    file: f64,
    /// By rounding of hits.
    rounding: f64,
    /// Size of the instance.
    size: f64,
    /// How far apart along a unit direction hits may lie for their faces to be compared.
    pub(super) window: f64,
}

/// Single precision rounds vertices, and transforms of their nodes: coordinates are off by some
/// units of 2^-24.
const FILE: f64 = 1.0 / (1u64 << 22) as f64;
/// Faces that are further apart than this share of the smaller instance's size have a gap that is
/// meant.
const GAP: f64 = 4e-6;
/// Largest inverse cosine at which faces that differ by the precision of files are still compared.
const GRAZING: f64 = 16.0;
/// Least cosine between the normals of faces that coincide.
const PARALLEL: f64 = 0.999_99;
/// Barycentric coordinate up to which a hit is on the border of its triangle.
const BORDER: f64 = 1e-9;

/// Fills in the misfits of all instances.
pub(super) fn measure(meshes: &[Mesh], instances: &mut [Instance]) {
    for instance in instances.iter_mut() {
        let Bounds3 { low, high } = instance.bounds;
        let reach = low.abs().max(high.abs());
        let mesh = meshes[instance.mesh].bounds;
        let local = mesh.low.abs().max(mesh.high.abs());
        instance.misfit = Misfit {
            file: reach.max_element() * FILE,
            rounding: instance.rounding.offset(local, reach, Vec3::splat(0.6)),
            size: (high - low).max_element(),
            window: 0.0,
        };
    }
    let largest =
        |f: fn(&Misfit) -> f64| instances.iter().map(|i| f(&i.misfit)).fold(0.0, f64::max);
    let (file, rounding) = (largest(|m| m.file), largest(|m| m.rounding));
    for Instance { misfit, .. } in instances {
        let of_files = (misfit.file + file).min(misfit.size * GAP);
        misfit.window = GRAZING * of_files.max(misfit.rounding + rounding);
    }
}

/// What a surface is in a stack of them, in the order in which a ray meets them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    /// The wall of a body that the ray leaves.
    Left,
    /// A sheet that lets light through, or has holes.
    Sheer,
    Opaque,
    /// The wall of a body that the ray enters.
    Entered,
}

/// One of the surfaces in a place, as a ray meets it.
#[derive(Debug, Clone, Copy)]
struct Layer<'a> {
    hit: Hit,
    kind: Kind,
    part: u32,
    size: f64,
    material: &'a Material,
    instance: &'a Instance,
}

impl Layer<'_> {
    /// An order of surfaces that knows nothing of rays, and nothing of the order in the file as
    /// long as anything else tells them apart.
    fn smaller_first(&self, other: &Self) -> Ordering {
        let places = |i: &Instance| [i.bounds.low.to_array(), i.bounds.high.to_array()];
        let by_place = || {
            let (a, b) = (places(self.instance), places(other.instance));
            let all = a.as_flattened().iter().zip(b.as_flattened());
            all.map(|(a, b)| a.total_cmp(b)).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
        };
        (self.size.total_cmp(&other.size))
            .then_with(|| self.material.name.cmp(&other.material.name))
            .then_with(|| digest(self.material).cmp(&digest(other.material)))
            .then_with(by_place)
            .then_with(|| self.number().cmp(&other.number()))
    }

    /// The order along the ray.
    fn along(&self, other: &Self) -> Ordering {
        let small = |front| if front { Ordering::Less } else { Ordering::Greater };
        self.kind.cmp(&other.kind).then_with(|| match self.kind {
            Kind::Left => self.smaller_first(other),
            Kind::Entered => other.smaller_first(self),
            Kind::Sheer | Kind::Opaque => match (self.hit.front_face, other.hit.front_face) {
                (true, true) => self.smaller_first(other),
                (false, false) => other.smaller_first(self),
                (front, _) => small(front),
            },
        })
    }

    fn number(&self) -> (u32, u32, u32) {
        (self.hit.instance, self.part, self.hit.triangle)
    }

    /// Whether both are one surface, met on the border between two of its triangles.
    fn continues(&self, other: &Self) -> bool {
        let on_border = |hit: &Hit| {
            let [b1, b2] = hit.barycentrics;
            b1.min(b2).min(1.0 - b1 - b2) < BORDER
        };
        self.hit.instance == other.hit.instance
            && self.part == other.part
            && self.hit.front_face == other.hit.front_face
            && (on_border(&self.hit) || on_border(&other.hit))
    }
}

/// Sorts surfaces along a ray; of triangles of one surface `own` is kept, or the first.
fn sort(stack: &mut Vec<Layer<'_>>, own: Option<(u32, u32)>) {
    stack.sort_by(Layer::along);
    let is_own = |layer: &Layer<'_>| own == Some((layer.hit.instance, layer.hit.triangle));
    stack.dedup_by(|later, kept| {
        let one = later.continues(kept);
        if one && is_own(later) {
            *kept = *later;
        }
        one
    });
}

impl Surfaces {
    /// The nearest hit of a ray that leaves a surface, as [`Self::intersect`] has it, but for faces
    /// that coincide: those that come next in the same place are hit at a distance of 0. With
    /// other rays [`Interaction::spawn`] makes the origin, from which `t` counts.
    pub fn intersect_from(
        &self,
        from: &Interaction,
        direction: Vec3,
        t_max: f64,
        rng: &mut impl Rng,
    ) -> Option<Hit> {
        self.next_layer(from, direction, rng)
            .or_else(|| self.intersect(from.spawn(direction), direction, t_max, rng))
    }

    /// The surface that a ray meets next in the very place of the one that it leaves, with a `t` of
    /// 0: of faces that coincide the one behind. `None` if there is no other; then the ray goes on
    /// from [`Interaction::spawn`]. Holes as in [`Self::intersect`].
    ///
    /// Coincident faces mean a gap of no width with air in it. A ray meets first the walls of
    /// bodies that it leaves, then sheets, then the walls of bodies that it enters.
    #[inline]
    pub fn next_layer(
        &self,
        from: &Interaction,
        direction: Vec3,
        rng: &mut impl Rng,
    ) -> Option<Hit> {
        if from.slack == 0.0 {
            return None;
        }
        self.search_next_layer(from, direction, rng)
    }

    #[cold]
    #[inline(never)]
    fn search_next_layer(
        &self,
        from: &Interaction,
        direction: Vec3,
        rng: &mut impl Rng,
    ) -> Option<Hit> {
        let normal = from.geometric_normal.as_dvec3();
        // As in `spawn`, a ray along the surface counts to its front.
        let to_front = !(direction.as_dvec3().dot(normal) < 0.0);
        let slack = f64::from(from.slack);
        let half = 2.0 * slack;
        // All surfaces in this place, by a short ray through it from back to front.
        let probe = DRay { origin: from.p - normal * half, direction: normal * (2.0 * half) };
        let own = Hit {
            t: 0.5,
            instance: from.instance,
            triangle: from.triangle,
            barycentrics: [1.0 / 3.0; 2],
            front_face: false,
            slack: from.slack,
            outer_front: from.outer_front,
        };
        let mut found = vec![own];
        self.walk(&probe, 1.0, |_, _, hit, end| {
            if (hit.instance, hit.triangle) != (own.instance, own.triangle) {
                found.push(hit);
            }
            end
        });
        let mut seed = None;
        found.retain_mut(|hit| {
            let is_own = (hit.instance, hit.triangle) == (own.instance, own.triangle);
            let gap = (hit.t - 0.5).abs() * 2.0 * half;
            if !is_own && !self.coincide(&own, hit, gap) {
                return false;
            }
            hit.front_face ^= !to_front;
            let mesh = &self.meshes[self.instances[hit.instance as usize].mesh];
            is_own || self.is_present::<false>(mesh, hit, &mut seed, rng)
        });
        let mut stack: Vec<Layer<'_>> = found.iter().map(|hit| self.layer(*hit)).collect();
        sort(&mut stack, Some((own.instance, own.triangle)));
        let place = |layer: &Layer<'_>| (layer.hit.instance, layer.hit.triangle);
        let at = stack.iter().position(|layer| place(layer) == (own.instance, own.triangle))?;
        let (own, beyond) = (stack[at], stack.get(at + 1));
        // Sheets that let light through lie on both sides of opaque ones.
        let opaque = stack.iter().any(|layer| layer.kind == Kind::Opaque);
        let was_near = own.hit.outer_front == own.hit.front_face;
        let of = |kind: Kind| move |layer: &&Layer<'_>| layer.kind == kind;
        let (next, far) = match own.kind {
            Kind::Left | Kind::Entered => (beyond, false),
            Kind::Sheer if !opaque || was_near => (beyond, false),
            Kind::Sheer => {
                let next = beyond.filter(of(Kind::Sheer));
                (next.or_else(|| stack.iter().find(of(Kind::Entered))), true)
            }
            Kind::Opaque => {
                let next =
                    beyond.filter(of(Kind::Opaque)).or_else(|| stack.iter().find(of(Kind::Sheer)));
                (next.or(beyond), true)
            }
        };
        let mut hit = next?.hit;
        (hit.t, hit.slack) = (0.0, from.slack);
        hit.outer_front = hit.front_face ^ far;
        Some(hit)
    }

    /// The first along a ray of the surfaces that coincide with the nearest hit; `near` are other
    /// hits that may.
    #[cold]
    #[inline(never)]
    pub(super) fn first_layer(&self, ray: &DRay, nearest: Hit, near: &[Hit]) -> Hit {
        let length = ray.direction.length();
        let cosine = self.normal_of(&nearest).dot(ray.direction).abs();
        let window = |hit: &Hit| self.instances[hit.instance as usize].misfit.window;
        let mut stack = vec![self.layer(nearest)];
        let mut slack = 0.0f64;
        for hit in near {
            let apart = (hit.t - nearest.t).abs();
            let close = apart * length <= window(hit).min(window(&nearest));
            if close && self.coincide(&nearest, hit, apart * cosine) {
                slack = slack.max(self.tolerance(&nearest, hit));
                stack.push(self.layer(*hit));
            }
        }
        sort(&mut stack, None);
        let Some(first) = stack.first().filter(|_| stack.len() > 1) else {
            return stack.first().map_or(nearest, |layer| layer.hit);
        };
        let mut hit = first.hit;
        hit.slack = (slack * (1.0 + 1e-6)).max(f64::from(f32::MIN_POSITIVE)) as f32;
        hit.outer_front = hit.front_face;
        hit
    }

    /// Whether anything hides a point of an emissive triangle from another point: what lies
    /// between, and what coincides with the triangle and comes before it. Both ends as in
    /// [`Self::occluded_between`].
    pub fn hides_lamp(&self, from: DVec3, to: DVec3, emitter: u32, rng: &mut impl Rng) -> bool {
        let Some(light) = self.emitters.get(emitter as usize) else {
            return self.occluded_between(from, to, rng);
        };
        let ray = DRay { origin: from, direction: to - from };
        let window = self.instances[light.instance as usize].misfit.window / ray.direction.length();
        let mut seed = None;
        let mut hidden = false;
        let mut near: Vec<Hit> = Vec::new();
        self.walk(&ray, 1.0 + window, |_, mesh, hit, end| {
            let at_end = hit.t >= 1.0 - window;
            let is_light = (hit.instance, hit.triangle) == (light.instance, light.triangle);
            if at_end && is_light || !self.is_present::<false>(mesh, &hit, &mut seed, rng) {
                return end;
            }
            if at_end {
                near.push(hit);
                return end;
            }
            hidden = true;
            -1.0
        });
        hidden || !near.is_empty() && self.covers(light, &ray, &near)
    }

    /// Whether any of these hits, near the end of a ray at an area light, comes before it.
    #[cold]
    #[inline(never)]
    fn covers(&self, light: &EmissiveTriangle, ray: &DRay, near: &[Hit]) -> bool {
        let normal = light.normal.as_dvec3();
        let (instance, triangle) = (light.instance, light.triangle);
        let own = Hit {
            t: 1.0,
            instance,
            triangle,
            barycentrics: [1.0 / 3.0; 2],
            front_face: ray.direction.dot(normal) < 0.0,
            slack: 0.0,
            outer_front: true,
        };
        let mut stack = vec![self.layer(own)];
        for hit in near {
            let gap = (ray.origin + ray.direction * hit.t - light.p0).dot(normal).abs();
            if self.coincide(&own, hit, gap) {
                stack.push(self.layer(*hit));
            } else if hit.t < 1.0 {
                return true;
            }
        }
        sort(&mut stack, Some((instance, triangle)));
        let first = stack.first().map(|layer| (layer.hit.instance, layer.hit.triangle));
        first != Some((instance, triangle))
    }

    /// Whether two hits that are `gap` apart along a normal are on faces that coincide.
    fn coincide(&self, a: &Hit, b: &Hit, gap: f64) -> bool {
        gap <= self.tolerance(a, b) && self.normal_of(a).dot(self.normal_of(b)).abs() > PARALLEL
    }

    /// How far apart the faces of two hits may be if they are meant to coincide.
    fn tolerance(&self, a: &Hit, b: &Hit) -> f64 {
        let of = |hit: &Hit| &self.instances[hit.instance as usize];
        let part = |hit: &Hit| self.meshes[of(hit).mesh].tag(hit.triangle as usize).part;
        let (x, y) = (of(a).misfit, of(b).misfit);
        let rounding = x.rounding + y.rounding;
        if a.instance == b.instance && a.front_face != b.front_face && part(a) == part(b) {
            // Walls of one body: what is between them, however thin, is its inside.
            return rounding;
        }
        rounding.max((x.file + y.file).min(x.size.min(y.size) * GAP))
    }

    fn normal_of(&self, hit: &Hit) -> DVec3 {
        let instance = &self.instances[hit.instance as usize];
        let mesh = &self.meshes[instance.mesh];
        instance.geometric_normal(mesh, hit.triangle as usize).as_dvec3()
    }

    fn layer(&self, hit: Hit) -> Layer<'_> {
        let instance = &self.instances[hit.instance as usize];
        let mesh = &self.meshes[instance.mesh];
        let number = mesh.tag(hit.triangle as usize).part;
        let part = mesh.part(hit.triangle as usize);
        let material = self.material(part);
        let sheer = material.transmits() || material.alpha != Alpha::Opaque;
        let body = match material.transmits() {
            true => part.solid,
            false => !sheer && mesh.bounds_body(hit.triangle as usize),
        };
        let kind = match (body, hit.front_face) {
            (true, true) => Kind::Entered,
            (true, false) => Kind::Left,
            (false, _) if sheer => Kind::Sheer,
            (false, _) => Kind::Opaque,
        };
        let size = placed_size(&instance.to_world, mesh.size_of_part(number));
        Layer { hit, kind, part: number, size, material, instance }
    }
}

/// Length of the diagonal of a box of this size in the world.
fn placed_size(to_world: &DAffine3, size: DVec3) -> f64 {
    let m = &to_world.matrix3;
    let sides = [m.x_axis * size.x, m.y_axis * size.y, m.z_axis * size.z];
    sides.iter().map(|side| side.length_squared()).sum::<f64>().sqrt()
}

/// A number made from a material's values and from some texels of its colours (FNV-1a).
fn digest(material: &Material) -> u64 {
    /// Texels along each axis.
    const SIDE: u32 = 8;
    let textures = [&material.base_color_texture, &material.emission_texture];
    let texels = textures.into_iter().flatten().flat_map(|texture| {
        let [width, height] = texture.image.size();
        let at = |i: u32, n: u32| (u64::from(n) * u64::from(i) / u64::from(SIDE)) as u32;
        (0..SIDE * SIDE)
            .map(move |i| texture.image.texel(at(i % SIDE, width), at(i / SIDE, height)).to_array())
    });
    let numbers = [
        material.base_color.to_array().as_slice(),
        material.emission.to_array().as_slice(),
        material.specular_color.to_array().as_slice(),
        material.diffuse_transmission_color.to_array().as_slice(),
        material.sheen_color.to_array().as_slice(),
        &[
            material.metallic,
            material.roughness,
            material.ior,
            material.specular,
            material.transmission,
            material.diffuse_transmission,
            material.clearcoat,
            material.clearcoat_roughness,
            material.sheen_roughness,
            f32::from(u8::from(material.double_sided)),
        ],
        material
            .interior
            .map_or([0.0; 7], |i| {
                let (a, s) = (i.sigma_a, i.sigma_s);
                [a.x, a.y, a.z, s.x, s.y, s.z, i.g]
            })
            .as_slice(),
    ]
    .concat();
    let mut hasher = FnvHasher::default();
    for number in numbers.into_iter().chain(texels.flatten()) {
        hasher.write(&number.to_le_bytes());
    }
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat};
    use rand_core::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::super::mesh::{Part, Tag};
    use super::*;

    fn number(rng: &mut Pcg64Mcg) -> f64 {
        (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A square in the plane z = 0 with its front upwards, and a box below it.
    fn mesh(material: u32, solid: bool, half: f32, boxed: bool, materials: &[Material]) -> Mesh {
        let p = |x: f32, y: f32, z: f32| Vec3::new(x * half, y * half, z * half);
        let mut corners = vec![
            [p(-1., -1., 0.), p(1., -1., 0.), p(1., 1., 0.)],
            [p(-1., -1., 0.), p(1., 1., 0.), p(-1., 1., 0.)],
        ];
        if boxed {
            let ring = [p(-1., -1., 0.), p(1., -1., 0.), p(1., 1., 0.), p(-1., 1., 0.)];
            let tip = p(0., 0., -2.);
            corners.extend((0..4).map(|i| [ring[(i + 1) % 4], ring[i], tip]));
        }
        let tag = |i: usize| Tag { part: 0, vertices: [0, 1, 2].map(|k| (3 * i + k) as u32) };
        let triangles = corners.iter().enumerate().map(|(i, t)| (*t, tag(i))).collect();
        let part = Part { material, solid, ..Part::default() };
        Mesh::new(vec![part], triangles, materials).unwrap()
    }

    /// The instances that a ray meets in the place where it first hits something.
    fn met(surfaces: &Surfaces, origin: DVec3, direction: Vec3) -> Vec<u32> {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let mut hit = surfaces.intersect(origin, direction, f64::INFINITY, &mut rng);
        let first = hit.unwrap().t;
        let mut met = Vec::new();
        while let Some(found) = hit {
            met.push(found.instance);
            let interaction = surfaces.interaction(&found, direction);
            hit = surfaces.next_layer(&interaction, direction, &mut rng);
            assert!(hit.is_none_or(|hit| hit.t == 0.0));
            assert!(met.len() < 100);
            if hit.is_none() {
                // What comes next is another place.
                let on = interaction.spawn(direction);
                let next = surfaces.intersect(on, direction, f64::INFINITY, &mut rng);
                assert!(next.is_none_or(|next| next.t > 1e-3 * first), "{met:?} {next:?}");
            }
        }
        met
    }

    /// Random stacks of walls of bodies and sheets in one plane, turned, scaled, placed and
    /// numbered at random: rays meet every one of them, bodies that are left first, in an order
    /// that does not depend on numbers, and the reverse of it from the other side.
    #[test]
    fn stacks_have_one_order_from_both_sides() {
        let transmitting = |name: &str| Material {
            name: name.into(),
            transmission: 1.0,
            double_sided: true,
            ..Material::default()
        };
        let materials = [transmitting("a"), transmitting("b")];
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let mut layered = 0;
        for _ in 0..300 {
            let n = 1 + (number(&mut rng) * 5.0) as usize;
            let frame = DAffine3::from_scale_rotation_translation(
                DVec3::splat(10f64.powf(6.0 * number(&mut rng) - 3.0)),
                DQuat::from_euler(
                    glam::EulerRot::XYZ,
                    6.0 * number(&mut rng),
                    6.0 * number(&mut rng),
                    6.0 * number(&mut rng),
                ),
                DVec3::new(number(&mut rng), -number(&mut rng), number(&mut rng)) * 3.0,
            );
            // What each is: size, whether a body, whether on the upper side.
            let items: Vec<(f32, bool, bool)> = (0..n)
                .map(|i| (1.0 + i as f32 * 0.37, number(&mut rng) < 0.6, number(&mut rng) < 0.5))
                .collect();
            let build = |order: &[usize]| {
                let meshes = order.iter().map(|&i| {
                    let (half, body, _) = items[i];
                    mesh((i % 2) as u32, body, half, body, &materials)
                });
                let placed = order.iter().enumerate().map(|(k, &i)| {
                    let turn = if items[i].2 {
                        DMat3::from_rotation_x(std::f64::consts::PI)
                    } else {
                        DMat3::IDENTITY
                    };
                    (k, String::new(), frame * DAffine3::from_mat3(turn))
                });
                Surfaces::new(materials.to_vec(), meshes.collect(), placed.collect())
                    .unwrap()
                    .0
                    .unwrap()
            };
            let order: Vec<usize> = (0..n).collect();
            let reversed: Vec<usize> = order.iter().rev().copied().collect();
            let (one, other) = (build(&order), build(&reversed));
            // Starts below the plane, inside of all bodies there, and above.
            let at = DVec3::new(0.11 * number(&mut rng) + 0.02, 0.13, 0.0);
            let side = DVec3::new(0.02, -0.03, 0.1);
            let along = |d: DVec3| frame.transform_vector3(d).as_vec3().normalize();
            let up = met(&one, frame.transform_point3(at - side), along(side));
            let down = met(&one, frame.transform_point3(at + side), along(-side));
            let again = met(&other, frame.transform_point3(at - side), along(side));
            assert_eq!(up.len(), n, "{items:?} {up:?}");
            assert_eq!(up, down.iter().rev().copied().collect::<Vec<_>>(), "{items:?}");
            let again: Vec<u32> = again.iter().map(|k| n as u32 - 1 - k).collect();
            assert_eq!(up, again, "{items:?}");
            let class = |i: &u32| match items[*i as usize] {
                (_, true, false) => 0,
                (_, false, _) => 1,
                (_, true, true) => 2,
            };
            assert!(up.is_sorted_by_key(class), "{items:?} {up:?}");
            // The smaller is inside of the larger.
            let left: Vec<u32> = up.iter().copied().filter(|i| class(i) == 0).collect();
            let entered: Vec<u32> = up.iter().copied().filter(|i| class(i) == 2).collect();
            assert!(left.is_sorted() && entered.iter().rev().is_sorted(), "{items:?} {up:?}");
            layered += usize::from(n > 1);
        }
        assert!(layered > 200);
    }
}

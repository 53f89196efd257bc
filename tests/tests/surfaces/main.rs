//! Surfaces and light from volumes in whole pictures: closed forms, furnaces, techniques against
//! each other.

mod area_lights;
mod fire;
mod furnace;
mod glass;
mod occlusion;
mod punctual;

use glam::{DVec3, Vec3};
use pileus_scene::{Camera, Scene};
use pileus_tests::{Triangles, lambert, quad, surfaces};
use serde_json::Value;

/// A diffuse floor of albedo `albedo` in the plane y = 0, `2 half` wide.
pub fn floor(half: f32, albedo: f32) -> (Triangles, Value) {
    let plane = quad([-half, 0.0, -half], [0.0, 0.0, 2.0 * half], [2.0 * half, 0.0, 0.0]);
    (plane, lambert([albedo; 3]))
}

/// A camera below `y = 0.45` that sees the plane y = 0 alone, near the origin.
pub fn towards_floor() -> Camera {
    let (eye, target) = (DVec3::new(0.0, 0.45, 1.5), DVec3::new(0.0, 0.0, 0.2));
    Camera::look_at(eye, target, DVec3::Y, 15.0, [64, 64]).unwrap()
}

/// Where a ray meets the plane y = 0.
pub fn on_floor((o, d): (DVec3, DVec3)) -> DVec3 {
    o - d * (o.y / d.y)
}

/// An empty scene with these surfaces, seen by [`towards_floor`].
pub fn floor_scene(meshes: &[(Triangles, Value)]) -> Scene {
    let mut scene = pileus_tests::scene(Vec::new(), DVec3::Z, DVec3::ZERO, 30.0);
    scene.camera = towards_floor();
    scene.surfaces = Some(surfaces(meshes));
    scene
}

/// Irradiance over radiance at a point of normal `n` from a convex polygon above its horizon
/// [Lambert 1760].
pub fn form_factor_pi(p: DVec3, n: DVec3, polygon: &[DVec3]) -> f64 {
    let corners: Vec<DVec3> = polygon.iter().map(|v| (*v - p).normalize()).collect();
    let sum: f64 = (0..corners.len())
        .map(|i| {
            let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
            let cross = a.cross(b);
            cross.length().atan2(a.dot(b)) * cross.normalize_or_zero().dot(n)
        })
        .sum();
    0.5 * sum.abs()
}

/// Rays that leave a floor at height zero, which no coordinate of its own keeps them off, do not
/// hit it.
#[test]
fn rays_leave_planes_through_the_origin() {
    use pileus_media::random::uniform;
    use rand_pcg::Pcg32;
    let mut rng = Pcg32::new(1, 1);
    for axis in 0..3 {
        let turn = |p: [f32; 3]| [0, 1, 2].map(|k| p[(k + axis) % 3]);
        let (plane, material) = floor(5.0, 0.5);
        let plane: Vec<_> = plane.into_iter().map(|t| t.map(turn)).collect();
        let surfaces = surfaces(&[(plane, material)]);
        let up = Vec3::from_array(turn([0.0, 1.0, 0.0]));
        for _ in 0..5000 {
            let mut u = || 9.0 * (uniform(&mut rng) - 0.5);
            let from = Vec3::from_array(turn([u(), 2.0, u()]));
            let Some(hit) = surfaces.intersect(from.as_dvec3(), -up, 1e9, &mut rng) else {
                panic!("{from} misses")
            };
            let interaction = surfaces.interaction(&hit, -up);
            let mut u = || uniform(&mut rng) - 0.5;
            let wi = Vec3::from_array(turn([u(), 0.5 * u().abs() + 1e-4, u()])).normalize();
            let origin = interaction.spawn(wi);
            assert!(surfaces.intersect(origin, wi, 1e9, &mut rng).is_none(), "{origin} {wi}");
        }
    }
}

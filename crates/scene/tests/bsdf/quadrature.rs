//! Integrals over directions that resolve narrow lobes.

use glam::{DVec3, Vec3};
use pileus_math::basis;
use pileus_scene::SurfaceParameters;

use crate::materials::NORMAL;

/// Polar coordinates about the middle of a lobe: angle `pi x^2` with x in [0, 1], and an azimuth in
/// turns.
pub(crate) struct Polar {
    axis: Vec3,
    x: Vec3,
    y: Vec3,
}

impl Polar {
    pub(crate) fn new(axis: Vec3) -> Polar {
        let (x, y) = basis(axis);
        Polar { axis, x, y }
    }

    /// Direction, and solid angle per `dx` and turn.
    pub(crate) fn direction(&self, x: f64, turn: f64) -> (Vec3, f64) {
        let (sin, cos) = (std::f64::consts::PI * x * x).sin_cos();
        let (sin_phi, cos_phi) = (turn * std::f64::consts::TAU).sin_cos();
        let local = DVec3::new(sin * cos_phi, sin * sin_phi, cos).as_vec3();
        let w = (local.x * self.x + local.y * self.y + local.z * self.axis).normalize();
        (w, sin * std::f64::consts::TAU * x * std::f64::consts::TAU)
    }

    /// Coordinates of a direction.
    pub(crate) fn coordinates(&self, w: Vec3) -> (f64, f64) {
        let half = ((w - self.axis).as_dvec3().length() / 2.0).min(1.0).asin();
        let x = (2.0 * half / std::f64::consts::PI).sqrt();
        let turn = f64::from(self.y.dot(w)).atan2(f64::from(self.x.dot(w)));
        (x.min(1.0), (turn / std::f64::consts::TAU).rem_euclid(1.0))
    }

    /// `sum f(w) dw` over a cell, midpoint rule.
    pub(crate) fn cell(
        &self,
        x: [f64; 2],
        turn: [f64; 2],
        [n, m]: [u32; 2],
        mut f: impl FnMut(Vec3) -> DVec3,
    ) -> DVec3 {
        let mut sum = DVec3::ZERO;
        let scale = (x[1] - x[0]) * (turn[1] - turn[0]) / f64::from(n * m);
        for a in 0..n {
            let xa = x[0] + (x[1] - x[0]) * (f64::from(a) + 0.5) / f64::from(n);
            for b in 0..m {
                let tb = turn[0] + (turn[1] - turn[0]) * (f64::from(b) + 0.5) / f64::from(m);
                let (w, density) = self.direction(xa, tb);
                sum += f(w) * (density * scale);
            }
        }
        sum
    }
}

/// Middles of the lobes of reflection and transmission.
pub(crate) fn lobes(p: &SurfaceParameters, wo: Vec3, entering: bool) -> [Polar; 2] {
    let mirrored = (2.0 * wo.dot(NORMAL) * NORMAL - wo).normalize();
    let eta = match (p.thin_walled, entering) {
        (true, _) => 1.0,
        (false, true) => p.ior,
        (false, false) => 1.0 / p.ior,
    };
    let along = (wo - wo.dot(NORMAL) * NORMAL) / eta;
    let cos2 = 1.0 - along.length_squared();
    // Under total reflection about the horizon.
    let bent = (-along - cos2.max(0.0).sqrt() * NORMAL).normalize();
    [Polar::new(mirrored), Polar::new(bent)]
}

/// `sum f(w) dw` over all directions on the viewer's side and the other, with n x m points each.
///
/// At grazing angles lobes are narrow across the plane of incidence: they need many azimuths.
pub(crate) fn over_sphere(
    lobes: &[Polar; 2],
    [n, m]: [u32; 2],
    f: impl Fn(Vec3) -> DVec3,
) -> [DVec3; 2] {
    let side = |sign: f32| {
        let polar = &lobes[usize::from(sign < 0.0)];
        polar.cell([0.0, 1.0], [0.0, 1.0], [n, m], |w| {
            if NORMAL.dot(w) * sign > 0.0 { f(w) } else { DVec3::ZERO }
        })
    };
    [side(1.0), side(-1.0)]
}

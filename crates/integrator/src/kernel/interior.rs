//! Homogeneous media inside closed surfaces: what `KHR_materials_volume` and
//! `KHR_materials_volume_scatter` describe.
//!
//! A path remembers the bodies it is in; the one entered last counts, and each is forgotten when
//! its own surface is left, so that bodies may be nested or overlap. Its own are the surfaces of
//! its mesh with its material; where a body is left through a surface that nothing was entered by,
//! the last of its mesh. Distances are drawn for one channel, chosen by throughput, and weighted by
//! the balance heuristic over channels [Miller et al. 2019, section 5.3]: no channel's weight
//! exceeds the number of channels.

use glam::{DVec3, Vec3};
use pileus_math::elementary::exp;
use pileus_media::random::{exponential, uniform};
use pileus_scene::{Interaction, Interior, Surfaces};
use rand_core::Rng;
use rand_pcg::Pcg32;
use smallvec::SmallVec;

/// The interior media that a path is in, the one entered last at the end.
#[derive(Debug, Clone, Default)]
pub(crate) struct MediumStack(SmallVec<[(Boundary, Interior); 2]>);

/// What tells interior media apart: the instance and the material of their surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Boundary {
    instance: u32,
    material: u32,
}

impl Boundary {
    fn of(surface: &Interaction) -> Boundary {
        Boundary { instance: surface.instance, material: surface.material }
    }

    /// The place among bodies entered of the one that is left through this wall.
    fn left(
        self,
        bodies: impl DoubleEndedIterator<Item = Boundary> + ExactSizeIterator + Clone,
    ) -> Option<usize> {
        let mut own = bodies.clone();
        own.rposition(|wall| wall == self).or_else(|| {
            let mut bodies = bodies;
            bodies.rposition(|wall| wall.instance == self.instance)
        })
    }
}

/// An interior without a medium of its own.
const CLEAR: Interior = Interior { sigma_a: Vec3::ZERO, sigma_s: Vec3::ZERO, g: 0.0 };

/// Crossings after which a search for the interior media around a point gives up.
const MAX_CROSSINGS: usize = 4096;

impl MediumStack {
    /// Outside of all.
    pub(crate) fn new() -> MediumStack {
        MediumStack::default()
    }

    /// The interior media around a point: those that a ray leaves without having entered them. Of
    /// three rays two have to agree, so that meshes which are not closed and rays along edges do
    /// not count.
    pub(crate) fn around(surfaces: &Surfaces, p: DVec3) -> MediumStack {
        let [a, b, c] =
            [Vec3::new(0.36, 0.48, 0.8), Vec3::new(-0.8, 0.36, -0.48), Vec3::new(0.48, -0.8, 0.36)]
                .map(|direction| MediumStack::left_by(surfaces, p, direction));
        let walls = |inside: &MediumStack| {
            let mut walls: SmallVec<[Boundary; 2]> = inside.0.iter().map(|body| body.0).collect();
            walls.sort_unstable();
            walls
        };
        if walls(&a) == walls(&b) || walls(&a) == walls(&c) {
            a
        } else if walls(&b) == walls(&c) {
            b
        } else {
            MediumStack::new()
        }
    }

    fn left_by(surfaces: &Surfaces, p: DVec3, direction: Vec3) -> MediumStack {
        let mut rng = Pcg32::new(0, 0);
        let (mut left, mut entered) = (MediumStack::new(), SmallVec::<[Boundary; 4]>::new());
        let mut last: Option<Interaction> = None;
        for _ in 0..MAX_CROSSINGS {
            let hit = match &last {
                Some(from) => surfaces.intersect_from(from, direction, f64::INFINITY, &mut rng),
                None => surfaces.intersect(p, direction, f64::INFINITY, &mut rng),
            };
            let Some(hit) = hit else { break };
            let interaction = surfaces.interaction(&hit, direction);
            last = Some(interaction);
            let parameters = &interaction.parameters;
            let opaque = parameters.transmission == 0.0 && parameters.diffuse_transmission == 0.0;
            if parameters.thin_walled || opaque {
                continue;
            }
            let wall = Boundary::of(&interaction);
            if interaction.front_face {
                entered.push(wall);
            } else if let Some(i) = wall.left(entered.iter().copied()) {
                entered.remove(i);
            } else {
                left.0.push((wall, interaction.interior.unwrap_or(CLEAR)));
            }
        }
        // The body that is left first was entered last.
        left.0.reverse();
        left
    }

    /// Forgets all.
    #[inline]
    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The interior medium entered last.
    pub(crate) fn last(&self) -> Option<&Interior> {
        self.0.last().map(|body| &body.1)
    }

    /// Crosses the boundary of an interior medium to its other side.
    pub(crate) fn cross(&mut self, surface: &Interaction) {
        if surface.front_face {
            self.0.push((Boundary::of(surface), surface.interior.unwrap_or(CLEAR)));
        } else if let Some(i) = self.position(surface) {
            self.0.remove(i);
        }
    }

    /// A path goes through a surface.
    #[inline]
    pub(crate) fn pass_through(&mut self, surface: &Interaction) {
        if !surface.parameters.thin_walled {
            self.cross(surface);
        }
    }

    /// What lies on the other side of a body's surface.
    pub(crate) fn across<'a>(&'a self, surface: &'a Interaction) -> Option<&'a Interior> {
        if surface.front_face {
            return surface.interior.as_ref();
        }
        let left = self.position(surface);
        let stays = |&(i, _): &(usize, _)| Some(i) != left;
        self.0.iter().enumerate().rev().find(stays).map(|(_, body)| &body.1)
    }

    fn position(&self, surface: &Interaction) -> Option<usize> {
        Boundary::of(surface).left(self.0.iter().map(|body| body.0))
    }
}

/// Extinction per channel, 1/length.
fn sigma_t(interior: &Interior) -> Vec3 {
    interior.sigma_a + interior.sigma_s
}

/// Albedo of single scattering per channel; zero where there is no extinction.
pub(crate) fn albedo(interior: &Interior) -> Vec3 {
    let sigma_t = sigma_t(interior);
    Vec3::select(sigma_t.cmpgt(Vec3::ZERO), interior.sigma_s / sigma_t, Vec3::ZERO)
}

/// Transmittance per channel over a distance; of a body without extinction over any distance it is
/// one.
pub(crate) fn transmittance(interior: &Interior, distance: f64) -> Vec3 {
    Vec3::from_array(sigma_t(interior).to_array().map(|sigma_t| {
        if sigma_t > 0.0 { exp(-(f64::from(sigma_t) * distance) as f32) } else { 1.0 }
    }))
}

/// Flies inside a body up to `t_end`; the distance of a scattering, if there is one before. `beta`,
/// the throughput, is multiplied by the weight of what happened, albedo included. Unbiased.
pub(crate) fn fly<R: Rng>(
    interior: &Interior,
    t_end: f64,
    beta: &mut Vec3,
    rng: &mut R,
) -> Option<f64> {
    let sigma_t = sigma_t(interior);
    if interior.sigma_s == Vec3::ZERO {
        *beta *= transmittance(interior, t_end);
        return None;
    }
    // Weights of flights have either sign: a channel is chosen by size.
    let total = beta.abs().element_sum();
    if !(total > 0.0) {
        return None;
    }
    let share = beta.abs() / total;
    let mut u = uniform(rng);
    let channel = (0..2).find(|&c| {
        let taken = u < share[c];
        u -= share[c];
        taken
    });
    let rate = sigma_t[channel.unwrap_or(2)];
    let t = if rate > 0.0 { f64::from(exponential(rng) / rate) } else { f64::INFINITY };
    if t < t_end {
        let passed = transmittance(interior, t);
        let pdf = share.dot(sigma_t * passed);
        *beta *= interior.sigma_s * passed / pdf;
        return Some(t);
    }
    let passed = transmittance(interior, t_end);
    let pdf = share.dot(passed);
    if pdf > 0.0 {
        *beta *= passed / pdf;
    } else {
        *beta = Vec3::ZERO;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_pcg::Pcg32;

    /// What passes and what scatters, per channel, against closed forms. Null hypothesis: the means
    /// are exact; |z| < 5.5 on 18 means, false alarm 7e-7.
    #[test]
    fn flights_are_exact_per_channel() {
        let mut rng = Pcg32::new(5, 5);
        for (sigma_a, sigma_s) in [
            (Vec3::new(0.1, 0.5, 2.0), Vec3::new(1.0, 0.3, 0.0)),
            (Vec3::new(0.0, 0.0, 0.4), Vec3::new(3.0, 0.0, 0.2)),
            (Vec3::ZERO, Vec3::splat(0.7)),
        ] {
            let interior = Interior { sigma_a, sigma_s, g: 0.0 };
            let (n, length) = (200_000, 1.5);
            let mut sums = [[Vec3::ZERO.as_dvec3(); 2]; 2];
            let start = Vec3::new(0.9, 0.5, 0.2);
            for _ in 0..n {
                let mut beta = start;
                let scattered = fly(&interior, length, &mut beta, &mut rng).is_some();
                let x = (beta / start).as_dvec3();
                assert!(beta.element_sum() <= 3.01 * start.element_sum());
                sums[usize::from(scattered)][0] += x;
                sums[usize::from(scattered)][1] += x * x;
            }
            let passed = transmittance(&interior, length).as_dvec3();
            let t = (sigma_a + sigma_s).as_dvec3();
            let into = sigma_s.as_dvec3() / t.max(glam::DVec3::splat(1e-30)) * (1.0 - passed);
            for ([sum, squares], exact) in sums.into_iter().zip([passed, into]) {
                let (mean, square) = (sum / f64::from(n), squares / f64::from(n));
                for c in 0..3 {
                    let error = ((square[c] - mean[c] * mean[c]) / f64::from(n)).sqrt();
                    let z = (mean[c] - exact[c]) / error.max(1e-6);
                    assert!(z.abs() < 5.5, "{interior:?} {c}: {} {}, z {z}", mean[c], exact[c]);
                }
            }
        }
    }

    #[test]
    fn absorbing_bodies_have_no_noise() {
        let interior = Interior { sigma_a: Vec3::new(0.0, 1.0, 2.0), sigma_s: Vec3::ZERO, g: 0.0 };
        let mut beta = Vec3::ONE;
        assert_eq!(fly(&interior, 0.5, &mut beta, &mut Pcg32::new(1, 1)), None);
        assert!((beta - Vec3::new(1.0, 0.606_530_7, 0.367_879_44)).length() < 1e-5);
        let clear = Interior { sigma_a: Vec3::ZERO, ..interior };
        assert_eq!(transmittance(&clear, f64::INFINITY), Vec3::ONE);
    }
}

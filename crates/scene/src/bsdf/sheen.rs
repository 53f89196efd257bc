//! The sheen of cloth: grazing light on upright fibres (`KHR_materials_sheen`).

use std::f32::consts::PI;

use glam::Vec3;
use pileus_math::elementary::{exp, ln};

use super::table::{CosineTable, Row};

/// Smaller roughness is raised to this one: the lobe would be a line at the horizon.
const MIN_ROUGHNESS: f32 = 0.07;

/// A layer of fibres, without absorption where the colour is white.
///
/// Distribution of Estevez and Kulla (2017, "Charlie"), `alpha` the square of the roughness, with
/// the visibility of Ashikhmin and Premoze (2007) that the extension names as an alternative. That
/// pair reflects more than it receives at grazing angles; here it is divided by
/// `max(1, E(o), E(i))`, `E` the tabulated albedo, which keeps it reciprocal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sheen {
    color: Vec3,
    /// Half of the exponent of the sine.
    half_exponent: f32,
    albedo: Row<1>,
}

/// Directional albedo of the raw lobe over the cosine and the roughness.
static ALBEDO: CosineTable<1> =
    CosineTable::new(|r| r.max(MIN_ROUGHNESS), |cos, r| [quadrature(cos, r, 32)]);

/// Midpoint rule over directions, even in azimuth and in the root of the cosine.
fn quadrature(cos: f32, roughness: f32, n: u32) -> f32 {
    let half_exponent = half_exponent(roughness);
    // At zero the visibility has no bound.
    let cos = cos.max(1e-4);
    let o = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
    let mut sum = 0.0f64;
    for a in 0..n {
        let x = (a as f32 + 0.5) / n as f32;
        let cos_i = x * x;
        let sin = (1.0 - cos_i * cos_i).sqrt();
        for b in 0..n {
            let (sin_phi, cos_phi) =
                pileus_math::elementary::sin_cos_turn((b as f32 + 0.5) / (2 * n) as f32);
            let i = Vec3::new(sin * cos_phi, sin * sin_phi, cos_i);
            sum += f64::from(raw(half_exponent, o, i) * cos_i * 2.0 * x);
        }
    }
    (sum * std::f64::consts::TAU / f64::from(n * n)) as f32
}

fn half_exponent(roughness: f32) -> f32 {
    let roughness = roughness.max(MIN_ROUGHNESS);
    0.5 / (roughness * roughness)
}

/// Distribution times visibility, 1/sr.
#[inline]
fn raw(half_exponent: f32, o: Vec3, i: Vec3) -> f32 {
    let h = (o + i).normalize_or(Vec3::Z);
    let sin2 = h.x * h.x + h.y * h.y;
    // The logarithm needs a normal number; the power is zero there.
    let power = if sin2 > 1e-30 { exp(half_exponent * ln(sin2)).min(1.0) } else { 0.0 };
    let density = (2.0 + 2.0 * half_exponent) * power / (2.0 * PI);
    density / (4.0 * (o.z + i.z - o.z * i.z))
}

impl Sheen {
    /// `None` where there is no sheen.
    pub(super) fn new(color: Vec3, roughness: f32) -> Option<Sheen> {
        let color = color.clamp(Vec3::ZERO, Vec3::ONE);
        (color.max_element() > 0.0).then(|| Sheen {
            color,
            half_exponent: half_exponent(roughness),
            albedo: ALBEDO.row(roughness),
        })
    }

    /// Value, 1/sr; both directions local and above the horizon. Reciprocal.
    #[inline]
    pub(super) fn eval(&self, o: Vec3, i: Vec3) -> Vec3 {
        let [albedo_o] = self.albedo.at(o.z);
        let [albedo_i] = self.albedo.at(i.z);
        let gain = albedo_o.max(albedo_i).max(1.0);
        self.color * (raw(self.half_exponent, o, i) / gain)
    }

    /// Bound of the directional albedo of the strongest channel: what the layers below lose, in [0,
    /// 1].
    #[inline]
    pub(super) fn loss(&self, cos: f32) -> f32 {
        self.color.max_element() * self.albedo.at(cos)[0].min(1.0)
    }

    /// Estimate of the directional albedo.
    #[inline]
    pub(super) fn albedo(&self, cos: f32) -> Vec3 {
        self.color * self.albedo.at(cos)[0].min(1.0)
    }

    /// Mean albedo over the hemisphere.
    pub(super) fn average(&self) -> Vec3 {
        self.color * self.albedo.average()[0].min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_is_the_albedo() {
        let mut worst = 0f32;
        let mut gain = 0f32;
        for roughness in [0.1f32, 0.3, 0.52, 0.77, 1.0] {
            for k in 0..40 {
                let cos = (k as f32 + 0.5) / 40.0;
                let fine = quadrature(cos, roughness, 256);
                worst = worst.max((fine - ALBEDO.row(roughness).at(cos)[0]).abs() / fine.max(0.1));
                gain = gain.max(fine);
            }
        }
        assert!(worst < 0.02, "largest error {worst}");
        assert!(
            gain > 1.0,
            "the raw lobe gains energy somewhere, else no division is needed: {gain}"
        );
    }

    #[test]
    fn distribution_projects_to_one() {
        for roughness in [0.07f32, 0.4, 1.0] {
            let e = half_exponent(roughness);
            let n = 100_000;
            let total: f64 = (0..n)
                .map(|k| {
                    let theta = (f64::from(k) + 0.5) / f64::from(n) * std::f64::consts::FRAC_PI_2;
                    // raw without its visibility: with o = i = h the latter is 1 / (4 (2 z - z^2)).
                    let h = Vec3::new(theta.sin() as f32, 0.0, theta.cos() as f32);
                    let density = f64::from(raw(e, h, h) * 4.0 * (2.0 * h.z - h.z * h.z));
                    density
                        * theta.cos()
                        * theta.sin()
                        * std::f64::consts::TAU
                        * std::f64::consts::FRAC_PI_2
                        / f64::from(n)
                })
                .sum();
            assert!((total - 1.0).abs() < 1e-3, "roughness {roughness}: {total}");
        }
    }
}

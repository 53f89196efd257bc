//! The SGGX distribution of microflake normals: an ellipsoid's [Heitz, Dupuy, Crassin and
//! Dachsbacher 2015, "The SGGX microflake distribution"].
//!
//! A symmetric positive matrix S says how much area the microflakes in a unit of volume show to
//! every direction: `sigma(w) = sqrt(w' S w)`. All of it is computed in double precision: for thin
//! fibres det S is 1e-6, which single precision cannot carry through an inverse.

use glam::{DMat3, DVec3, Mat3, Vec3};
use pileus_math::basis;
use pileus_math::elementary::sin_cos_turn;
use std::f64::consts::PI;

/// Least roughness: of smaller ones the distribution is beyond single precision.
pub const MIN_ROUGHNESS: f32 = 1e-3;

/// The matrix S. Eigenvalues are squared projected areas along the axes of the ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sggx {
    /// Diagonal: xx, yy, zz.
    diagonal: [f32; 3],
    /// xy, xz, yz.
    off_diagonal: [f32; 3],
}

impl Sggx {
    /// Microflakes that look in all directions alike.
    pub const ISOTROPIC: Sggx = Sggx { diagonal: [1.0; 3], off_diagonal: [0.0; 3] };

    /// The matrix of the entries xx, yy, zz and xy, xz, yz. Eigenvalues below a millionth of the
    /// largest are lifted to it. `None` if an entry is not finite, an eigenvalue is below zero by
    /// more than rounding, or all are zero.
    pub fn new(diagonal: [f32; 3], off_diagonal: [f32; 3]) -> Option<Sggx> {
        let s = Sggx { diagonal, off_diagonal };
        let [low, _, high] = s.eigenvalues()?;
        if !(high > 0.0 && low >= -1e-5 * high) {
            return None;
        }
        let least = f64::from(MIN_ROUGHNESS * MIN_ROUGHNESS) * high;
        // The same on the whole diagonal shifts all eigenvalues and turns no axis.
        let lift = (least - low).max(0.0) as f32;
        Some(Sggx { diagonal: diagonal.map(|d| d + lift), off_diagonal })
    }

    /// Microflakes around a fibre along the unit vector `axis`: area 1 across, `roughness` (clamped
    /// to [0.001, 1]) along it.
    pub fn fibre(axis: Vec3, roughness: f32) -> Sggx {
        let r = roughness.clamp(MIN_ROUGHNESS, 1.0);
        let r2 = r * r;
        Sggx::of(DMat3::IDENTITY - outer(axis) * f64::from(1.0 - r2))
    }

    /// Microflakes of a surface with the unit normal `normal`: area 1 along it, `roughness`
    /// (clamped to [0.001, 1]) across.
    pub fn surface(normal: Vec3, roughness: f32) -> Sggx {
        let r = roughness.clamp(MIN_ROUGHNESS, 1.0);
        let r2 = f64::from(r * r);
        Sggx::of(DMat3::IDENTITY * r2 + outer(normal) * (1.0 - r2))
    }

    #[cfg(test)]
    pub(crate) fn of_matrix(m: DMat3) -> Sggx {
        Sggx::of(m)
    }

    fn of(m: DMat3) -> Sggx {
        let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
        Sggx {
            diagonal: [x.x, y.y, z.z].map(|v| v as f32),
            off_diagonal: [y.x, z.x, z.y].map(|v| v as f32),
        }
    }

    /// S in double precision.
    pub(crate) fn matrix(&self) -> DMat3 {
        let [xx, yy, zz] = self.diagonal.map(f64::from);
        let [xy, xz, yz] = self.off_diagonal.map(f64::from);
        DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz))
    }

    /// The distribution turned by a rotation.
    pub fn turned(&self, rotation: &Mat3) -> Sggx {
        let r = rotation.as_dmat3();
        Sggx::of(r * self.matrix() * r.transpose())
    }

    /// Eigenvalues, ascending; `None` if an entry is not finite. Closed form for symmetric matrices
    /// [Smith 1961].
    pub(crate) fn eigenvalues(&self) -> Option<[f64; 3]> {
        let s = self.matrix();
        let mean = (s.x_axis.x + s.y_axis.y + s.z_axis.z) / 3.0;
        let b = s - DMat3::IDENTITY * mean;
        let p2 =
            (b.x_axis.length_squared() + b.y_axis.length_squared() + b.z_axis.length_squared())
                / 6.0;
        if !p2.is_finite() {
            return None;
        }
        if p2 <= 1e-28 * mean * mean {
            return Some([mean; 3]);
        }
        let p = p2.sqrt();
        let r = (b * (1.0 / p)).determinant() * 0.5;
        let angle = libm::acos(r.clamp(-1.0, 1.0)) / 3.0;
        let high = mean + 2.0 * p * libm::cos(angle);
        let low = mean + 2.0 * p * libm::cos(angle + 2.0 * PI / 3.0);
        Some([low, 3.0 * mean - high - low, high])
    }

    /// Area that the microflakes of a unit of volume show to `w`: the factor of extinction along a
    /// ray.
    pub fn projected_area(&self, w: Vec3) -> f32 {
        let w = w.as_dvec3();
        w.dot(self.matrix() * w).max(0.0).sqrt() as f32
    }

    /// The largest projected area of all directions.
    pub fn largest_area(&self) -> f32 {
        // Wider by rounding.
        self.eigenvalues().map_or(f32::INFINITY, |[_, _, high]| (high.sqrt() * (1.0 + 1e-6)) as f32)
    }

    /// Density of microflake normals `D(m)` over the sphere, per area: its integral times the
    /// cosine to a direction is the projected area.
    pub fn density(&self, m: Vec3) -> f64 {
        density(&self.matrix(), m.as_dvec3())
    }

    /// A normal drawn in proportion to what microflakes show to `w`, `<w, m> D(m) / sigma(w)`, for
    /// two numbers in [0, 1).
    pub fn sample_visible(&self, w: Vec3, u: [f32; 2]) -> Vec3 {
        // In a basis whose third axis is `w` the ellipsoid is seen as a disc.
        let (k, j) = basis(w);
        let turned = DMat3::from_cols(k.as_dvec3(), j.as_dvec3(), w.as_dvec3());
        let s = turned.transpose() * self.matrix() * turned;
        let (kk, jj, ii) = (s.x_axis.x, s.y_axis.y, s.z_axis.z.max(0.0));
        let (kj, ki, ji) = (s.y_axis.x, s.z_axis.x, s.z_axis.y);
        let determinant =
            kk * (jj * ii - ji * ji) - kj * (kj * ii - ji * ki) + ki * (kj * ji - jj * ki);
        let (root_det, root_ii) = (determinant.max(0.0).sqrt(), ii.sqrt());
        let q = (jj * ii - ji * ji).max(0.0).sqrt();
        let m_k = DVec3::new(root_det / q, 0.0, 0.0);
        let m_j = DVec3::new((kj * ii - ki * ji) / q, q, 0.0) / root_ii;
        let m_i = DVec3::new(ki, ji, ii) / root_ii;
        let radius = f64::from(u[0]).sqrt();
        let (sin, cos) = sin_cos_turn(u[1]);
        let z = (1.0 - f64::from(u[0])).max(0.0).sqrt();
        let local = m_k * (radius * f64::from(cos)) + m_j * (radius * f64::from(sin)) + m_i * z;
        (turned * local).normalize_or(w.as_dvec3()).as_vec3()
    }

    /// Value of the phase function of microflakes that mirror, 1/sr, for unit directions of
    /// propagation before and after; also the density of
    /// [`sample_specular`](Sggx::sample_specular). `sigma(-incoming) f(incoming, wi)` is symmetric
    /// under exchange and reversal.
    pub fn specular(&self, incoming: Vec3, wi: Vec3) -> f32 {
        let wo = -incoming;
        // Straight on there is no microflake; any normal across stands for it.
        let h = (wo.as_dvec3() + wi.as_dvec3()).normalize_or(basis(wo).0.as_dvec3());
        let s = self.matrix();
        (0.25 * density(&s, h) / area(&s, wo)) as f32
    }

    /// A direction mirrored by a microflake, and its density, 1/sr.
    pub fn sample_specular(&self, incoming: Vec3, u: [f32; 2]) -> (Vec3, f32) {
        let wo = -incoming;
        let m = self.sample_visible(wo, u);
        let wi = (m * (2.0 * m.dot(wo)) - wo).normalize();
        // As `specular` sees the rounded direction.
        (wi, self.specular(incoming, wi))
    }
}

fn outer(a: Vec3) -> DMat3 {
    let a = a.as_dvec3();
    DMat3::from_cols(a * a.x, a * a.y, a * a.z)
}

fn area(s: &DMat3, w: Vec3) -> f64 {
    let w = w.as_dvec3();
    w.dot(*s * w).max(f64::MIN_POSITIVE).sqrt()
}

/// `1 / (pi sqrt(det S) (m' S^-1 m)^2)`, by the adjugate, which needs no division.
fn density(s: &DMat3, m: DVec3) -> f64 {
    let [a, b, c] = [s.x_axis, s.y_axis, s.z_axis];
    // Rows of the adjugate; S is symmetric.
    let (bc, ca, ab) = (b.cross(c), c.cross(a), a.cross(b));
    let determinant = a.dot(bc).max(0.0);
    let quadratic = m.dot(DVec3::new(bc.dot(m), ca.dot(m), ab.dot(m)));
    if !(quadratic > 0.0) {
        return 0.0;
    }
    determinant * determinant.sqrt() / (PI * quadratic * quadratic)
}

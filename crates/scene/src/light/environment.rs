//! Light from all around: a constant, an image, or both.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use glam::{Vec2, Vec3};
use pileus_math::luminance;

use crate::error::{Error, Place};

/// Radiance that arrives from infinitely far away.
#[derive(Debug, Clone, Default)]
pub struct Environment {
    /// Radiance that does not depend on the direction, linear Rec. 709.
    pub constant: Vec3,
    /// Radiance that varies with the direction, added to the constant.
    pub image: Option<Arc<EnvironmentImage>>,
}

impl Environment {
    /// Radiance that arrives from the unit direction `d` (pointing away from the scene).
    #[inline]
    pub fn radiance(&self, d: Vec3) -> Vec3 {
        match &self.image {
            Some(image) => self.constant + image.radiance(d),
            None => self.constant,
        }
    }

    /// Whether no light comes from the environment at all.
    pub fn is_black(&self) -> bool {
        self.constant == Vec3::ZERO && self.image.is_none()
    }
}

/// A direction drawn from an [`EnvironmentImage`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnvSample {
    /// Unit direction away from the scene.
    pub wi: Vec3,
    /// Radiance of the image from there, linear Rec. 709.
    pub radiance: Vec3,
    /// Density per steradian, above 0.
    pub pdf: f32,
}

/// A latitude-longitude picture of the surroundings and a distribution to sample it.
///
/// +Y is up, the middle column (u = 0.5) lies at -Z, and the picture is seen from inside: to
/// the right of -Z is +X. `rotation_y` turns it counter-clockwise seen from above.
///
/// Radiance is interpolated bilinearly between texel centres, periodic in longitude and clamped
/// at the poles. The density of samples is constant inside a texel and proportional to
/// max(0, luminance - mean luminance): *MIS compensation* (Karlik, Šik, Vévoda, Skřivan and
/// Křivánek, "MIS compensation: optimizing sampling techniques in multiple importance sampling",
/// 2019). Phase sampling covers what this leaves out, so **the density may be 0 where the radiance
/// is not**: use it in a combination with a technique that covers the whole sphere.
#[derive(Debug)]
pub struct EnvironmentImage {
    width: usize,
    height: usize,
    texels: Vec<[f32; 3]>,
    /// Sine and cosine of the rotation.
    rotation: Vec2,
    /// Bounds of the rows' shares of [0, 1]: `height + 1` values, ends exactly 0 and 1.
    rows: Vec<f32>,
    /// For each row `width + 1` bounds of its columns' shares, ends exactly 0 and 1.
    columns: Vec<f32>,
    /// Cosine of the polar angle at the upper border of each row, and -1 at the end.
    cosines: Vec<f64>,
    sampled_power: f32,
}

/// Most texels an environment image may have.
pub(crate) const MAX_TEXELS: usize = 1 << 27;

impl EnvironmentImage {
    /// An image from texels in rows from the top, linear Rec. 709, finite and not negative.
    ///
    /// `intensity` multiplies all radiance; `rotation_y_degrees` turns the image counter-clockwise
    /// seen from above. Cost: a few passes over the texels.
    pub fn new(
        width: usize,
        height: usize,
        mut texels: Vec<[f32; 3]>,
        intensity: f32,
        rotation_y_degrees: f64,
    ) -> Result<Self, Error> {
        let invalid = |what: String, remedy: &str| {
            let place = Place { part: Some("environment image".into()), ..Place::default() };
            Error::invalid(place, what, remedy)
        };
        let count = width.checked_mul(height).filter(|&n| n > 0 && n <= MAX_TEXELS);
        if count != Some(texels.len()) {
            return Err(invalid(
                format!("{width} x {height} texels with {} values", texels.len()),
                "use an image of at least one and at most 2^27 texels",
            ));
        }
        if !(intensity >= 0.0 && intensity.is_finite() && rotation_y_degrees.is_finite()) {
            return Err(invalid(
                format!("intensity {intensity}, rotation {rotation_y_degrees}"),
                "use a finite intensity of at least 0 and a finite rotation",
            ));
        }
        for texel in &mut texels {
            for value in texel.iter_mut() {
                *value *= intensity;
                if !(*value >= 0.0 && value.is_finite()) {
                    return Err(invalid(
                        format!("a texel has the value {value}"),
                        "clean the image: radiance is finite and not negative",
                    ));
                }
            }
        }
        let (sin, cos) = libm::sincos(rotation_y_degrees.to_radians());
        let mut image = Self {
            width,
            height,
            texels,
            rotation: Vec2::new(sin as f32, cos as f32),
            rows: Vec::new(),
            columns: Vec::new(),
            cosines: (0..=height)
                .map(|y| if y == height { -1.0 } else { libm::cos(PI * y as f64 / height as f64) })
                .collect(),
            sampled_power: 0.0,
        };
        image.build_distribution();
        Ok(image)
    }

    /// Width and height in texels.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Radiance that arrives from the unit direction `d`, linear Rec. 709.
    #[inline]
    pub fn radiance(&self, d: Vec3) -> Vec3 {
        let [u, v] = self.texture_of(d);
        self.lookup(u, v)
    }

    /// A direction drawn in proportion to the compensated luminance; `u` in [0, 1).
    ///
    /// `None` when the image has nothing brighter than its mean (it is constant).
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> Option<EnvSample> {
        if self.sampled_power <= 0.0 {
            return None;
        }
        let (y, v_in_row) = pick(&self.rows, u[1]);
        let (x, u_in_cell) = pick(self.columns_of(y), u[0]);
        let cell_pdf = self.cell_pdf(x, y);
        if cell_pdf <= 0.0 {
            return None;
        }
        // Uniform in the solid angle of the texel: in longitude and in the cosine of latitude.
        let phi = ((x as f64 + f64::from(u_in_cell)) / self.width as f64 - 0.5) * TAU;
        let (top, bottom) = (self.cosines[y], self.cosines[y + 1]);
        let cos_theta = top + (bottom - top) * f64::from(v_in_row);
        let sin_theta = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
        let (sin_phi, cos_phi) = libm::sincos(phi);
        let local = Vec3::new(
            (sin_theta * sin_phi) as f32,
            cos_theta as f32,
            (-sin_theta * cos_phi) as f32,
        );
        let wi = self.to_world(local).normalize();
        // Rounding may have pushed the direction over a border: what counts is where it lies now.
        let pdf = self.pdf(wi);
        (pdf > 0.0).then(|| EnvSample { wi, radiance: self.radiance(wi), pdf })
    }

    /// Density per steradian with which [`Self::sample`] returns the unit direction `d`.
    #[inline]
    pub fn pdf(&self, d: Vec3) -> f32 {
        let [u, v] = self.texture_of(d);
        let x = ((u * self.width as f32) as usize).min(self.width - 1);
        let y = ((v * self.height as f32) as usize).min(self.height - 1);
        self.cell_pdf(x, y)
    }

    /// Integral over the sphere of the luminance that [`Self::sample`] covers, that is of
    /// max(0, luminance - mean): a measure of how much there is to find by sampling.
    pub fn sampled_power(&self) -> f32 {
        self.sampled_power
    }

    fn build_distribution(&mut self) {
        let (width, height) = (self.width, self.height);
        // The luminance a texel's area shows on average under bilinear interpolation: weights
        // 1/8, 6/8, 1/8 along each axis.
        let mut smooth = vec![0f32; width * height];
        for y in 0..height {
            for x in 0..width {
                let at = |dx: usize, dy: usize| {
                    let column = (x + width + dx - 1) % width;
                    let row = (y + dy).saturating_sub(1).min(height - 1);
                    luminance(Vec3::from_array(self.texels[row * width + column]))
                };
                let line = |dy: usize| 0.125 * (at(0, dy) + at(2, dy)) + 0.75 * at(1, dy);
                smooth[y * width + x] = 0.125 * (line(0) + line(2)) + 0.75 * line(1);
            }
        }
        let solid_angle = |y: usize| (self.cosines[y] - self.cosines[y + 1]) * TAU / width as f64;
        let mut mean = 0.0;
        for (y, row) in smooth.chunks_exact(width).enumerate() {
            mean += row.iter().map(|&l| f64::from(l)).sum::<f64>() * solid_angle(y);
        }
        mean /= 2.0 * TAU;
        // What is above the mean by rounding alone is nothing to look for.
        let threshold = mean * (1.0 + 1e-5);
        let mut rows = Vec::with_capacity(height);
        let mut columns = Vec::with_capacity((width + 1) * height);
        for (y, row) in smooth.chunks_exact(width).enumerate() {
            let weights = row.iter().map(|&l| {
                let l = f64::from(l);
                if l > threshold { l - mean } else { 0.0 }
            });
            let total = push_bounds(&mut columns, weights, width);
            rows.push(total * solid_angle(y));
        }
        let mut bounds = Vec::with_capacity(height + 1);
        let power = push_bounds(&mut bounds, rows.iter().copied(), height);
        self.rows = bounds;
        self.columns = columns;
        self.sampled_power = power as f32;
    }

    fn columns_of(&self, y: usize) -> &[f32] {
        &self.columns[y * (self.width + 1)..(y + 1) * (self.width + 1)]
    }

    #[inline]
    fn cell_pdf(&self, x: usize, y: usize) -> f32 {
        let columns = self.columns_of(y);
        let row = f64::from(self.rows[y + 1]) - f64::from(self.rows[y]);
        let cell = f64::from(columns[x + 1]) - f64::from(columns[x]);
        let solid_angle = (self.cosines[y] - self.cosines[y + 1]) * TAU / self.width as f64;
        (row * cell / solid_angle) as f32
    }

    /// Texture coordinates in [0, 1] of a world direction.
    #[inline]
    fn texture_of(&self, d: Vec3) -> [f32; 2] {
        let Vec2 { x: sin, y: cos } = self.rotation;
        // The inverse rotation about +Y.
        let (x, z) = (cos * d.x - sin * d.z, sin * d.x + cos * d.z);
        let u = libm::atan2f(x, -z) * (0.5 / std::f32::consts::PI) + 0.5;
        // atan2 keeps its digits near the poles, where acos loses them.
        let v = libm::atan2f((x * x + z * z).sqrt(), d.y) * std::f32::consts::FRAC_1_PI;
        [u.clamp(0.0, 1.0), v.clamp(0.0, 1.0)]
    }

    #[inline]
    fn to_world(&self, d: Vec3) -> Vec3 {
        let Vec2 { x: sin, y: cos } = self.rotation;
        Vec3::new(cos * d.x + sin * d.z, d.y, -sin * d.x + cos * d.z)
    }

    #[inline]
    fn lookup(&self, u: f32, v: f32) -> Vec3 {
        let x = u * self.width as f32 - 0.5;
        let y = v * self.height as f32 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let left = if x0 < 0.0 { self.width - 1 } else { (x0 as usize).min(self.width - 1) };
        let right = if left + 1 == self.width { 0 } else { left + 1 };
        let top = (y0.max(0.0) as usize).min(self.height - 1);
        let bottom = if y0 < 0.0 { 0 } else { (top + 1).min(self.height - 1) };
        let texel = |x: usize, y: usize| Vec3::from(self.texels[y * self.width + x]);
        let upper = texel(left, top).lerp(texel(right, top), fx);
        let lower = texel(left, bottom).lerp(texel(right, bottom), fx);
        upper.lerp(lower, fy).max(Vec3::ZERO)
    }
}

/// Appends the `count + 1` bounds of the shares that `weights` have of [0, 1]; returns their sum.
///
/// Sums are kept in `f64`; the bounds are rounded once, so they never decrease and a weight of
/// zero has a share of exactly zero. All-zero weights get equal shares, which the caller must not
/// use (the sum says so).
fn push_bounds(bounds: &mut Vec<f32>, weights: impl Iterator<Item = f64>, count: usize) -> f64 {
    let start = bounds.len();
    let mut prefix = Vec::with_capacity(count + 1);
    let mut sum = 0.0f64;
    let mut last_nonzero = 0;
    prefix.push(0.0);
    for (i, weight) in weights.enumerate() {
        sum += weight;
        prefix.push(sum);
        if weight > 0.0 {
            last_nonzero = i + 1;
        }
    }
    if sum > 0.0 {
        bounds.extend(prefix.iter().map(|&p| (p / sum) as f32));
        for bound in &mut bounds[start + last_nonzero..] {
            *bound = 1.0;
        }
    } else {
        bounds.extend((0..=count).map(|i| i as f32 / count as f32));
    }
    sum
}

/// The interval of `bounds` that holds `u`, and where in it `u` lies, in [0, 1).
#[inline]
fn pick(bounds: &[f32], u: f32) -> (usize, f32) {
    let u = u.clamp(0.0, 1.0 - f32::EPSILON / 2.0);
    let index = bounds.partition_point(|&b| b <= u).clamp(1, bounds.len() - 1) - 1;
    let (low, high) = (bounds[index], bounds[index + 1]);
    let share = if high > low { (u - low) / (high - low) } else { 0.5 };
    (index, share.clamp(0.0, 1.0 - f32::EPSILON / 2.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Numbers in [0, 1) that fill the unit square evenly (Roberts' R2 sequence).
    fn points(n: u32) -> impl Iterator<Item = [f32; 2]> {
        (0..n).map(|i| {
            let at = |a: f64| ((f64::from(i) + 0.5) * a).fract() as f32;
            [at(0.754_877_666_246_692_7), at(0.569_840_290_998_053_2)]
        })
    }

    fn random(seed: u64) -> impl FnMut() -> f32 {
        let mut state = seed;
        move || {
            // splitmix64 (Steele, Lea and Flood 2014)
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = state;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
        }
    }

    fn uneven(width: usize, height: usize, rotation: f64) -> EnvironmentImage {
        let mut next = random(7);
        let texels = (0..width * height)
            .map(|i| {
                let spike = if i % 37 == 5 { 40.0 } else { 0.0 };
                [next() + spike, next(), next() * 2.0]
            })
            .collect();
        EnvironmentImage::new(width, height, texels, 1.5, rotation).unwrap()
    }

    fn direction(u: f64, v: f64) -> Vec3 {
        let (phi, theta) = ((u - 0.5) * TAU, v * PI);
        Vec3::new(
            (theta.sin() * phi.sin()) as f32,
            theta.cos() as f32,
            (-theta.sin() * phi.cos()) as f32,
        )
    }

    #[test]
    fn orientation_is_that_of_the_specification() {
        // One bright texel each; the middle column is -Z, the quarter to its right is +X.
        for (x, y, d) in [
            (4, 2, Vec3::NEG_Z),
            (6, 2, Vec3::X),
            (0, 2, Vec3::Z),
            (2, 2, Vec3::NEG_X),
            (4, 0, Vec3::Y),
            (4, 4, Vec3::NEG_Y),
        ] {
            // Odd height, so that a row lies on the horizon; texel borders lie at u = 0.5.
            let mut texels = vec![[0.0; 3]; 8 * 5];
            texels[y * 8 + x] = [1.0; 3];
            texels[y * 8 + (x + 7) % 8] = [1.0; 3];
            if y != 2 {
                texels[y * 8..(y + 1) * 8].fill([1.0; 3]);
            }
            let image = EnvironmentImage::new(8, 5, texels, 1.0, 0.0).unwrap();
            assert!((image.radiance(d) - Vec3::ONE).length() < 1e-5, "{x} {y}");
            assert!(image.radiance(-d).length() < 1e-5, "{x} {y}");
        }
    }

    #[test]
    fn rotation_is_counter_clockwise_seen_from_above() {
        let texels: Vec<_> = (0..64 * 32).map(|i| [(i % 64) as f32, 0.0, 0.0]).collect();
        let straight = EnvironmentImage::new(64, 32, texels.clone(), 1.0, 0.0).unwrap();
        let turned = EnvironmentImage::new(64, 32, texels, 1.0, 30.0).unwrap();
        // Counter-clockwise seen from +Y takes -Z towards -X.
        for d in [Vec3::NEG_Z, Vec3::X, Vec3::new(0.3, 0.5, -0.2).normalize()] {
            let there = glam::Quat::from_rotation_y(30f32.to_radians()) * d;
            assert!((straight.radiance(d) - turned.radiance(there)).length() < 1e-3);
        }
        let quarter = glam::Quat::from_rotation_y(90f32.to_radians()) * Vec3::NEG_Z;
        assert!((quarter - Vec3::NEG_X).length() < 1e-6);
    }

    #[test]
    fn pdf_integrates_to_one() {
        for image in [uneven(32, 16, 0.0), uneven(17, 9, 123.0)] {
            let (n, mut sum) = (400_000, 0.0);
            for [a, b] in points(n) {
                let z = 1.0 - 2.0 * b;
                let r = (1.0 - z * z).max(0.0).sqrt();
                let (sin, cos) = (a * std::f32::consts::TAU).sin_cos();
                sum += f64::from(image.pdf(Vec3::new(r * sin, z, r * cos)));
            }
            let integral = sum / f64::from(n) * 2.0 * TAU;
            assert!((integral - 1.0).abs() < 2e-3, "{integral}");
        }
    }

    /// Chi-square over cells finer than the texels; null hypothesis: samples follow `pdf`.
    /// 200,000 samples per image, fixed seed, false alarm rate 1e-7 per image.
    #[test]
    fn samples_follow_the_density() {
        use statrs::distribution::{ChiSquared, ContinuousCDF};
        for (width, height, rotation) in [(16, 8, 0.0), (13, 7, 77.0), (1, 6, 0.0)] {
            let image = uneven(width, height, rotation);
            let straight =
                EnvironmentImage { rotation: Vec2::new(0.0, 1.0), ..uneven(width, height, 0.0) };
            let (cells_x, cells_y) = (width * 2, height * 2);
            let mut observed = vec![0u32; cells_x * cells_y];
            let (n, mut next) = (200_000, random(99));
            for _ in 0..n {
                let sample = image.sample([next(), next()]).unwrap();
                assert_eq!(sample.pdf, image.pdf(sample.wi));
                assert_eq!(sample.radiance, image.radiance(sample.wi));
                assert!((sample.wi.length() - 1.0).abs() < 1e-6);
                let [u, v] = image.texture_of(sample.wi);
                let x = ((u * cells_x as f32) as usize).min(cells_x - 1);
                let y = ((v * cells_y as f32) as usize).min(cells_y - 1);
                observed[y * cells_x + x] += 1;
            }
            let (mut chi2, mut dof) = (0.0, -1.0);
            for y in 0..cells_y {
                let band = |y: usize| (PI * y as f64 / cells_y as f64).cos();
                let solid_angle = (band(y) - band(y + 1)) * TAU / cells_x as f64;
                for x in 0..cells_x {
                    let d = direction(
                        (x as f64 + 0.5) / cells_x as f64,
                        (y as f64 + 0.5) / cells_y as f64,
                    );
                    let expected = f64::from(straight.pdf(d)) * solid_angle * f64::from(n);
                    let count = f64::from(observed[y * cells_x + x]);
                    if expected < 5.0 {
                        assert!(count < 30.0, "{count} samples where {expected} are expected");
                        continue;
                    }
                    chi2 += (count - expected).powi(2) / expected;
                    dof += 1.0;
                }
            }
            let p = 1.0 - ChiSquared::new(dof).unwrap().cdf(chi2);
            assert!(p > 1e-7, "{width}x{height}: chi2 {chi2} for {dof}, p {p}");
        }
    }

    #[test]
    fn compensation_skips_what_lies_below_the_mean() {
        let constant = EnvironmentImage::new(8, 4, vec![[0.3, 0.4, 0.5]; 32], 2.0, 0.0).unwrap();
        assert!(constant.sample([0.3, 0.6]).is_none());
        assert_eq!(constant.sampled_power(), 0.0);
        let image = uneven(16, 8, 0.0);
        let covered =
            points(20_000).filter(|p| image.pdf(direction(p[0].into(), p[1].into())) > 0.0).count();
        assert!(covered > 500 && covered < 15_000, "{covered}");
    }

    #[test]
    fn refuses_bad_texels() {
        assert!(EnvironmentImage::new(0, 4, vec![], 1.0, 0.0).is_err());
        assert!(EnvironmentImage::new(2, 2, vec![[0.0; 3]; 3], 1.0, 0.0).is_err());
        assert!(EnvironmentImage::new(1, 1, vec![[f32::NAN; 3]], 1.0, 0.0).is_err());
        assert!(EnvironmentImage::new(1, 1, vec![[-1.0; 3]], 1.0, 0.0).is_err());
        assert!(EnvironmentImage::new(1, 1, vec![[1.0; 3]], f32::INFINITY, 0.0).is_err());
        assert!(EnvironmentImage::new(1, 1, vec![[1.0; 3]], 1.0, 0.0).is_ok());
    }

    proptest! {
        #[test]
        fn lookups_stay_inside_the_range_of_the_texels(
            x in -1f32..1.0, y in -1f32..1.0, z in -1f32..1.0, rotation in -720f64..720.0
        ) {
            prop_assume!(Vec3::new(x, y, z).length() > 1e-3);
            let image = uneven(9, 5, rotation);
            let d = Vec3::new(x, y, z).normalize();
            let radiance = image.radiance(d);
            prop_assert!(radiance.min_element() >= 0.0 && radiance.max_element() <= 1.5 * 42.0);
            prop_assert!(image.pdf(d).is_finite() && image.pdf(d) >= 0.0);
        }

        #[test]
        fn any_numbers_give_a_direction_or_nothing(a in 0f32..1.0, b in 0f32..1.0) {
            let image = uneven(9, 5, 10.0);
            if let Some(sample) = image.sample([a, b]) {
                prop_assert!(sample.pdf > 0.0 && sample.pdf.is_finite());
                prop_assert!(sample.wi.is_finite());
            }
        }
    }
}

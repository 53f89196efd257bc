//! Colour of thermal radiation by temperature, from a table.

use super::observer::{rgb_of_xyz, xyz};
use glam::Vec3;
use pileus_math::elementary::{exp, ln};
use pileus_math::luminance;
use std::sync::OnceLock;

/// Below this temperature nothing is given off, kelvin: the luminance is some 1e-13 of that at 2000
/// K.
pub(crate) const COLDEST_KELVIN: f64 = 500.0;
/// The highest temperature of black bodies, kelvin: hotter ones emit what this one does.
pub const HOTTEST_KELVIN: f64 = 20_000.0;
/// Draper's point, kelvin, rounded: below it no body is seen to glow.
const DRAPER: f64 = 800.0;

/// Intervals of the table.
const INTERVALS: usize = 1024;
/// Levels of the table of maxima.
const LEVELS: usize = 11;

/// How much a black body emits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BlackbodyRadiance {
    /// Planck's radiance, W/(m^2 sr): the luminance of the colour is that of the body over 683
    /// lm/W.
    #[default]
    Absolute,
    /// The body's colour at luminance 1, from 0 at 500 K rising linearly to 1 at 800 K (about
    /// Draper's point, below which nothing is seen to glow).
    Normalised,
}

/// Radiance of a black body at `kelvin` in linear Rec. 709: W/(m^2 sr) when absolute, of luminance
/// 1 when normalised.
///
/// Planck's law weighted by the CIE 1931 2 degree observer, without the factor of 683 lm/W. Black
/// below 500 K, constant above 20000 K. Where the colour lies outside the gamut (below some 1900 K)
/// its negative channels are set to zero and the others scaled so that the luminance stays that of
/// the body. From a table of 1024 intervals in `1 / sqrt(T)`, logarithmic in luminance: the
/// relative error against direct integration is below 2e-5 in luminance and below 3e-4 of the
/// largest channel.
pub fn blackbody(kelvin: f64, radiance: BlackbodyRadiance) -> Vec3 {
    // Negated so that NaN is black.
    if !(kelvin >= COLDEST_KELVIN) {
        return Vec3::ZERO;
    }
    let table = Table::get();
    let (i, f) = Table::position(kelvin);
    let color = table.color[i] + f * (table.color[i + 1] - table.color[i]);
    match radiance {
        BlackbodyRadiance::Normalised => color * glow(kelvin),
        BlackbodyRadiance::Absolute => color * table.luminance(i, f),
    }
}

/// Upper bound of every channel of [`blackbody`] between two temperatures.
pub(crate) fn blackbody_bound(low: f64, high: f64, radiance: BlackbodyRadiance) -> f32 {
    if !(high >= COLDEST_KELVIN) {
        return 0.0;
    }
    let table = Table::get();
    let (last, f) = Table::position(high);
    // Colours are linear between nodes: nodes bound them. Nodes run from cold to hot.
    let (first, _) = Table::position(low.max(COLDEST_KELVIN));
    let color = table.largest_color(first, last + 1);
    let factor = match radiance {
        BlackbodyRadiance::Normalised => glow(high),
        BlackbodyRadiance::Absolute => table.luminance(last, f),
    };
    color * factor * (1.0 + 1e-5)
}

/// From nothing at 500 K to all at 800 K.
fn glow(kelvin: f64) -> f32 {
    ((kelvin - COLDEST_KELVIN) / (DRAPER - COLDEST_KELVIN)).min(1.0) as f32
}

/// Nodes at equal steps of `1 / sqrt(T)`, from cold to hot: there the logarithm of radiance is
/// nearly a parabola (Wien), and hot colours are not too far apart.
struct Table {
    ln_luminance: Vec<f32>,
    /// Colour of luminance 1.
    color: Vec<Vec3>,
    /// Largest channel of nodes `i .. i + 2^level`.
    largest: [Vec<f32>; LEVELS],
}

impl Table {
    /// `1 / sqrt(T)` of the first and the last node.
    const COLD: f64 = 0.044_721_359_549_995_794;
    const HOT: f64 = 0.007_071_067_811_865_475;

    fn get() -> &'static Table {
        static TABLE: OnceLock<Table> = OnceLock::new();
        TABLE.get_or_init(Table::new)
    }

    fn new() -> Table {
        let mut table = Table {
            ln_luminance: Vec::with_capacity(INTERVALS + 1),
            color: Vec::with_capacity(INTERVALS + 1),
            largest: Default::default(),
        };
        for node in 0..=INTERVALS {
            let part = node as f64 / INTERVALS as f64;
            let x = Table::COLD + part * (Table::HOT - Table::COLD);
            let (luminance, color) = luminance_and_color(1.0 / (x * x));
            table.ln_luminance.push(ln(luminance as f32));
            table.color.push(color);
        }
        table.largest[0] = table.color.iter().map(|c| c.max_element()).collect();
        for level in 1..LEVELS {
            let below = &table.largest[level - 1];
            let half = 1 << (level - 1);
            let pairs = below.iter().zip(below.iter().skip(half));
            table.largest[level] = pairs.map(|(a, b)| a.max(*b)).collect();
        }
        table
    }

    /// Interval and place in it, in [0, 1], of a temperature of at least [`COLDEST_KELVIN`].
    fn position(kelvin: f64) -> (usize, f32) {
        let part = (Table::COLD - 1.0 / kelvin.sqrt()) / (Table::COLD - Table::HOT);
        let x = part.clamp(0.0, 1.0) * INTERVALS as f64;
        let i = (x as usize).min(INTERVALS - 1);
        (i, (x - i as f64) as f32)
    }

    fn luminance(&self, i: usize, f: f32) -> f32 {
        exp(self.ln_luminance[i] + f * (self.ln_luminance[i + 1] - self.ln_luminance[i]))
    }

    /// Largest channel of nodes `first..=last`.
    fn largest_color(&self, first: usize, last: usize) -> f32 {
        let level = (last + 1 - first).ilog2() as usize;
        let maxima = &self.largest[level];
        maxima[first].max(maxima[last + 1 - (1 << level)])
    }
}

/// Luminance over 683 lm/W, and the colour of luminance 1 within the gamut, by direct integration.
fn luminance_and_color(kelvin: f64) -> (f64, Vec3) {
    let xyz = xyz(kelvin);
    let rgb = rgb_of_xyz(xyz).map(|c| (c / xyz[1]).max(0.0) as f32);
    let color = Vec3::from_array(rgb);
    (xyz[1], color / luminance(color))
}

#[cfg(test)]
mod tests {
    use super::*;
    use BlackbodyRadiance::{Absolute, Normalised};
    use proptest::prelude::*;

    #[test]
    fn the_table_is_the_integral() {
        let (mut worst_luminance, mut worst_color) = (0.0f64, 0.0f64);
        for i in 0..5000 {
            let kelvin = 500.0 * 40.0f64.powf(f64::from(i) / 4999.0).min(40.0);
            let (luminance, color) = luminance_and_color(kelvin);
            let found = blackbody(kelvin, Absolute).as_dvec3();
            let y = found.dot(glam::DVec3::from_array(pileus_math::LUMINANCE));
            worst_luminance = worst_luminance.max((y / luminance - 1.0).abs());
            let exact = color.as_dvec3() * luminance;
            worst_color =
                worst_color.max((found - exact).abs().max_element() / exact.max_element());
        }
        assert!(worst_luminance < 2e-5, "{worst_luminance:e}");
        assert!(worst_color < 3e-4, "{worst_color:e}");
    }

    #[test]
    fn colours_run_from_red_over_white_to_blue() {
        let color = |kelvin| blackbody(kelvin, Normalised);
        let red = color(1000.0);
        assert!(red.x > 4.0 && red.y < 0.3 && red.z == 0.0, "{red}");
        // Near the white point the channels meet.
        let white = color(6500.0);
        assert!((white - 1.0).abs().max_element() < 0.06, "{white}");
        let blue = color(20_000.0);
        assert!(blue.z > 1.5 * blue.x, "{blue}");
        for kelvin in [800.0, 1500.0, 3000.0, 9000.0] {
            let luminance = luminance(color(kelvin));
            assert!((luminance - 1.0).abs() < 1e-5);
        }
        assert!((luminance(color(650.0)) - 0.5).abs() < 1e-5);
    }

    #[test]
    fn ends_are_what_is_promised() {
        for radiance in [Absolute, Normalised] {
            for kelvin in [f64::NAN, -1.0, 0.0, 499.9, f64::NEG_INFINITY] {
                assert_eq!(blackbody(kelvin, radiance), Vec3::ZERO);
            }
            assert_eq!(blackbody(20_000.0, radiance), blackbody(f64::INFINITY, radiance));
            assert_eq!(blackbody_bound(0.0, 499.0, radiance), 0.0);
        }
        assert!(blackbody(500.0, Absolute).x > 0.0);
    }

    proptest! {
        #[test]
        fn bounds_hold(a in 0.0..25e3f64, b in 0.0..25e3f64, u in 0.0..=1.0f64, normalised: bool) {
            let radiance = if normalised { Normalised } else { Absolute };
            let (low, high) = (a.min(b), a.max(b));
            let found = blackbody(low + u * (high - low), radiance).max_element();
            prop_assert!(found <= blackbody_bound(low, high, radiance));
        }

        #[test]
        fn bounds_are_tight(kelvin in 800.0..19e3f64, normalised: bool) {
            let radiance = if normalised { Normalised } else { Absolute };
            let bound = blackbody_bound(kelvin, kelvin, radiance);
            prop_assert!(bound <= 1.01 * blackbody(kelvin, radiance).max_element());
        }
    }
}

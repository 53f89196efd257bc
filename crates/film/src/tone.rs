//! From linear radiance to display values: exposure, tone curve, sRGB transfer.
//!
//! The filmic curve is AgX by Troy Sobotka (2022), whose picture formation keeps the hue of a blue
//! sky and lets bright cloud tops run softly into white. Numbers are those of the polynomial fit by
//! Benjamin Wrensch, "Minimal AgX Implementation" (iolite-engine.com, MIT licence): inset matrix,
//! log2 encoding from 10 stops below to 6.5 above middle grey 0.18, a sixth-order sigmoid (mean
//! squared error 3.7e-6 by his account), outset matrix. Between the last two comes his look
//! "punchy" (power, then saturation), tempered: see `LOOK_POWER`.

use std::sync::LazyLock;

/// How radiance becomes a display value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Curve {
    /// AgX: soft shoulder and toe, white at radiance 16.3, 6.5 stops above middle grey.
    #[default]
    Filmic,
    /// No curve: the sRGB transfer function, clipped at radiance 1.
    Srgb,
}

/// Exposure and curve of a preview.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToneMap {
    /// Radiance is multiplied by two to this power; 0 leaves it.
    pub exposure_stops: f32,
    /// The curve after exposure.
    pub curve: Curve,
}

/// Power of the look after the sigmoid; 1 is the neutral, flat AgX base and 1.35 its "punchy" look.
const LOOK_POWER: f32 = 1.2;
/// Saturation of the look; 1 is the neutral, flat AgX base and 1.4 its "punchy" look.
const LOOK_SATURATION: f32 = 1.2;

const INSET: [[f32; 3]; 3] = [
    [0.842_479_06, 0.078_433_6, 0.079_223_745],
    [0.042_328_242, 0.878_468_64, 0.079_166_13],
    [0.042_375_655, 0.078_433_6, 0.879_143],
];
const OUTSET: [[f32; 3]; 3] = [
    [1.196_879, -0.098_020_88, -0.099_029_74],
    [-0.052_896_85, 1.151_903_1, -0.098_961_18],
    [-0.052_971_635, -0.098_043_45, 1.151_073_7],
];
const MIN_STOPS: f32 = -12.473_93;
const MAX_STOPS: f32 = 4.026_069;

impl ToneMap {
    /// Display values in `[0, 1]`, encoded for an sRGB display, of linear Rec. 709 radiance.
    ///
    /// NaN and negative radiance count as black, infinite as brightest. Monotone on greys.
    pub fn apply(&self, rgb: [f32; 3]) -> [f32; 3] {
        let gain = libm::exp2f(self.exposure_stops);
        let exposed = rgb.map(|v| positive_up_to(v * gain, f32::MAX / 16.0));
        match self.curve {
            Curve::Filmic => agx(exposed),
            Curve::Srgb => exposed.map(srgb_encode),
        }
    }

    /// [`Self::apply`] rounded to 8 bits.
    pub fn apply_rgb8(&self, rgb: [f32; 3]) -> [u8; 3] {
        self.apply(rgb).map(|v| (v * 255.0).round() as u8)
    }
}

fn agx(rgb: [f32; 3]) -> [f32; 3] {
    static CURVE: LazyLock<Table> = LazyLock::new(|| Table::new(|x| power(sigmoid(x), LOOK_POWER)));
    // The curve yields values for a display of pure gamma 2.2.
    static DISPLAY: LazyLock<Table> = LazyLock::new(|| Table::new(|v| srgb_encode(power(v, 2.2))));
    let (curve, display): (&Table, &Table) = (&CURVE, &DISPLAY);
    let powered = multiply(&INSET, rgb).map(|v| {
        let stops = libm::log2f(v.max(1e-10)).clamp(MIN_STOPS, MAX_STOPS);
        curve.at((stops - MIN_STOPS) / (MAX_STOPS - MIN_STOPS))
    });
    let luma = 0.2126 * powered[0] + 0.7152 * powered[1] + 0.0722 * powered[2];
    let looked = powered.map(|v| luma + LOOK_SATURATION * (v - luma));
    multiply(&OUTSET, looked).map(|v| display.at(v))
}

/// Intervals of a [`Table`].
const INTERVALS: usize = 4096;

/// A function on [0, 1], linear between 4097 values: within 4e-6 for the two curves here, at the price
/// of no power.
struct Table([f32; INTERVALS + 1]);

impl Table {
    fn new(f: impl Fn(f32) -> f32) -> Table {
        Table(std::array::from_fn(|i| f(i as f32 / INTERVALS as f32)))
    }

    /// The value at `x`, clipped to [0, 1].
    fn at(&self, x: f32) -> f32 {
        let x = positive_up_to(x, 1.0) * INTERVALS as f32;
        let i = (x as usize).min(INTERVALS - 1);
        let (low, high) = (self.0[i], self.0[i + 1]);
        low + (high - low) * (x - i as f32)
    }
}

/// `v` in [0, 1] to a power from 0.4 to 2.2, within 1e-6: what is shown in 256 steps needs no more.
/// `libm::powf` takes 245 instructions, `exp2f` 40.
fn power(v: f32, exponent: f32) -> f32 {
    libm::exp2f(exponent * libm::log2f(v))
}

/// Wrensch's polynomial, clipped and scaled to reach 1 exactly.
fn sigmoid(x: f32) -> f32 {
    const COEFFICIENTS: [f32; 7] = [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232];
    const AT_ONE: f32 = 0.998_58;
    let value = COEFFICIENTS.iter().fold(0.0, |sum, c| sum * x + c);
    (value / AT_ONE).clamp(0.0, 1.0)
}

fn multiply(matrix: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Clips to `[0, limit]`; NaN becomes 0, unlike with `clamp`.
fn positive_up_to(v: f32, limit: f32) -> f32 {
    if v > 0.0 { v.min(limit) } else { 0.0 }
}

/// Linear value to sRGB (IEC 61966-2-1), clipped to `[0, 1]`.
pub fn srgb_encode(linear: f32) -> f32 {
    let v = positive_up_to(linear, 1.0);
    // The power rounds to just below one at one.
    if v <= 0.003_130_8 {
        12.92 * v
    } else if v < 1.0 {
        1.055 * power(v, 1.0 / 2.4) - 0.055
    } else {
        1.0
    }
}

/// sRGB (IEC 61966-2-1) to linear value, clipped to `[0, 1]`.
pub fn srgb_decode(encoded: f32) -> f32 {
    let v = positive_up_to(encoded, 1.0);
    if v <= 0.040_45 { v / 12.92 } else { libm::powf((v + 0.055) / 1.055, 2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_transfer() {
        // 18 % grey and the value of the standard's breakpoint.
        assert!((srgb_encode(0.18) - 0.461_356).abs() < 1e-5);
        assert!((srgb_encode(0.003_130_8) - 0.040_45).abs() < 1e-5);
        for byte in 0..=255u8 {
            let encoded = f32::from(byte) / 255.0;
            assert!((srgb_encode(srgb_decode(encoded)) - encoded).abs() < 1e-6);
        }
        assert_eq!(srgb_encode(f32::NAN), 0.0);
        assert_eq!(srgb_encode(f32::INFINITY), 1.0);
    }

    #[test]
    fn powers_are_close() {
        for exponent in [1.0 / 2.4, LOOK_POWER, 2.2] {
            for i in 0..=10_000 {
                let v = i as f32 / 10_000.0;
                let exact = f64::from(v).powf(f64::from(exponent));
                assert!((f64::from(power(v, exponent)) - exact).abs() < 1e-6, "{v} ^ {exponent}");
            }
        }
    }

    #[test]
    fn tables_are_close() {
        let curve = |x: f32| power(sigmoid(x), LOOK_POWER);
        let display = |v: f32| srgb_encode(power(v, 2.2));
        for f in [&curve as &dyn Fn(f32) -> f32, &display] {
            let table = Table::new(f);
            for i in 0..=100_003 {
                let x = i as f32 / 100_003.0;
                assert!((table.at(x) - f(x)).abs() < 4e-6, "{x}: {} {}", table.at(x), f(x));
            }
            assert_eq!(
                [table.at(-1.0), table.at(f32::NAN), table.at(2.0)],
                [f(0.0), f(0.0), f(1.0)]
            );
        }
    }

    #[test]
    fn curves_are_monotone_on_greys() {
        for curve in [Curve::Filmic, Curve::Srgb] {
            let tone = ToneMap { exposure_stops: 0.0, curve };
            let mut last = [0.0; 3];
            for i in -1600..=1600 {
                let shown = tone.apply([(i as f32 / 100.0).exp2(); 3]);
                for c in 0..3 {
                    assert!((0.0..=1.0).contains(&shown[c]));
                    assert!(shown[c] >= last[c] - 2e-6, "{curve:?} at 2^{}", i as f32 / 100.0);
                }
                // Greys stay grey to the eye.
                assert!((shown[0] - shown[1]).abs() < 2e-3 && (shown[2] - shown[1]).abs() < 2e-3);
                last = shown;
            }
            assert!(last.iter().all(|v| *v > 0.99));
        }
    }

    #[test]
    fn brightness_grows_with_exposure_for_colours() {
        let luma = |v: [f32; 3]| {
            let [r, g, b] = v.map(srgb_decode);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        for colour in [[0.25, 0.45, 1.0], [1.0, 0.35, 0.08], [0.05, 0.8, 0.1], [1.0, 0.9, 0.8]] {
            let mut last = 0.0;
            for i in -80..=80 {
                let tone = ToneMap { exposure_stops: i as f32 / 10.0, curve: Curve::Filmic };
                let now = luma(tone.apply(colour));
                assert!(now >= last - 1e-5, "{colour:?} at {} stops", tone.exposure_stops);
                last = now;
            }
        }
    }

    #[test]
    fn filmic_keeps_middle_grey_and_rolls_off() {
        let shown = |v: f32| ToneMap::default().apply([v; 3])[1];
        // Middle grey within a third of a stop of where sRGB shows it.
        let grey = srgb_decode(shown(0.18));
        assert!((grey / 0.18).log2().abs() < 1.0 / 3.0, "{grey}");
        assert!(shown(1.0) < 0.85 && shown(8.0) > 0.93 && shown(8.0) < shown(16.0));
        assert_eq!(ToneMap::default().apply_rgb8([0.0; 3]), [0; 3]);
        assert_eq!(ToneMap::default().apply_rgb8([f32::NAN, -1.0, f32::NEG_INFINITY]), [0; 3]);
        assert_eq!(ToneMap::default().apply_rgb8([f32::INFINITY; 3]), [255; 3]);
        // A blue sky stays blue.
        let [r, g, b] = ToneMap::default().apply([0.2, 0.4, 0.9]);
        assert!(r < g && g < b);
    }

    #[test]
    fn one_stop_doubles() {
        let tone = ToneMap { exposure_stops: 1.0, curve: Curve::Srgb };
        assert_eq!(tone.apply([0.1, 0.2, 0.3]), [0.2, 0.4, 0.6].map(srgb_encode));
    }
}

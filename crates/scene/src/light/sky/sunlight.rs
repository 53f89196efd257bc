//! Sunlight through a clear atmosphere.
//!
//! Source: Preetham, Shirley and Smits, "A practical analytic model for daylight", SIGGRAPH 1999,
//! appendix 1 (after Iqbal, "An introduction to solar radiation", 1983): Rayleigh scattering,
//! aerosols by Ångström's formula, ozone, mixed gases and water vapour.

use glam::DVec3;
use libm::pow;
use pileus_media::emission::{rgb_of_xyz, xyz_of_spectrum};

/// Illuminance by the sun above the atmosphere at mean distance, lux (Darula, Kittler and Gueymard,
/// "Reference luminous solar constant and solar luminance for illuminance calculations", 2005).
pub(super) const LUMINOUS_SOLAR_CONSTANT: f64 = 133_100.0;
/// Lumens per watt of the convention that radiance is weighted by the observer alone.
pub(super) const LUMENS_PER_WATT: f64 = 683.0;

/// Ozone, cm at normal temperature and pressure.
const OZONE_CM: f64 = 0.35;
/// Precipitable water vapour, cm.
const WATER_CM: f64 = 2.0;
/// Ångström's exponent: the mix of aerosol sizes.
const AEROSOL_EXPONENT: f64 = 1.3;

/// Irradiance on a plane that faces the sun, linear Rec. 709 in W/m^2 weighted by the observer: its
/// luminance times 683 lm/W is the illuminance in lux.
///
/// `elevation` in degrees above the horizon, at least 0; `turbidity` from 1. Colours outside the
/// gamut (a sun on the horizon is redder than Rec. 709 can say) keep their luminance: negative
/// channels become 0, the others are scaled.
pub(super) fn sunlight(elevation: f64, turbidity: f64) -> DVec3 {
    let above = xyz_of_spectrum(solar_spectrum)[1];
    let scale = LUMINOUS_SOLAR_CONSTANT / (LUMENS_PER_WATT * above);
    let mass = relative_optical_mass(elevation);
    let xyz = xyz_of_spectrum(|nm| scale * solar_spectrum(nm) * transmittance(nm, mass, turbidity));
    let clipped = DVec3::from_array(rgb_of_xyz(xyz)).max(DVec3::ZERO);
    let luminance = clipped.dot(LUMINANCE);
    if luminance > 0.0 { clipped * (xyz[1] / luminance) } else { DVec3::ZERO }
}

/// Share of each linear Rec. 709 channel in the luminance.
pub(super) const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Air between the observer and the sun as a multiple of that overhead (Kasten 1966); 1 at 90
/// degrees, some 35 on the horizon.
fn relative_optical_mass(elevation: f64) -> f64 {
    let zenith = 90.0 - elevation;
    1.0 / (libm::cos(zenith.to_radians()).max(0.0) + 0.15 * pow(93.885 - zenith, -1.253))
}

/// Share of sunlight of a wavelength in nanometres that reaches the ground unscattered.
fn transmittance(nm: f64, mass: f64, turbidity: f64) -> f64 {
    let micrometres = nm * 1e-3;
    let rayleigh = 0.008_735 * pow(micrometres, -4.08);
    let beta = (0.046_083_658_220_5 * turbidity - 0.045_860_259_285_22).max(0.0);
    let aerosol = beta * pow(micrometres, -AEROSOL_EXPONENT);
    let ozone = at(&OZONE, nm) * OZONE_CM;
    let gas_mass = at(&MIXED_GASES, nm) * mass;
    let gases = 1.41 * gas_mass / pow(1.0 + 118.93 * gas_mass, 0.45);
    let water_mass = at(&WATER, nm) * WATER_CM * mass;
    let water = 0.2385 * water_mass / pow(1.0 + 20.07 * water_mass, 0.45);
    libm::exp(-mass * (rayleigh + aerosol + ozone) - gases - water)
}

/// Relative spectral radiance of the sun above the atmosphere.
fn solar_spectrum(nm: f64) -> f64 {
    let position = ((nm - 380.0) / 10.0).clamp(0.0, (SOLAR.len() - 1) as f64);
    let i = (position as usize).min(SOLAR.len() - 2);
    SOLAR[i] + (position - i as f64) * (SOLAR[i + 1] - SOLAR[i])
}

/// A table of (nanometres, value) in ascending order, interpolated linearly; 0 outside.
fn at(table: &[(f64, f64)], nm: f64) -> f64 {
    table
        .windows(2)
        .find_map(|pair| match *pair {
            [(a, from), (b, to)] if a <= nm && nm <= b => {
                Some(from + (nm - a) / (b - a) * (to - from))
            }
            _ => None,
        })
        .unwrap_or(0.0)
}

/// Radiance of the sun at 380, 390, ..., 750 nm, W/(cm^2 um sr); the paper's table 2.
#[rustfmt::skip]
const SOLAR: [f64; 38] = [
    1655.9, 1623.37, 2112.75, 2588.82, 2582.91, 2423.23, 2676.05, 2965.83, 3054.54, 3005.75,
    3066.37, 2883.04, 2871.21, 2782.5, 2710.06, 2723.36, 2636.13, 2550.38, 2506.02, 2531.16,
    2535.59, 2513.42, 2463.15, 2417.32, 2368.53, 2321.21, 2282.77, 2233.98, 2197.02, 2152.67,
    2109.79, 2072.83, 2024.04, 1987.08, 1942.72, 1907.24, 1862.89, 1825.92,
];

/// Absorption by ozone, 1/cm, in the visible (Chappuis bands).
#[rustfmt::skip]
const OZONE: [(f64, f64); 50] = [
    (440.0, 0.0), (445.0, 0.003), (450.0, 0.003), (455.0, 0.004), (460.0, 0.006), (465.0, 0.008),
    (470.0, 0.009), (475.0, 0.012), (480.0, 0.014), (485.0, 0.017), (490.0, 0.021), (495.0, 0.025),
    (500.0, 0.03), (505.0, 0.035), (510.0, 0.04), (515.0, 0.045), (520.0, 0.048), (525.0, 0.057),
    (530.0, 0.063), (535.0, 0.07), (540.0, 0.075), (545.0, 0.08), (550.0, 0.085), (555.0, 0.095),
    (560.0, 0.103), (565.0, 0.11), (570.0, 0.12), (575.0, 0.122), (580.0, 0.12), (585.0, 0.118),
    (590.0, 0.115), (595.0, 0.12), (600.0, 0.125), (605.0, 0.13), (610.0, 0.12), (620.0, 0.105),
    (630.0, 0.09), (640.0, 0.079), (650.0, 0.067), (660.0, 0.057), (670.0, 0.048), (680.0, 0.036),
    (690.0, 0.028), (700.0, 0.023), (710.0, 0.018), (720.0, 0.014), (730.0, 0.011), (740.0, 0.01),
    (750.0, 0.009), (790.0, 0.0),
];

/// Absorption by mixed gases, 1/km: the oxygen A band.
const MIXED_GASES: [(f64, f64); 4] = [(759.0, 0.0), (760.0, 3.0), (770.0, 0.21), (771.0, 0.0)];

/// Absorption by water vapour, 1/cm.
#[rustfmt::skip]
const WATER: [(f64, f64); 13] = [
    (689.0, 0.0), (690.0, 0.016), (700.0, 0.024), (710.0, 0.0125), (720.0, 1.0), (730.0, 0.87),
    (740.0, 0.061), (750.0, 0.001), (760.0, 1e-5), (770.0, 1e-5), (780.0, 6e-4), (790.0, 0.0175),
    (800.0, 0.036),
];

#[cfg(test)]
mod tests {
    use super::*;
    use pileus_media::emission::{BlackbodyRadiance, blackbody};

    /// Kasten's table (1966): 1 overhead, 2 at 30 degrees, 5.6 at 10, 10.4 at 5, some 36 at 0.
    #[test]
    fn optical_mass_is_kastens() {
        for (elevation, mass) in [(90.0, 1.0), (30.0, 1.995), (10.0, 5.60), (5.0, 10.40)] {
            let found = relative_optical_mass(elevation);
            assert!((found / mass - 1.0).abs() < 0.01, "{elevation}: {found}");
        }
        assert!((33.0..40.0).contains(&relative_optical_mass(0.0)));
    }

    /// The sun above the atmosphere has about the colour of a black body at its effective
    /// temperature, 5772 K, and its table with the paper's solid angle of 6.8e-5 sr gives the
    /// luminous solar constant within a tenth.
    #[test]
    fn the_spectrum_is_the_suns() {
        let xyz = xyz_of_spectrum(solar_spectrum);
        let y = xyz[1];
        let rgb = DVec3::from_array(rgb_of_xyz(xyz)) / y;
        let black = blackbody(5772.0, BlackbodyRadiance::Normalised).as_dvec3();
        assert!((rgb - black).abs().max_element() < 0.1, "{rgb} {black}");
        // W/(cm^2 um sr) is 10 W/(m^2 nm sr).
        let lux = y * 10.0 * 6.8e-5 * LUMENS_PER_WATT;
        assert!((lux / LUMINOUS_SOLAR_CONSTANT - 1.0).abs() < 0.1, "{lux}");
    }

    /// Pure air lets 90 % of green light pass from overhead (Rayleigh depth 0.098 at 550 nm,
    /// Bucholtz 1995), and haze dims blue more than red.
    #[test]
    fn air_is_as_clear_as_published() {
        let rayleigh_and_ozone: f64 = 0.098 + 0.085 * 0.35;
        let found = transmittance(550.0, 1.0, 0.5);
        assert!((found - (-rayleigh_and_ozone).exp()).abs() < 0.01, "{found}");
        assert!(transmittance(450.0, 2.0, 4.0) < transmittance(650.0, 2.0, 4.0));
    }

    #[test]
    fn light_falls_and_reddens_with_the_sun() {
        for turbidity in [1.0, 1.7, 3.0, 6.0, 10.0] {
            let mut before = sunlight(90.0, turbidity);
            assert!(before.min_element() > 0.0);
            for step in 1..=1800 {
                let now = sunlight(90.0 - 0.05 * f64::from(step), turbidity);
                assert!(now.is_finite() && now.min_element() >= 0.0);
                let (bright, was) = (now.dot(LUMINANCE), before.dot(LUMINANCE));
                assert!(bright > 0.0 && bright < was, "{turbidity} {step}");
                assert!(bright > 0.5 * was, "a jump: {turbidity} {step}");
                assert!(now.z * before.x <= before.z * now.x * (1.0 + 1e-9));
                before = now;
            }
        }
    }
}

//! From Planck's law to linear Rec. 709: the CIE 1931 observer, by direct integration.

/// Shortest wavelength of the colour matching functions, nanometres.
const FIRST_NM: f64 = 360.0;
/// Step between wavelengths of the colour matching functions, nanometres.
const STEP_NM: f64 = 5.0;

/// First radiation constant for radiance, `2 h c^2`, W m^2/sr (SI 2019, exact).
const C1L: f64 = 1.191_042_972_397_188_4e-16;
/// Second radiation constant, `h c / k`, m K (SI 2019, exact).
const C2: f64 = 1.438_776_877_503_933_3e-2;

/// Linear Rec. 709 (ITU-R BT.709 primaries, white D65) of CIE XYZ; IEC 61966-2-1.
const RGB_OF_XYZ: [[f64; 3]; 3] = [
    [3.240_454_2, -1.537_138_5, -0.498_531_4],
    [-0.969_266_0, 1.876_010_8, 0.041_556_0],
    [0.055_643_4, -0.204_025_9, 1.057_225_2],
];

/// CIE XYZ of a black body at `kelvin`, W/(m^2 sr): spectral radiance weighted by the observer,
/// without the factor of 683 lm/W, so that Y times 683 lm/W is its luminance in cd/m^2. The sum
/// over 5 nm steps from 360 to 830 nm, by which CIE 15 defines tristimulus values.
pub(crate) fn xyz(kelvin: f64) -> [f64; 3] {
    xyz_of_spectrum(|nm| {
        let metres = nm * 1e-9;
        let squared = metres * metres;
        C1L / (squared * squared * metres) / (exp(C2 / (metres * kelvin)) - 1.0) * 1e-9
    })
}

/// CIE XYZ of a spectrum, a function of the wavelength in nanometres whose values are per
/// nanometre: weighted by the CIE 1931 2 degree observer, without the factor of 683 lm/W. Of
/// spectral radiance, Y times 683 lm/W is the luminance in cd/m^2; of spectral irradiance, the
/// illuminance in lux. The sum over 5 nm steps from 360 to 830 nm.
pub fn xyz_of_spectrum(spectrum: impl Fn(f64) -> f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (i, observer) in CIE_1931.iter().enumerate() {
        let value = spectrum(FIRST_NM + STEP_NM * i as f64);
        for channel in 0..3 {
            sum[channel] += value * observer[channel] * STEP_NM;
        }
    }
    sum
}

/// Linear Rec. 709 of CIE XYZ; negative where the colour lies outside the gamut.
pub fn rgb_of_xyz(xyz: [f64; 3]) -> [f64; 3] {
    RGB_OF_XYZ.map(|row| row.iter().zip(xyz).map(|(a, b)| a * b).sum())
}

/// `e^x` for `x` in [0, 700], the same bits on every machine: nine terms of the series at
/// `x / 4096`, squared twelve times; relative error below 1e-12.
fn exp(x: f64) -> f64 {
    let r = x / 4096.0;
    let mut series = 1.0;
    for k in (1..=9).rev() {
        series = 1.0 + series * r / f64::from(k);
    }
    (0..12).fold(series, |power, _| power * power)
}

/// Colour matching functions of the CIE 1931 2 degree standard observer at 360, 365, ..., 830 nm
/// (ISO/CIE 11664-1, table of 5 nm).
#[rustfmt::skip]
const CIE_1931: [[f64; 3]; 95] = [
    [0.000_129_9, 0.000_003_917, 0.000_606_1],
    [0.000_232_1, 0.000_006_965, 0.001_086],
    [0.000_414_9, 0.000_012_39, 0.001_946],
    [0.000_741_6, 0.000_022_02, 0.003_486],
    [0.001_368, 0.000_039, 0.006_450_001],
    [0.002_236, 0.000_064, 0.010_549_99],
    [0.004_243, 0.000_12, 0.020_050_01],
    [0.007_65, 0.000_217, 0.036_21],
    [0.014_31, 0.000_396, 0.067_850_01],
    [0.023_19, 0.000_64, 0.110_2],
    [0.043_51, 0.001_21, 0.207_4],
    [0.077_63, 0.002_18, 0.371_3],
    [0.134_38, 0.004, 0.645_6],
    [0.214_77, 0.007_3, 1.039_050_1],
    [0.283_9, 0.011_6, 1.385_6],
    [0.328_5, 0.016_84, 1.622_96],
    [0.348_28, 0.023, 1.747_06],
    [0.348_06, 0.029_8, 1.782_6],
    [0.336_2, 0.038, 1.772_11],
    [0.318_7, 0.048, 1.744_1],
    [0.290_8, 0.06, 1.669_2],
    [0.251_1, 0.073_9, 1.528_1],
    [0.195_36, 0.090_98, 1.287_64],
    [0.142_1, 0.112_6, 1.041_9],
    [0.095_64, 0.139_02, 0.812_950_1],
    [0.057_950_01, 0.169_3, 0.616_2],
    [0.032_01, 0.208_02, 0.465_18],
    [0.014_7, 0.258_6, 0.353_3],
    [0.004_9, 0.323, 0.272],
    [0.002_4, 0.407_3, 0.212_3],
    [0.009_3, 0.503, 0.158_2],
    [0.029_1, 0.608_2, 0.111_7],
    [0.063_27, 0.71, 0.078_249_99],
    [0.109_6, 0.793_2, 0.057_250_01],
    [0.165_5, 0.862, 0.042_16],
    [0.225_749_9, 0.914_850_1, 0.029_84],
    [0.290_4, 0.954, 0.020_3],
    [0.359_7, 0.980_3, 0.013_4],
    [0.433_449_9, 0.994_950_1, 0.008_749_999],
    [0.512_050_1, 1.0, 0.005_749_999],
    [0.594_5, 0.995, 0.003_9],
    [0.678_4, 0.978_6, 0.002_749_999],
    [0.762_1, 0.952, 0.002_1],
    [0.842_5, 0.915_4, 0.001_8],
    [0.916_3, 0.87, 0.001_650_001],
    [0.978_6, 0.816_3, 0.001_4],
    [1.026_3, 0.757, 0.001_1],
    [1.056_7, 0.694_9, 0.001],
    [1.062_2, 0.631, 0.000_8],
    [1.045_6, 0.566_8, 0.000_6],
    [1.002_6, 0.503, 0.000_34],
    [0.938_4, 0.441_2, 0.000_24],
    [0.854_449_9, 0.381, 0.000_19],
    [0.751_4, 0.321, 0.000_1],
    [0.642_4, 0.265, 0.000_049_999_99],
    [0.541_9, 0.217, 0.000_03],
    [0.447_9, 0.175, 0.000_02],
    [0.360_8, 0.138_2, 0.000_01],
    [0.283_5, 0.107, 0.0],
    [0.218_7, 0.081_6, 0.0],
    [0.164_9, 0.061, 0.0],
    [0.121_2, 0.044_58, 0.0],
    [0.087_4, 0.032, 0.0],
    [0.063_6, 0.023_2, 0.0],
    [0.046_77, 0.017, 0.0],
    [0.032_9, 0.011_92, 0.0],
    [0.022_7, 0.008_21, 0.0],
    [0.015_84, 0.005_723, 0.0],
    [0.011_359_16, 0.004_102, 0.0],
    [0.008_110_916, 0.002_929, 0.0],
    [0.005_790_346, 0.002_091, 0.0],
    [0.004_109_457, 0.001_484, 0.0],
    [0.002_899_327, 0.001_047, 0.0],
    [0.002_049_19, 0.000_74, 0.0],
    [0.001_439_971, 0.000_52, 0.0],
    [0.000_999_949_3, 0.000_361_1, 0.0],
    [0.000_690_078_6, 0.000_249_2, 0.0],
    [0.000_476_021_3, 0.000_171_9, 0.0],
    [0.000_332_301_1, 0.000_12, 0.0],
    [0.000_234_826_1, 0.000_084_8, 0.0],
    [0.000_166_150_5, 0.000_06, 0.0],
    [0.000_117_413, 0.000_042_4, 0.0],
    [0.000_083_075_27, 0.000_03, 0.0],
    [0.000_058_706_52, 0.000_021_2, 0.0],
    [0.000_041_509_94, 0.000_014_99, 0.0],
    [0.000_029_353_26, 0.000_010_6, 0.0],
    [0.000_020_673_83, 0.000_007_465_7, 0.0],
    [0.000_014_559_77, 0.000_005_257_8, 0.0],
    [0.000_010_253_98, 0.000_003_702_9, 0.0],
    [0.000_007_221_456, 0.000_002_607_8, 0.0],
    [0.000_005_085_868, 0.000_001_836_6, 0.0],
    [0.000_003_581_652, 0.000_001_293_4, 0.0],
    [0.000_002_522_525, 0.000_000_910_93, 0.0],
    [0.000_001_776_509, 0.000_000_641_53, 0.0],
    [0.000_001_251_141, 0.000_000_451_81, 0.0],
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_accurate() {
        for i in 0..=1000 {
            let x = 0.16 * f64::from(i);
            assert!((exp(x) / x.exp() - 1.0).abs() < 1e-12, "{x}");
        }
    }

    /// The functions are normalised to equal sums: equal energy is white.
    #[test]
    fn equal_energy_is_white() {
        let sum = |channel: usize| CIE_1931.iter().map(|row| row[channel]).sum::<f64>();
        for channel in 0..3 {
            assert!((sum(channel) - 21.3714).abs() < 1e-2, "{channel}: {}", sum(channel));
        }
    }

    /// Until 1979 the candela was defined by the luminance of a black body at the freezing point of
    /// platinum, 60 cd/cm^2; its temperature is 2041.4 K on ITS-90.
    #[test]
    fn platinum_has_the_luminance_of_the_old_candela() {
        let luminance = 683.0 * xyz(2041.4)[1];
        assert!((luminance / 6.0e5 - 1.0).abs() < 0.01, "{luminance}");
    }

    /// Chromaticity of CIE illuminant A, a black body at 2848 K with a second constant of 1.435e-2
    /// m K (CIE 15).
    #[test]
    fn illuminant_a_has_its_chromaticity() {
        let [x, y, z] = xyz(2848.0 * C2 / 1.435e-2);
        let sum = x + y + z;
        assert!((x / sum - 0.447_58).abs() < 5e-5, "{}", x / sum);
        assert!((y / sum - 0.407_45).abs() < 5e-5, "{}", y / sum);
    }

    /// D65 is white by definition.
    #[test]
    fn d65_is_white_in_rec_709() {
        let rgb = rgb_of_xyz([0.950_47, 1.0, 1.088_83]);
        assert!(rgb.iter().all(|c| (c - 1.0).abs() < 1e-4), "{rgb:?}");
        let y: f64 = pileus_math::LUMINANCE.iter().sum();
        assert!((y - 1.0).abs() < 1e-6);
    }
}

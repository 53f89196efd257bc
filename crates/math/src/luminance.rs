//! Luminance of linear Rec. 709 colours.

use glam::Vec3;

/// Share of each linear Rec. 709 channel in the luminance [ITU-R BT.709-6, item 3.2].
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Luminance of a linear Rec. 709 colour, in the colour's unit: white of one has one.
#[inline(always)]
pub fn luminance(rgb: Vec3) -> f32 {
    const SHARES: Vec3 = Vec3::new(LUMINANCE[0] as f32, LUMINANCE[1] as f32, LUMINANCE[2] as f32);
    rgb.dot(SHARES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_has_its_own_luminance_and_channels_their_shares() {
        assert!((luminance(Vec3::ONE) - 1.0).abs() < 1e-6);
        assert!((LUMINANCE.iter().sum::<f64>() - 1.0).abs() < 1e-15);
        assert_eq!([Vec3::X, Vec3::Y, Vec3::Z].map(luminance), [0.2126, 0.7152, 0.0722]);
    }
}

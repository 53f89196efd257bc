//! Pictures of a difference.

use pileus_film::{Image, srgb_decode};

use crate::error::Error;
use crate::pair::{check_size, planes};

/// The signed difference a - b as channels R, G, B, placed where `a` lies.
///
/// # Errors
/// Different sizes or no colour channels.
pub fn difference_image(a: &Image, b: &Image) -> Result<Image, Error> {
    check_size(a, b)?;
    let (pa, pb) = (planes(a, "first image")?, planes(b, "second image")?);
    let mut image = Image::without_channels(a.data_window())?;
    image.place(a.data_window().x, a.data_window().y, a.display_window());
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        image.add_channel(name, pa[c].iter().zip(pb[c]).map(|(a, b)| a - b).collect())?;
    }
    Ok(image)
}

/// A signed difference made visible: no difference is middle grey, brighter means positive.
///
/// `gain` multiplies the difference; plus and minus 0.5 after it reach white and black on the sRGB
/// scale. Meant for [`pileus_film::write_png`] with the curve `Srgb`.
///
/// # Errors
/// No colour channels.
pub fn difference_view(difference: &Image, gain: f32) -> Result<Image, Error> {
    let signed = planes(difference, "difference")?;
    let mut image = Image::without_channels(difference.data_window())?;
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        let shown = signed[c].iter().map(|d| srgb_decode(0.5 + gain * d)).collect();
        image.add_channel(name, shown)?;
    }
    Ok(image)
}

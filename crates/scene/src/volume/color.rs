//! Colours as users write them, held against their limits.

use crate::error::{Error, Place};
use crate::spec::volume_spec::Rgb;

pub(super) fn channels(
    rgb: Rgb,
    range: std::ops::RangeInclusive<f64>,
    place: &dyn Fn() -> Place,
    what: &str,
) -> Result<[f64; 3], Error> {
    let channels = rgb.channels();
    if channels.iter().all(|c| range.contains(c)) {
        return Ok(channels);
    }
    Err(Error::invalid(
        place(),
        format!("{what} is {channels:?}"),
        format!("use numbers between {} and {}", range.start(), range.end()),
    ))
}

pub(super) fn constant_albedo(rgb: Rgb, place: &dyn Fn(&str) -> Place) -> Result<[f32; 3], Error> {
    let channels = channels(rgb, 0.0..=1.0, &|| place("/albedo"), "albedo")?;
    Ok(channels.map(|c| c as f32))
}

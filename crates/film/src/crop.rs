//! The part of an image that a film has.

use crate::error::Error;

/// Most pixels a film may have, 2^28 (16384 x 16384; 138 GiB of sums).
pub const MAX_PIXELS: u64 = 1 << 28;

/// The part of the full image that is rendered, in pixels from its top left corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// Left column.
    pub x0: u32,
    /// Top row.
    pub y0: u32,
    /// Columns, at least one.
    pub width: u32,
    /// Rows, at least one.
    pub height: u32,
}

/// The window that is rendered of an image of `resolution`.
pub(crate) fn checked_window(resolution: [u32; 2], crop: Option<Crop>) -> Result<Crop, Error> {
    let [width, height] = resolution;
    let crop = crop.unwrap_or(Crop { x0: 0, y0: 0, width, height });
    let fits = |start: u32, size: u32, full: u32| {
        size > 0 && start.checked_add(size).is_some_and(|end| end <= full)
    };
    if width == 0 || height == 0 || width > i32::MAX as u32 || height > i32::MAX as u32 {
        return Err(Error::invalid(
            "film",
            format!("resolution {width} x {height}"),
            "both sides must be at least one pixel and below 2^31",
        ));
    }
    if !fits(crop.x0, crop.width, width) || !fits(crop.y0, crop.height, height) {
        return Err(Error::invalid(
            "film",
            format!(
                "crop window {} x {} at ({}, {}) does not lie inside {width} x {height}",
                crop.width, crop.height, crop.x0, crop.y0
            ),
            "give a window of at least one pixel within the resolution",
        ));
    }
    let pixels = u64::from(crop.width) * u64::from(crop.height);
    if pixels > MAX_PIXELS {
        return Err(Error::too_large(
            "film",
            format!("{} x {} pixels exceed the limit of 2^28", crop.width, crop.height),
            "render the image in crop windows",
        ));
    }
    Ok(crop)
}

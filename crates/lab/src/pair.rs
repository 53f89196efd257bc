//! Two images of equal size, seen as colour.

use pileus_film::Image;

use crate::error::Error;

/// The colour planes of one image: R, G, B, or grey three times.
pub(crate) type Planes<'a> = [&'a [f32]; 3];

/// Colour planes of an image that is called `role` in errors.
pub(crate) fn planes<'a>(image: &'a Image, role: &'static str) -> Result<Planes<'a>, Error> {
    image.rgb_planes().ok_or_else(|| Error::Channels {
        image: role,
        names: image.channels().iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", "),
    })
}

/// Refuses images of different sizes.
pub(crate) fn check_size(a: &Image, b: &Image) -> Result<(), Error> {
    let size = |image: &Image| [image.width(), image.height()];
    if size(a) == size(b) { Ok(()) } else { Err(Error::Size { a: size(a), b: size(b) }) }
}

/// Whether all three channels of a pixel are finite.
pub(crate) fn finite(planes: &Planes<'_>, i: usize) -> bool {
    planes.iter().all(|plane| plane[i].is_finite())
}

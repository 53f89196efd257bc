//! Size, window and filter of the image.

use pileus_film::{Crop, Filter};

use super::places::Places;
use crate::failure::Failure;
use crate::job::{FilmSpec, FilterKind};

/// Width and height, if the job says so; their product is no more than an image may have.
pub(super) fn resolution(film: &FilmSpec, places: &Places) -> Result<Option<[u32; 2]>, Failure> {
    let pixels = film.resolution.map(|[w, h]| u64::from(w) * u64::from(h));
    if pixels.is_some_and(|n| n == 0 || n > pileus_film::MAX_PIXELS) {
        return Err(places.invalid(
            "/film/resolution",
            format!("the image has {} pixels", pixels.unwrap_or(0)),
            "use a width and a height of at least 1, and fewer than 2^28 pixels",
        ));
    }
    Ok(film.resolution)
}

/// The window that is rendered; inside the resolution, where the job gives one. `by_option`: the
/// command line has named it.
pub(super) fn crop(
    film: &FilmSpec,
    by_option: bool,
    places: &Places,
) -> Result<Option<Crop>, Failure> {
    let Some([x0, y0, width, height]) = film.crop else { return Ok(None) };
    let inside = film.resolution.is_none_or(|[w, h]| {
        u64::from(x0) + u64::from(width) <= u64::from(w)
            && u64::from(y0) + u64::from(height) <= u64::from(h)
    });
    if width == 0 || height == 0 || !inside {
        let what = format!("the crop {:?} is empty or leaves the image", [x0, y0, width, height]);
        let remedy = "give left, top, width and height in pixels inside the resolution";
        if by_option {
            return Err(Failure::usage(what, remedy));
        }
        return Err(places.invalid("/film/crop", what, remedy));
    }
    Ok(Some(Crop { x0, y0, width, height }))
}

/// The pixel filter.
pub(super) fn filter(film: &FilmSpec, places: &Places) -> Result<Filter, Failure> {
    let spec = film.filter.clone().unwrap_or_default();
    let kind = spec.kind();
    let radius = spec.radius.unwrap_or(kind.default_radius());
    let filter = match kind {
        FilterKind::Box => Filter::Box { radius },
        FilterKind::BlackmanHarris => Filter::BlackmanHarris { radius },
    };
    filter.validate().map_err(|error| {
        places.invalid("/film/filter/radius", error.to_string(), "0.5 is one pixel")
    })?;
    Ok(filter)
}

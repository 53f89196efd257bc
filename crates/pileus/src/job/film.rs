//! Size and filter of the image.

use pileus_scene::option::{between, unit};
use pileus_scene::{options, whole};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::rules;

/// Smallest positive number that single precision has with all its digits.
pub(crate) const SMALLEST: f64 = 1.2e-38;

options! {
    /// Size and filter of the image.
    #[derive(Default)]
    pub struct FilmSpec {
        /// Width and height of the full image. Default: 640 pixels along the longer side in the
        /// aspect ratio of the glTF camera, 640 x 320 of a panorama, or 640 x 360.
        #[serde(deserialize_with = "whole::option_of_2")]
        #[schemars(extend("examples" = [[480, 270]]))]
        resolution: [u32; 2], rules::resolution, unit("pixels");
        /// The part that is rendered: left, top, width, height; null renders everything.
        #[serde(deserialize_with = "whole::option_of_4")]
        #[schemars(extend("default" = null))]
        crop: [u32; 4], rules::crop, unit("pixels");
        /// How a pixel weighs the image plane around its centre.
        filter: FilterSpec;
    }
}

options! {
    /// A pixel filter. Default: the box of one pixel, which is the plain average over its square.
    #[derive(Default)]
    pub struct FilterSpec {
        /// Its shape.
        #[serde(rename = "type")]
        kind: FilterKind = FilterKind::Box;
        /// Its half width. Default 0.5 for `box`, 1.5 for `blackman_harris`.
        radius: f32, between(SMALLEST, 64), unit("pixels");
    }
}

/// Shape of a pixel filter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FilterKind {
    /// Constant on a square.
    #[default]
    Box,
    /// The four-term Blackman-Harris window along both axes: smooth, without aliasing.
    BlackmanHarris,
}

impl FilterKind {
    /// Half width of a filter of this shape where none is given, pixels.
    pub const fn default_radius(self) -> f32 {
        match self {
            FilterKind::Box => 0.5,
            FilterKind::BlackmanHarris => 1.5,
        }
    }
}

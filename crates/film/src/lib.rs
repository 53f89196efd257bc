#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod atomic;
mod binned;
mod channel_sum;
mod checksum;
mod color_channels;
mod color_space;
mod crop;
mod error;
mod exr_header;
mod exr_read;
mod exr_write;
mod film;
mod filter;
mod guard;
mod image;
mod layer;
mod layer_set;
mod memory;
mod moments;
mod preview;
mod state;
mod tile;
mod tone;
mod turns;

pub use crate::atomic::{check_writable, remove_abandoned, write_atomically};
pub use crate::color_channels::{ColorChannels, color_channels};
pub use crate::color_space::{Chromaticities, ColorSpace, Remarks};
pub use crate::crop::{Crop, MAX_PIXELS};
pub use crate::error::Error;
pub use crate::exr_header::{ExrChannel, ExrHeader, ExrPart, read_exr_header};
pub use crate::exr_read::{read_exr, read_exr_color};
pub use crate::exr_write::{ExrCompression, ExrReport, ExrSettings, write_exr};
pub use crate::film::Film;
pub use crate::filter::Filter;
pub use crate::guard::{DecoderPanic, guarded};
pub use crate::image::{Channel, Image, MAX_CHANNELS, MAX_SAMPLES, MetaValue, Window};
pub use crate::layer::*;
pub use crate::memory::FilmMemory;
pub use crate::moments::{PixelMoments, PixelSample, REPLICATES};
pub use crate::preview::{png_bytes, preview_rgb8, write_png};
pub use crate::state::{MAX_STATE_HEADER, STATE_VERSION};
pub use crate::tile::Tile;
pub use crate::tone::{Curve, ToneMap, srgb_decode, srgb_encode};

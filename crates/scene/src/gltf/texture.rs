//! Textures of a glTF file: PNG and JPEG images from files, buffer views and data URIs.

use std::collections::HashMap;
use std::io::Cursor;
use std::sync::Arc;

use glam::{Mat2, Vec2};
use gltf::json::texture::{MagFilter, Sampler, WrappingMode};
use gltf::json::validation::Checked;
use image::{DynamicImage, ImageFormat, ImageReader};
use pileus_math::elementary::sin_cos_turn;
use serde::Deserialize;

use super::buffer::{Buffers, Resource};
use super::image_guard;
use crate::error::Error;
use crate::surface::{Image, Texels, Texture, Wrap, srgb_to_linear};

/// A reference to a texture (`textureInfo`).
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct TextureInfo {
    index: usize,
    #[serde(default, rename = "texCoord")]
    tex_coord: u32,
    /// Of normal textures only.
    #[serde(default = "one")]
    pub(crate) scale: f32,
    #[serde(default)]
    extensions: TextureExtensions,
}

fn one() -> f32 {
    1.0
}

#[derive(Debug, Clone, Default, Deserialize)]
struct TextureExtensions {
    #[serde(rename = "KHR_texture_transform")]
    transform: Option<Transform>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(default)]
struct Transform {
    offset: [f32; 2],
    rotation: f32,
    scale: [f32; 2],
    #[serde(rename = "texCoord")]
    tex_coord: Option<u32>,
}

impl Default for Transform {
    fn default() -> Self {
        Self { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2], tex_coord: None }
    }
}

/// Extensions that give textures an image in another format. A file may require them: what stops is
/// a texture in use that has no other image.
pub(crate) const IMAGE_FORMATS: [&str; 4] =
    ["EXT_texture_avif", "EXT_texture_webp", "KHR_texture_basisu", "MSFT_texture_dds"];

/// What the texels of an image mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Meaning {
    /// Colours, in sRGB.
    Color,
    /// Numbers, linear.
    Data,
}

/// Loads images; each is decoded once for each meaning.
pub(crate) struct Textures<'a> {
    buffers: &'a Buffers<'a>,
    images: HashMap<(usize, Meaning), Arc<Image>>,
    /// Texels of all images so far.
    texels: u64,
}

/// Largest width and height of an image.
const MAX_SIDE: u32 = 1 << 15;
/// Most texels of all images.
const MAX_TEXELS: u64 = 1 << 30;
/// Largest encoded image.
const MAX_FILE: u64 = 1 << 30;

impl<'a> Textures<'a> {
    pub(crate) fn new(buffers: &'a Buffers<'a>) -> Self {
        Self { buffers, images: HashMap::new(), texels: 0 }
    }

    /// The texture that `info`, which stands at `pointer`, refers to.
    pub(crate) fn load(
        &mut self,
        info: &TextureInfo,
        meaning: Meaning,
        pointer: &str,
    ) -> Result<Texture, Error> {
        let root = self.buffers.root;
        let place = || self.buffers.document.place(pointer);
        let Some(texture) = root.textures.get(info.index) else {
            return Err(Error::invalid(
                place(),
                format!("texture {} does not exist", info.index),
                "export the file again",
            ));
        };
        let transform = info.extensions.transform.clone().unwrap_or_default();
        let set = transform.tex_coord.unwrap_or(info.tex_coord);
        if set > 1 {
            return Err(Error::unsupported(
                place(),
                format!("the texture uses the set TEXCOORD_{set}"),
                "use the first or second set of texture coordinates",
            ));
        }
        let offset = Vec2::from_array(transform.offset);
        // By the example of KHR_texture_transform: counter-clockwise where the second coordinate
        // points down.
        let turns = (f64::from(transform.rotation) / std::f64::consts::TAU).rem_euclid(1.0);
        let (sin, cos) = sin_cos_turn(turns as f32);
        let [x, y] = transform.scale;
        let matrix = Mat2::from_cols(Vec2::new(cos, -sin) * x, Vec2::new(sin, cos) * y);
        if !(offset.is_finite() && matrix.is_finite()) {
            return Err(Error::invalid(
                place(),
                "the texture's transform is not finite",
                "correct its offset, rotation and scale",
            ));
        }
        let sampler = match texture.sampler {
            None => None,
            Some(index) => Some(root.samplers.get(index.value()).ok_or_else(|| {
                Error::invalid(
                    place(),
                    format!("sampler {} does not exist", index.value()),
                    "export the file again",
                )
            })?),
        };
        let source = texture.source.value();
        let image = self.image(source, info.index, meaning)?;
        let wrap = |mode: Option<Checked<WrappingMode>>| match mode {
            Some(Checked::Valid(WrappingMode::ClampToEdge)) => Wrap::Clamp,
            Some(Checked::Valid(WrappingMode::MirroredRepeat)) => Wrap::Mirror,
            _ => Wrap::Repeat,
        };
        let nearest = |sampler: &Sampler| {
            matches!(sampler.mag_filter, Some(Checked::Valid(MagFilter::Nearest)))
        };
        Ok(Texture {
            image,
            wrap: [wrap(sampler.map(|s| s.wrap_s)), wrap(sampler.map(|s| s.wrap_t))],
            nearest: sampler.is_some_and(nearest),
            set: set as usize,
            matrix,
            offset,
        })
    }

    fn image(
        &mut self,
        index: usize,
        texture: usize,
        meaning: Meaning,
    ) -> Result<Arc<Image>, Error> {
        if let Some(image) = self.images.get(&(index, meaning)) {
            return Ok(image.clone());
        }
        let document = self.buffers.document;
        let Some(image) = self.buffers.root.images.get(index) else {
            return Err(Error::unsupported(
                document.place(&format!("/textures/{texture}")),
                "the texture has no image in a format that is read",
                "export images as PNG or JPEG",
            ));
        };
        let pointer = format!("/images/{index}");
        let owned;
        let bytes = match (&image.uri, image.buffer_view) {
            (Some(uri), None) => {
                owned = match self.buffers.resource(uri, &format!("{pointer}/uri"))? {
                    Resource::Bytes(bytes) => bytes,
                    Resource::File(path) => self.buffers.whole_file(&path, MAX_FILE, &pointer)?,
                };
                owned.as_slice()
            }
            (None, Some(view)) => self.buffers.view(view.value(), &pointer)?.bytes,
            _ => {
                return Err(Error::invalid(
                    document.place(&pointer),
                    "the image has not exactly one of `uri` and `bufferView`",
                    "export the file again",
                ));
            }
        };
        let (decoded, texels) = self.decode(bytes, &pointer)?;
        let image = Arc::new(convert(decoded, meaning).ok_or_else(|| {
            Error::invalid(document.place(&pointer), "the image is empty", "export it again")
        })?);
        self.texels = texels;
        self.images.insert((index, meaning), image.clone());
        Ok(image)
    }

    /// The decoded image, and how many texels there are with it.
    fn decode(&self, bytes: &[u8], pointer: &str) -> Result<(DynamicImage, u64), Error> {
        let place = || self.buffers.document.place(pointer);
        let format = image::guess_format(bytes).ok();
        let Some(format) = format.filter(|f| matches!(f, ImageFormat::Png | ImageFormat::Jpeg))
        else {
            return Err(Error::unsupported(
                place(),
                "the image is neither PNG nor JPEG",
                "export images as PNG or JPEG",
            ));
        };
        let damaged = |error: String| {
            Error::invalid(
                place(),
                format!("the image cannot be decoded: {error}"),
                "export the image again, as PNG or JPEG",
            )
        };
        let mut limits = image::Limits::default();
        limits.max_image_width = Some(MAX_SIDE);
        limits.max_image_height = Some(MAX_SIDE);
        limits.max_alloc = Some(MAX_TEXELS * 8);
        let reader = || {
            let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
            reader.limits(limits.clone());
            reader
        };
        let (width, height) = image_guard::run(|| reader().into_dimensions()).map_err(damaged)?;
        let texels = self.texels.saturating_add(u64::from(width) * u64::from(height));
        if texels > MAX_TEXELS || width > MAX_SIDE || height > MAX_SIDE {
            return Err(Error::unsupported(
                place(),
                format!("the image has {width} x {height} pixels"),
                format!(
                    "use smaller images: up to {MAX_SIDE} pixels a side and {MAX_TEXELS} in all"
                ),
            ));
        }
        image_guard::check(bytes, format, width, height).map_err(damaged)?;
        Ok((image_guard::run(|| reader().decode()).map_err(damaged)?, texels))
    }
}

fn convert(image: DynamicImage, meaning: Meaning) -> Option<Image> {
    use DynamicImage::{ImageLuma16, ImageLumaA16, ImageRgb16, ImageRgba16};
    let (width, height) = (image.width(), image.height());
    let wide = matches!(image, ImageLuma16(_) | ImageLumaA16(_) | ImageRgb16(_) | ImageRgba16(_));
    let texels = if wide {
        let mut texels: Vec<[u16; 4]> = image.into_rgba16().pixels().map(|p| p.0).collect();
        if meaning == Meaning::Color {
            for channel in texels.iter_mut().flat_map(|texel| texel.iter_mut().take(3)) {
                let linear = srgb_to_linear(f32::from(*channel) / 65535.0);
                *channel = (linear * 65535.0).round() as u16;
            }
        }
        Texels::Sixteen(texels)
    } else {
        let texels = image.into_rgba8().pixels().map(|p| p.0).collect();
        Texels::Eight { texels, srgb: meaning == Meaning::Color }
    };
    Image::new(width, height, texels)
}

//! Images as named planes of 32-bit floats.

use crate::color_channels::color_channels;
use crate::error::Error;

/// Most values an image may have over all channels, 2^30 (4 GiB).
pub const MAX_SAMPLES: u64 = 1 << 30;
/// Most channels of an image.
pub const MAX_CHANNELS: usize = 1024;

/// A rectangle in pixels; EXR calls them windows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Left column.
    pub x: i32,
    /// Top row.
    pub y: i32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A plane of values, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// `R`, `G`, `B`, `A`, `Y`, or `layer.name`.
    pub name: String,
    /// Width x height values.
    pub samples: Vec<f32>,
}

/// A value of the metadata.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum MetaValue {
    /// UTF-8 text.
    Text(String),
    /// 32-bit float.
    F32(f32),
    /// 64-bit float.
    F64(f64),
    /// 32-bit integer.
    I32(i32),
}

/// An image: channels of equal size, where they lie in the full picture, and metadata.
///
/// Colour is linear radiance in Rec. 709 primaries, multiplied by alpha as EXR demands.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    data: Window,
    display: Window,
    channels: Vec<Channel>,
    /// Custom attributes: in the order of the file when read; ignored by [`crate::write_exr`],
    /// which takes them from its settings.
    pub metadata: Vec<(String, MetaValue)>,
}

impl Image {
    /// A black image with the given channels.
    ///
    /// # Errors
    /// Zero sizes, more than [`MAX_SAMPLES`] values, or channel names that are empty or repeated.
    pub fn new(width: u32, height: u32, channels: &[&str]) -> Result<Self, Error> {
        let mut image = Self::without_channels(Window { x: 0, y: 0, width, height })?;
        for name in channels {
            image.check_new_channel(name)?;
            let mut samples = Vec::new();
            let count = image.pixel_count();
            samples.try_reserve_exact(count).map_err(|_| no_memory(width, height))?;
            samples.resize(count, 0.0);
            image.channels.push(Channel { name: (*name).into(), samples });
        }
        Ok(image)
    }

    /// An image without channels, displayed as it is placed.
    ///
    /// # Errors
    /// Zero sizes or more than [`MAX_SAMPLES`] pixels.
    pub fn without_channels(data: Window) -> Result<Self, Error> {
        let Window { width, height, .. } = data;
        if width == 0 || height == 0 {
            return Err(Error::invalid(
                "image",
                format!("{width} x {height} pixels"),
                "both sides must be at least one pixel",
            ));
        }
        if u64::from(width) * u64::from(height) > MAX_SAMPLES {
            return Err(Error::too_large(
                "image",
                format!("{width} x {height} pixels exceed the limit of 2^30 values"),
                "split the image",
            ));
        }
        Ok(Self { data, display: data, channels: Vec::new(), metadata: Vec::new() })
    }

    /// For the film, whose sizes are checked already.
    pub(crate) fn of_film<'n>(
        data: Window,
        display: Window,
        planes: impl Iterator<Item = (&'n str, Vec<f32>)>,
    ) -> Self {
        let channels =
            planes.map(|(name, samples)| Channel { name: name.into(), samples }).collect();
        Self { data, display, channels, metadata: Vec::new() }
    }

    /// Columns.
    pub fn width(&self) -> u32 {
        self.data.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.data.height
    }

    /// Where the pixels lie in the full picture (EXR data window).
    pub fn data_window(&self) -> Window {
        self.data
    }

    /// The full picture (EXR display window).
    pub fn display_window(&self) -> Window {
        self.display
    }

    /// Places the pixels at (`x`, `y`) in a picture that is shown as `display`.
    pub fn place(&mut self, x: i32, y: i32, display: Window) {
        (self.data.x, self.data.y, self.display) = (x, y, display);
    }

    /// All channels.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// The values of a channel, row by row from the top.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().find(|c| c.name == name).map(|c| c.samples.as_slice())
    }

    /// The values of a channel, to be changed.
    pub fn channel_mut(&mut self, name: &str) -> Option<&mut [f32]> {
        self.channels.iter_mut().find(|c| c.name == name).map(|c| c.samples.as_mut_slice())
    }

    /// Adds a channel.
    ///
    /// # Errors
    /// A name that is empty, taken, longer than 255 bytes or has a NUL in it; a number of values
    /// that is not width x height; too many channels or values.
    pub fn add_channel(&mut self, name: &str, samples: Vec<f32>) -> Result<(), Error> {
        self.check_new_channel(name)?;
        if samples.len() != self.pixel_count() {
            return Err(Error::invalid(
                format!("channel {name:?}"),
                format!(
                    "{} values for {} x {} pixels",
                    samples.len(),
                    self.data.width,
                    self.data.height
                ),
                "give one value for each pixel",
            ));
        }
        self.channels.push(Channel { name: name.into(), samples });
        Ok(())
    }

    /// Adds the channels of `other` as `layer.name`, for instance `variance.R`.
    ///
    /// # Errors
    /// A name that is taken, longer than 255 bytes or has a NUL in it; an image of another number
    /// of pixels; too many channels or values.
    pub fn add_layer(&mut self, layer: &str, other: &Self) -> Result<(), Error> {
        for channel in &other.channels {
            self.add_channel(&format!("{layer}.{}", channel.name), channel.samples.clone())?;
        }
        Ok(())
    }

    /// The channels of one layer as an image of its own, `layer.` taken off their names; None if
    /// there are none.
    pub fn layer(&self, layer: &str) -> Option<Self> {
        let strip = |channel: &Channel| {
            let name = channel.name.strip_prefix(layer)?.strip_prefix('.')?;
            Some(Channel { name: name.into(), samples: channel.samples.clone() })
        };
        let channels: Vec<_> = self.channels.iter().filter_map(strip).collect();
        let (data, display) = (self.data, self.display);
        (!channels.is_empty()).then(|| Self { data, display, channels, metadata: Vec::new() })
    }

    /// Its channels in two images: those whose name is chosen, and the others.
    pub fn split(self, chosen: impl Fn(&str) -> bool) -> (Self, Self) {
        let Self { data, display, channels, metadata } = self;
        let (own, others) = channels.into_iter().partition(|channel| chosen(&channel.name));
        let rest = Self { data, display, channels: others, metadata: metadata.clone() };
        (Self { data, display, channels: own, metadata }, rest)
    }

    /// The value of a channel at column `x` and row `y`, counted from the first stored pixel.
    pub fn get(&self, name: &str, x: u32, y: u32) -> Option<f32> {
        let index = self.index(x, y)?;
        self.channel(name).map(|samples| samples[index])
    }

    /// Sets a value; false if there is no such channel or pixel.
    pub fn set(&mut self, name: &str, x: u32, y: u32, value: f32) -> bool {
        let Some(index) = self.index(x, y) else {
            return false;
        };
        match self.channel_mut(name) {
            Some(samples) => {
                samples[index] = value;
                true
            }
            None => false,
        }
    }

    /// The planes of the image's colour, by the names of its channels ([`color_channels`]); one
    /// plane three times for a grey image, None if no channels are known to be its colour.
    pub fn rgb_planes(&self) -> Option<[&[f32]; 3]> {
        let found = color_channels(self.channels.iter().map(|c| c.name.as_str()))?;
        Some(found.rgb.map(|index| self.channels[index].samples.as_slice()))
    }

    /// Metadata by name.
    pub fn meta(&self, name: &str) -> Option<&MetaValue> {
        self.metadata.iter().find(|(key, _)| key == name).map(|(_, value)| value)
    }

    /// Width x height.
    pub fn pixel_count(&self) -> usize {
        self.data.width as usize * self.data.height as usize
    }

    fn index(&self, x: u32, y: u32) -> Option<usize> {
        (x < self.data.width && y < self.data.height)
            .then(|| y as usize * self.data.width as usize + x as usize)
    }

    fn check_new_channel(&self, name: &str) -> Result<(), Error> {
        let place = || format!("channel {name:?}");
        if name.is_empty() || name.len() > 255 || name.contains('\0') {
            return Err(Error::invalid(
                place(),
                "the name cannot be stored",
                "use 1 to 255 bytes without NUL",
            ));
        }
        if self.channel(name).is_some() {
            return Err(Error::invalid(
                place(),
                "the image has a channel of that name",
                "choose another name",
            ));
        }
        let values = self.pixel_count() as u64 * (self.channels.len() as u64 + 1);
        if self.channels.len() >= MAX_CHANNELS || values > MAX_SAMPLES {
            return Err(Error::too_large(
                place(),
                format!("the image would have {values} values, above 2^30, or over 1024 channels"),
                "split the image",
            ));
        }
        Ok(())
    }
}

fn no_memory(width: u32, height: u32) -> Error {
    Error::too_large(
        "image",
        format!("no memory for {width} x {height} pixels"),
        "lower the resolution or split the image",
    )
}

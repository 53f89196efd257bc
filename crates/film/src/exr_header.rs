//! What an OpenEXR file says before its pixels, read without the decoder.
//!
//! The decoder (`exr` 1.74) calls a sound file damaged if it does not know its compression, and
//! says nothing of what else is in it. This reads over all headers, whatever the pixels are.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use crate::color_channels::color_channels;
use crate::color_space::{COLOR_INTEROP_ID, Chromaticities};
use crate::error::Error;
use crate::image::{MetaValue, Window};

/// Most bytes that all headers may take.
const MAX_HEADERS: u64 = 1 << 28;
/// Largest list of channels in bytes: a thousand names of 255 letters.
const MAX_CHANNEL_LIST: u64 = 1 << 19;
/// Longest text that is kept, 16 MiB: as long as the writer allows.
const MAX_TEXT: u64 = 1 << 24;
/// Most parts of a file, and most channels of them all.
const MAX_PARTS: usize = 1024;
const MAX_LISTED_CHANNELS: usize = 8192;

/// The headers of an OpenEXR file: one for each part.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrHeader {
    /// At least one.
    pub parts: Vec<ExrPart>,
    /// Bytes of the whole file.
    pub file_length: u64,
}

/// One part of an OpenEXR file, an image of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrPart {
    /// The part's name; files of one part often have none.
    pub name: Option<String>,
    /// Which view of a stereo pair or the like it is.
    pub view: Option<String>,
    /// Whether pixels hold lists of samples in depth.
    pub deep: bool,
    /// Columns and rows of its tiles; none for scan lines.
    pub tiles: Option<[u32; 2]>,
    /// The number of its compression in the file.
    pub compression: u8,
    /// Where its pixels lie.
    pub data_window: Window,
    /// The picture that they are part of.
    pub display_window: Window,
    /// In the order of the file, by name as a rule.
    pub channels: Vec<ExrChannel>,
    /// Whether it says that it is an environment on the faces of a cube.
    pub cube_map: bool,
    /// The primaries its colours refer to, if it says so.
    pub chromaticities: Option<Chromaticities>,
    /// The colour space it names (`lin_ap1_scene`), if it does.
    pub color_interop_id: Option<String>,
    /// Other texts and numbers, sorted by name.
    pub metadata: Vec<(String, MetaValue)>,
}

/// A channel of a part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExrChannel {
    /// Name of the channel, for instance `R` or `layer.R`.
    pub name: String,
    /// Bytes of a sample: 2 for half floats, 4 for floats and whole numbers.
    pub sample_bytes: u8,
    /// Name of the type of its samples: `half`, `float` or `uint`.
    pub sample_type: &'static str,
    /// Columns and rows for one sample; above 1 for chroma of lower resolution.
    pub sampling: [u32; 2],
}

impl ExrHeader {
    /// The part and the channels that are the file's colour: as
    /// [`color_channels`](crate::color_channels()), with the names of parts as layers.
    pub fn color(&self) -> Option<(usize, crate::ColorChannels)> {
        let mut names = Vec::new();
        for (number, part) in self.parts.iter().enumerate().filter(|(_, part)| !part.deep) {
            for (index, channel) in part.channels.iter().enumerate() {
                let name = match &part.name {
                    Some(layer) if self.parts.len() > 1 => in_layer(layer, &channel.name),
                    _ => channel.name.clone(),
                };
                names.push((number, index, name));
            }
        }
        let mut found = color_channels(names.iter().map(|(_, _, name)| name.as_str()))?;
        // The same layer in two parts is one picture for each view: the first counts.
        let (part, ..) = names[found.rgb[0]];
        if found.rgb.iter().any(|&i| names[i].0 != part) {
            return None;
        }
        found.rgb = found.rgb.map(|i| names[i].1);
        Some((part, found))
    }

    /// One line for each part: its size, compression, layers and channels, with names escaped.
    pub fn describe(&self) -> Vec<String> {
        self.parts.iter().map(|part| part.describe(self.parts.len() > 1)).collect()
    }
}

/// A channel's name with its layer before it, once.
pub(crate) fn in_layer(layer: &str, channel: &str) -> String {
    match channel.strip_prefix(layer) {
        Some(rest) if rest.starts_with('.') => channel.to_owned(),
        _ => format!("{layer}.{channel}"),
    }
}

impl ExrPart {
    /// What the compression is called; None for numbers that no known version of OpenEXR writes.
    pub fn compression_name(&self) -> Option<&'static str> {
        const NAMES: [&str; 14] = [
            "no", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB", "HTJ2K256",
            "HTJ2K32", "LJ2K", "ZSTD",
        ];
        NAMES.get(usize::from(self.compression)).copied()
    }

    /// Rows that are packed together; none for compressions that cannot be read.
    pub(crate) fn rows_per_block(&self) -> Option<u32> {
        Some(match self.compression {
            0..=2 => 1,
            3 | 5 => 16,
            4 | 6..=8 => 32,
            9 => 256,
            _ => return None,
        })
    }

    /// Whether some channels have fewer samples than pixels (luminance and chroma).
    pub fn is_subsampled(&self) -> bool {
        self.channels.iter().any(|c| c.sampling != [1, 1])
    }

    /// Bytes of its pixels when unpacked.
    pub(crate) fn unpacked_bytes(&self) -> u64 {
        let samples = self.channels.iter().map(|c| u64::from(c.sample_bytes)).sum::<u64>();
        self.pixels().saturating_mul(samples)
    }

    pub(crate) fn pixels(&self) -> u64 {
        u64::from(self.data_window.width) * u64::from(self.data_window.height)
    }

    fn describe(&self, with_name: bool) -> String {
        const SHOWN: usize = 24;
        let Window { width, height, .. } = self.data_window;
        let name = match &self.name {
            Some(name) if with_name => format!("part \"{}\": ", name.escape_debug()),
            None if with_name => "part without a name: ".into(),
            _ => String::new(),
        };
        let number = || format!("unknown ({})", self.compression);
        let compression = self.compression_name().map_or_else(number, str::to_owned);
        let list = self.channels.iter().take(SHOWN).map(|c| c.name.escape_debug().to_string());
        let mut list = list.collect::<Vec<_>>().join(", ");
        if let Some(more) = self.channels.len().checked_sub(SHOWN).filter(|n| *n > 0) {
            list.push_str(&format!(" and {more} more"));
        }
        let kind = match (self.deep, self.tiles, self.is_subsampled()) {
            (true, ..) => ", deep",
            (_, _, true) => ", some of lower resolution",
            (_, Some(_), _) => ", tiled",
            _ => "",
        };
        format!("{name}{width} x {height}, {compression} compression, channels {list}{kind}")
    }
}

/// Reads the headers of an OpenEXR file; its pixels may be of any kind.
///
/// # Errors
/// No such file or no plain file; no OpenEXR file, one of a version above 2, or one whose headers
/// are damaged or cut off.
pub fn read_exr_header(path: &Path) -> Result<ExrHeader, Error> {
    open(path).map(|(header, _)| header)
}

/// The headers, and the file behind them.
pub(crate) fn open(path: &Path) -> Result<(ExrHeader, BufReader<File>), Error> {
    // Asked before opening: to open a pipe that nobody writes to never ends.
    let meta = std::fs::metadata(path).map_err(|e| Error::open(path, e))?;
    if !meta.is_file() {
        return Err(Error::invalid(
            path.display().to_string(),
            "it is no plain file",
            "give the path of an image file",
        ));
    }
    let file = File::open(path).map_err(|e| Error::open(path, e))?;
    let mut reader = BufReader::with_capacity(1 << 16, file);
    let parts = Headers { source: (&mut reader).take(MAX_HEADERS.min(meta.len())) }.read();
    match parts {
        Ok(parts) => Ok((ExrHeader { parts, file_length: meta.len() }, reader)),
        Err(Fault::Io(e)) => Err(Error::io(path, "read it", e)),
        Err(Fault::Version(version)) => Err(Error::Unsupported {
            place: path.display().to_string(),
            problem: format!("version {version} of the OpenEXR file format"),
            remedy: "save the image as OpenEXR 2",
        }),
        Err(Fault::Unsound(what)) => Err(Error::invalid(
            path.display().to_string(),
            format!("this is not a sound EXR file ({what})"),
            "copy or write it anew",
        )),
    }
}

enum Fault {
    Io(std::io::Error),
    Version(u8),
    Unsound(&'static str),
}

impl From<std::io::Error> for Fault {
    fn from(error: std::io::Error) -> Self {
        match error.kind() {
            std::io::ErrorKind::UnexpectedEof => Self::Unsound("it is cut off"),
            _ => Self::Io(error),
        }
    }
}

struct Headers<R> {
    source: std::io::Take<R>,
}

impl<R: BufRead> Headers<R> {
    fn read(mut self) -> Result<Vec<ExrPart>, Fault> {
        if self.bytes::<4>()? != [0x76, 0x2f, 0x31, 0x01] {
            return Err(Fault::Unsound("its first bytes are others"));
        }
        let [version, flags, ..] = self.bytes::<4>()?;
        if version != 2 {
            return Err(Fault::Version(version));
        }
        let several = flags & 0x10 != 0;
        // In files of one part these flags say what its `type` may not.
        let (deep, tiled) = (flags & 0x08 != 0, flags & 0x02 != 0);
        let mut parts: Vec<ExrPart> = Vec::new();
        loop {
            let channels: usize = parts.iter().map(|p| p.channels.len()).sum();
            if parts.len() == MAX_PARTS || channels > MAX_LISTED_CHANNELS {
                return Err(Fault::Unsound("it has over 1024 parts or 8192 channels"));
            }
            match self.part(several)? {
                Some(mut part) => {
                    part.deep |= deep && !several;
                    if !(tiled || several) {
                        part.tiles = None;
                    }
                    parts.push(part);
                    if !several {
                        return Ok(parts);
                    }
                }
                None if parts.is_empty() => return Err(Fault::Unsound("it has no parts")),
                None => return Ok(parts),
            }
        }
    }

    /// The next part; none where an empty header ends the list.
    fn part(&mut self, several: bool) -> Result<Option<ExrPart>, Fault> {
        let mut compression = None;
        let (mut data, mut display, mut channels) = (None, None, None);
        let nowhere = Window { x: 0, y: 0, width: 0, height: 0 };
        let mut part = ExrPart {
            name: None,
            view: None,
            deep: false,
            tiles: None,
            compression: 0,
            data_window: nowhere,
            display_window: nowhere,
            channels: Vec::new(),
            cube_map: false,
            chromaticities: None,
            color_interop_id: None,
            metadata: Vec::new(),
        };
        let mut kept = 0u64;
        for count in 0.. {
            let name = self.name()?;
            if name.is_empty() {
                if count == 0 && several {
                    return Ok(None);
                }
                break;
            }
            let kind = self.name()?;
            let size = u64::from(u32::from_le_bytes(self.bytes()?));
            if size > self.source.limit() {
                return Err(Fault::Unsound("an attribute is larger than the file"));
            }
            match (name.as_str(), kind.as_str()) {
                ("channels", "chlist") => channels = Some(self.channels(size)?),
                ("compression", "compression") if size == 1 => {
                    compression = Some(self.bytes::<1>()?[0]);
                }
                ("dataWindow", "box2i") if size == 16 => data = Some(self.window()?),
                ("displayWindow", "box2i") if size == 16 => display = Some(self.window()?),
                ("envmap", "envmap") if size == 1 => part.cube_map = self.bytes::<1>()?[0] == 1,
                ("tiles", "tiledesc") if size == 9 => {
                    let [x, y] = [self.u32()?, self.u32()?];
                    self.bytes::<1>()?;
                    part.tiles = Some([x, y]);
                }
                ("chromaticities", "chromaticities") if size == 32 => {
                    let mut values = [0.0; 8];
                    for value in &mut values {
                        *value = f64::from(f32::from_le_bytes(self.bytes()?));
                    }
                    part.chromaticities = Some(Chromaticities::from_array(values));
                }
                (_, "string") if size <= MAX_TEXT && kept + size <= 4 * MAX_TEXT => {
                    kept += size;
                    let text = self.text(size)?;
                    match name.as_str() {
                        "name" => part.name = Some(text),
                        "view" => part.view = Some(text),
                        "type" => part.deep |= text.starts_with("deep"),
                        COLOR_INTEROP_ID => part.color_interop_id = Some(text),
                        _ => part.metadata.push((name, MetaValue::Text(text))),
                    }
                }
                // What the format itself needs is no metadata.
                ("pixelAspectRatio" | "screenWindowWidth" | "dwaCompressionLevel", _)
                | ("version" | "chunkCount" | "maxSamplesPerPixel", _) => self.skip(size)?,
                (_, "float") if size == 4 => {
                    let value = f32::from_le_bytes(self.bytes()?);
                    part.metadata.push((name, MetaValue::F32(value)));
                }
                (_, "double") if size == 8 => {
                    let value = f64::from_le_bytes(self.bytes()?);
                    part.metadata.push((name, MetaValue::F64(value)));
                }
                (_, "int") if size == 4 => {
                    let value = i32::from_le_bytes(self.bytes()?);
                    part.metadata.push((name, MetaValue::I32(value)));
                }
                _ => self.skip(size)?,
            }
        }
        part.metadata.sort_by(|a, b| a.0.cmp(&b.0));
        part.channels = channels.ok_or(Fault::Unsound("it lists no channels"))?;
        part.compression = compression.ok_or(Fault::Unsound("it names no compression"))?;
        part.data_window = data.ok_or(Fault::Unsound("it has no data window"))?;
        part.display_window = display.ok_or(Fault::Unsound("it has no display window"))?;
        Ok(Some(part))
    }

    fn channels(&mut self, size: u64) -> Result<Vec<ExrChannel>, Fault> {
        if size > MAX_CHANNEL_LIST {
            return Err(Fault::Unsound("its list of channels is too long"));
        }
        let after = self.source.limit() - size;
        let mut channels = Vec::new();
        loop {
            let name = self.name()?;
            if name.is_empty() {
                break;
            }
            if channels.len() == MAX_LISTED_CHANNELS {
                return Err(Fault::Unsound("it has over 8192 channels"));
            }
            let (sample_type, sample_bytes) = match self.u32()? {
                0 => ("uint", 4),
                1 => ("half", 2),
                2 => ("float", 4),
                _ => return Err(Fault::Unsound("a channel has an unknown type")),
            };
            self.bytes::<4>()?;
            let sampling = [self.u32()?, self.u32()?];
            channels.push(ExrChannel { name, sample_bytes, sample_type, sampling });
        }
        if self.source.limit() != after {
            return Err(Fault::Unsound("its list of channels ends elsewhere than it says"));
        }
        Ok(channels)
    }

    fn window(&mut self) -> Result<Window, Fault> {
        let mut corners = [0i32; 4];
        for corner in &mut corners {
            *corner = i32::from_le_bytes(self.bytes()?);
        }
        let [x, y, right, bottom] = corners;
        let side = |low: i32, high: i32| {
            let size = i64::from(high) - i64::from(low) + 1;
            let size = u32::try_from(size).ok().filter(|s| (1..=i32::MAX as u32).contains(s));
            size.ok_or(Fault::Unsound("a window is empty or too large"))
        };
        Ok(Window { x, y, width: side(x, right)?, height: side(y, bottom)? })
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut bytes = [0; N];
        self.source.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        Ok(u32::from_le_bytes(self.bytes()?))
    }

    /// Up to a NUL, which is taken off; at most 255 bytes.
    fn name(&mut self) -> Result<String, Fault> {
        let mut name = Vec::new();
        (&mut self.source).take(256).read_until(0, &mut name)?;
        match name.pop() {
            Some(0) => Ok(String::from_utf8_lossy(&name).into_owned()),
            Some(_) if name.len() == 255 => Err(Fault::Unsound("a name is over 255 bytes long")),
            _ => Err(Fault::Unsound("it is cut off")),
        }
    }

    /// `size` is no more than what is left.
    fn text(&mut self, size: u64) -> Result<String, Fault> {
        let mut bytes = Vec::new();
        (&mut self.source).take(size).read_to_end(&mut bytes)?;
        if bytes.len() as u64 != size {
            return Err(Fault::Unsound("it is cut off"));
        }
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    fn skip(&mut self, size: u64) -> Result<(), Fault> {
        let skipped = std::io::copy(&mut (&mut self.source).take(size), &mut std::io::sink())?;
        if skipped == size { Ok(()) } else { Err(Fault::Unsound("it is cut off")) }
    }
}

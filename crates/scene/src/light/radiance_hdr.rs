//! Radiance .hdr and .pic images (Ward, "Real pixels", Graphics Gems II, 1991; the file format is
//! described in Radiance's reference manual).

use pileus_film::{Chromaticities, ColorSpace};

/// Texels that are accepted for each byte of the file: runs of runs make any number of a few bytes.
const MAX_EXPANSION: usize = 1 << 16;
/// Longest header in bytes.
const MAX_HEADER: usize = 1 << 20;

/// A decoded image.
pub(crate) struct RadianceImage {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Linear Rec. 709, row by row from the top; may be negative where primaries were converted.
    pub(crate) texels: Vec<[f32; 3]>,
    /// What the user should know about how the header was understood.
    pub(crate) remarks: Vec<String>,
}

/// Why an image cannot be decoded.
#[derive(Debug)]
pub(crate) enum Fault {
    Damaged(String),
    Unsupported(String, &'static str),
}

fn damaged<T>(what: impl Into<String>) -> Result<T, Fault> {
    Err(Fault::Damaged(what.into()))
}

/// Whether a file begins as Radiance's do: `#?` and the name of a program (`#?RADIANCE`, `#?RGBE`,
/// `#?AUTOPANO`), whatever it is.
pub(crate) fn is_radiance(bytes: &[u8]) -> bool {
    bytes.starts_with(b"#?")
}

/// Decodes an image of at most `max_texels`.
///
/// Values are divided by the products of all EXPOSURE and COLORCORR lines, as the format demands
/// of readers that want radiance, and converted from PRIMARIES to Rec. 709. All eight orders of
/// scan lines and both ways of packing runs are read.
pub(crate) fn decode(bytes: &[u8], max_texels: usize) -> Result<RadianceImage, Fault> {
    let mut header = Header::default();
    let mut rest = bytes;
    header.read(&mut rest)?;
    let order = Order::parse(&line(&mut rest)?)?;
    let [width, height] = order.size();
    if width.checked_mul(height).is_none_or(|n| n > max_texels) {
        let what = format!("the image has {width} x {height} texels");
        return Err(Fault::Unsupported(what, "scale it down: up to 2^27 texels are read"));
    }
    // A scan line takes at least one pixel of four bytes.
    if order.lines > rest.len() / 4 || width * height / MAX_EXPANSION > rest.len() {
        let left = rest.len();
        return damaged(format!(
            "it is cut off: {left} bytes cannot hold {width} x {height} texels"
        ));
    }
    let factors = header.factors();
    let scales: Vec<[f64; 3]> = (0..256)
        .map(|e| {
            let unit = if e == 0 { 0.0 } else { libm::ldexp(1.0, e - 136) };
            factors.map(|factor| unit / factor)
        })
        .collect();
    let mut texels = vec![[0.0f32; 3]; width * height];
    let mut row = vec![[0u8; 4]; order.length];
    for number in 0..order.lines {
        read_line(&mut rest, &mut row)?;
        for (along, &[r, g, b, e]) in row.iter().enumerate() {
            let scale = scales[usize::from(e)];
            let texel = [r, g, b].map(f64::from);
            texels[order.index(number, along)] =
                std::array::from_fn(|c| (texel[c] * scale[c]) as f32);
        }
    }
    if let Some(space) = &header.primaries {
        space.convert_to_rec_709(&mut texels);
    }
    Ok(RadianceImage { width, height, texels, remarks: header.remarks })
}

/// Takes a line off the front.
fn line(rest: &mut &[u8]) -> Result<String, Fault> {
    let searched = &rest[..rest.len().min(MAX_HEADER)];
    let Some(end) = searched.iter().position(|&b| b == b'\n') else {
        return damaged("its header is cut off");
    };
    let text = String::from_utf8_lossy(&rest[..end]).trim_end_matches('\r').to_owned();
    *rest = &rest[end + 1..];
    Ok(text)
}

#[derive(Default)]
struct Header {
    exposures: Vec<f64>,
    corrections: Vec<[f64; 3]>,
    primaries: Option<ColorSpace>,
    remarks: Vec<String>,
}

impl Header {
    /// All lines up to the empty one.
    fn read(&mut self, rest: &mut &[u8]) -> Result<(), Fault> {
        let mut left = MAX_HEADER;
        loop {
            let line = line(rest)?;
            left = match left.checked_sub(line.len() + 1) {
                Some(left) => left,
                None => return damaged("its header is longer than 1 MiB"),
            };
            if line.trim().is_empty() {
                return Ok(());
            }
            // Comments, and what programs say of themselves, have no `=` that counts.
            if let Some((key, value)) = line.split_once('=').filter(|_| !line.starts_with('#')) {
                self.entry(key.trim(), value.trim())?;
            }
        }
    }

    fn entry(&mut self, key: &str, value: &str) -> Result<(), Fault> {
        let numbers: Option<Vec<f64>> =
            value.split_whitespace().map(|word| word.parse().ok()).collect();
        let numbers = numbers.unwrap_or_default();
        let usable = |n: &f64| n.is_finite() && *n > 0.0;
        match key {
            "FORMAT" if value != "32-bit_rle_rgbe" => {
                let what = format!("the pixel format \"{}\"", value.escape_debug());
                return Err(Fault::Unsupported(what, "save it as 32-bit_rle_rgbe, or as .exr"));
            }
            "EXPOSURE" => match numbers.as_slice() {
                [n] if usable(n) => self.exposures.push(*n),
                _ => self.odd(key, value),
            },
            "COLORCORR" => match numbers.as_slice() {
                [r, g, b] if [r, g, b].into_iter().all(usable) => {
                    self.corrections.push([*r, *g, *b]);
                }
                _ => self.odd(key, value),
            },
            "PRIMARIES" => match <[f64; 8]>::try_from(numbers) {
                Ok(numbers) => {
                    let given = Chromaticities::from_array(numbers);
                    let (space, remarks) = ColorSpace::of_exr(None, Some(given));
                    self.remarks.extend(remarks);
                    self.primaries = Some(space);
                }
                Err(_) => self.odd(key, value),
            },
            _ => {}
        }
        Ok(())
    }

    fn odd(&mut self, key: &str, value: &str) {
        let shown: String = value.chars().take(80).flat_map(char::escape_debug).collect();
        self.remarks.push(format!("its {key} \"{shown}\" is not understood and does not count"));
    }

    /// What values are to be divided by; says so.
    fn factors(&mut self) -> [f64; 3] {
        let exposure: f64 = self.exposures.iter().product();
        let correction = self.corrections.iter().fold([1.0; 3], |product: [f64; 3], next| {
            std::array::from_fn(|c| product[c] * next[c])
        });
        let factors = correction.map(|c| c * exposure);
        if !factors.iter().all(|f| f.is_finite() && *f >= f64::MIN_POSITIVE) {
            self.remarks.push(
                "its EXPOSURE or COLORCORR lines multiply to no number and do not \
                 count"
                    .into(),
            );
            return [1.0; 3];
        }
        if exposure != 1.0 {
            self.remarks.push(format!("its values are divided by its EXPOSURE, {exposure}"));
        }
        if correction != [1.0; 3] {
            self.remarks.push(format!("its values are divided by its COLORCORR, {correction:?}"));
        }
        factors
    }
}

/// The order of pixels in the file.
struct Order {
    lines: usize,
    length: usize,
    /// Whether a scan line is a column of the image.
    columns: bool,
    /// Whether scan lines, and pixels along them, run towards smaller places in the image.
    reversed: [bool; 2],
}

impl Order {
    /// From a line such as `-Y 512 +X 1024`: which way scan lines follow each other and how many
    /// there are, then which way pixels run along them. Y points up and X to the right.
    fn parse(text: &str) -> Result<Self, Fault> {
        let words: Vec<&str> = text.split_whitespace().collect();
        let [first, lines, second, length] = words.as_slice() else {
            let shown: String = text.chars().take(80).flat_map(char::escape_debug).collect();
            return damaged(format!("its size \"{shown}\" is not understood"));
        };
        let axis = |word: &str| match word {
            "+X" => Some((true, false)),
            "-X" => Some((true, true)),
            "-Y" => Some((false, false)),
            "+Y" => Some((false, true)),
            _ => None,
        };
        let size = |word: &str| word.parse::<usize>().ok().filter(|n| *n > 0);
        match (axis(first), size(lines), axis(second), size(length)) {
            (Some((columns, down)), Some(lines), Some((along_x, back)), Some(length))
                if columns != along_x =>
            {
                Ok(Self { lines, length, columns, reversed: [down, back] })
            }
            _ => damaged(format!("its size \"{}\" is not understood", text.escape_debug())),
        }
    }

    fn size(&self) -> [usize; 2] {
        if self.columns { [self.lines, self.length] } else { [self.length, self.lines] }
    }

    /// Where a pixel lies in the image, whose rows run down from the top.
    fn index(&self, line: usize, along: usize) -> usize {
        let line = if self.reversed[0] { self.lines - 1 - line } else { line };
        let along = if self.reversed[1] { self.length - 1 - along } else { along };
        if self.columns { along * self.lines + line } else { line * self.length + along }
    }
}

/// Takes `count` bytes off the front.
fn take<'a>(rest: &mut &'a [u8], count: usize) -> Result<&'a [u8], Fault> {
    match rest.split_at_checked(count) {
        Some((taken, left)) => {
            *rest = left;
            Ok(taken)
        }
        None => damaged("it is cut off"),
    }
}

fn pixel(rest: &mut &[u8]) -> Result<[u8; 4], Fault> {
    let bytes = take(rest, 4)?;
    Ok([bytes[0], bytes[1], bytes[2], bytes[3]])
}

/// Unpacks one scan line.
fn read_line(rest: &mut &[u8], row: &mut [[u8; 4]]) -> Result<(), Fault> {
    // Lines whose channels are packed one by one begin with 2, 2 and their length.
    if let [2, 2, high @ 0..=127, low, ..] = **rest
        && (8..=32767).contains(&row.len())
    {
        *rest = &rest[4..];
        if usize::from(high) << 8 | usize::from(low) != row.len() {
            return damaged("a scan line has another length than the image");
        }
        for channel in 0..4 {
            let mut at = 0;
            while at < row.len() {
                let code = usize::from(take(rest, 1)?[0]);
                let (run, count) = if code > 128 { (true, code - 128) } else { (false, code) };
                let Some(pixels) = row.get_mut(at..at + count).filter(|p| !p.is_empty()) else {
                    return damaged("a run does not fit its scan line");
                };
                let values = take(rest, if run { 1 } else { count })?;
                for (pixel, value) in pixels.iter_mut().zip(values.iter().cycle()) {
                    pixel[channel] = *value;
                }
                at += count;
            }
        }
        return Ok(());
    }
    // Plain pixels, in which (1, 1, 1, n) repeats the last one; runs of runs count by 256.
    let (mut at, mut unit) = (0, 1usize);
    while at < row.len() {
        let next = pixel(rest)?;
        if let [1, 1, 1, count] = next {
            let count = usize::from(count).saturating_mul(unit);
            let last = at.checked_sub(1).map(|before| row[before]);
            let (Some(last), Some(pixels)) = (last, row.get_mut(at..at.saturating_add(count)))
            else {
                return damaged("a run does not fit its scan line");
            };
            pixels.fill(last);
            at += count;
            unit = unit.saturating_mul(256);
        } else {
            row[at] = next;
            at += 1;
            unit = 1;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, body: &[u8]) -> Vec<u8> {
        [header.as_bytes(), body].concat()
    }

    fn texels(header: &str, body: &[u8]) -> Vec<[f32; 3]> {
        decode(&file(header, body), 1 << 20).unwrap_or_else(|f| panic!("{header}: {f:?}")).texels
    }

    /// Six pixels of value 1 to 6 in red, by exponent 136.
    fn six() -> Vec<u8> {
        (1..=6u8).flat_map(|v| [v, 0, 0, 136]).collect()
    }

    fn reds(header: &str) -> Vec<f32> {
        texels(header, &six()).iter().map(|t| t[0]).collect()
    }

    #[test]
    fn all_orders_of_scan_lines_come_out_upright() {
        // 3 columns and 2 rows: as it should look from the top.
        for (size, expected) in [
            ("-Y 2 +X 3", [1., 2., 3., 4., 5., 6.]),
            ("-Y 2 -X 3", [3., 2., 1., 6., 5., 4.]),
            ("+Y 2 +X 3", [4., 5., 6., 1., 2., 3.]),
            ("+Y 2 -X 3", [6., 5., 4., 3., 2., 1.]),
            ("+X 3 -Y 2", [1., 3., 5., 2., 4., 6.]),
            ("+X 3 +Y 2", [2., 4., 6., 1., 3., 5.]),
            ("-X 3 -Y 2", [5., 3., 1., 6., 4., 2.]),
            ("-X 3 +Y 2", [6., 4., 2., 5., 3., 1.]),
        ] {
            for signature in ["#?RADIANCE", "#?RGBE", "#?AUTOPANO", "#?x\r"] {
                let header = format!("{signature}\nFORMAT=32-bit_rle_rgbe\n\n{size}\n");
                assert_eq!(reds(&header), expected, "{size}");
            }
        }
    }

    #[test]
    fn exposures_and_corrections_multiply_and_are_divided_by() {
        let header = "#?RADIANCE\n# EXPOSURE=9\nEXPOSURE= 2\nEXPOSURE=0.25\n\n-Y 2 +X 3\n";
        assert_eq!(reds(header), [2., 4., 6., 8., 10., 12.]);
        let header = "#?RADIANCE\nEXPOSURE=2\nCOLORCORR=4 1 1\n\n-Y 2 +X 3\n";
        assert_eq!(reds(header)[0], 0.125);
        for odd in ["EXPOSURE=0", "EXPOSURE=-1", "EXPOSURE=nan", "EXPOSURE=", "COLORCORR=1 2"] {
            let bytes = file(&format!("#?RADIANCE\n{odd}\n\n-Y 2 +X 3\n"), &six());
            let image = decode(&bytes, 100).unwrap_or_else(|f| panic!("{f:?}"));
            assert_eq!(image.texels[0][0], 1.0);
            assert!(image.remarks[0].contains("does not count"), "{:?}", image.remarks);
        }
        let bytes = file("#?R\nEXPOSURE=1e-300\nEXPOSURE=1e-300\n\n-Y 2 +X 3\n", &six());
        let image = decode(&bytes, 100).unwrap_or_else(|f| panic!("{f:?}"));
        assert!(image.texels[0][0] == 1.0 && image.remarks.len() == 1);
    }

    #[test]
    fn primaries_are_converted() {
        let header = "#?RADIANCE\nPRIMARIES= .713 .293 .165 .830 .128 .044 .32168 .33767\n\n\
                      -Y 1 +X 1\n";
        let found = texels(header, &[200, 100, 100, 129])[0];
        // 200/256 * 2 of (1, .5, .5) in ACEScg.
        for (f, e) in found.iter().zip([1.3525, 0.4349, 0.4880]) {
            assert!((f / (200.0 / 128.0) - e).abs() < 1e-4, "{found:?}");
        }
    }

    #[test]
    fn runs_of_both_kinds_are_unpacked() {
        let header = "#?RADIANCE\n\n-Y 1 +X 300\n";
        // A run of runs: 1 pixel, 43 more, then 256 more.
        let old = [7, 0, 0, 136, 1, 1, 1, 43, 1, 1, 1, 1];
        assert_eq!(texels(header, &old), vec![[7.0, 0.0, 0.0]; 300]);
        let mut new = vec![2, 2, 1, 44];
        for value in [7, 0, 0] {
            new.extend([255, value, 255, value, 174, value]);
        }
        new.extend([128; 1]);
        new.extend([136; 128]);
        new.extend([255, 136, 173, 136]);
        assert_eq!(texels(header, &new), vec![[7.0, 0.0, 0.0]; 300]);
    }

    #[test]
    fn damaged_files_are_errors() {
        let whole = file("#?RADIANCE\nEXPOSURE=1\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n", &six());
        for length in 0..whole.len() {
            assert!(decode(&whole[..length], 100).is_err(), "{length}");
        }
        for body in [
            &[1, 1, 1, 3, 0, 0, 0, 0][..],
            &[5, 0, 0, 0, 1, 1, 1, 200],
            &[2, 2, 0, 9, 0, 0, 0, 0],
            &[2, 2, 0, 8, 0, 0, 0, 0],
            &[2, 2, 0, 8, 255, 0, 0, 0],
        ] {
            assert!(decode(&file("#?RADIANCE\n\n-Y 1 +X 8\n", body), 100).is_err(), "{body:?}");
        }
        for size in ["-Y 99999999 +X 99999999", "-Y 18446744073709551615 +X 2", "-Y 11 +X 10"] {
            let bytes = file(&format!("#?RADIANCE\n\n{size}\n"), &six());
            assert!(matches!(decode(&bytes, 100), Err(Fault::Unsupported(..))), "{size}");
        }
        for size in ["-Y 0 +X 3", "-Y 2 +Y 3", "2 3", "-Y 2 +X", "-Z 2 +X 3", "-Y 100 +X 1"] {
            let bytes = file(&format!("#?RADIANCE\n\n{size}\n"), &six());
            assert!(matches!(decode(&bytes, 100), Err(Fault::Damaged(_))), "{size}");
        }
        let bytes = file("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 2 +X 3\n", &six());
        assert!(matches!(decode(&bytes, 100), Err(Fault::Unsupported(..))));
    }
}

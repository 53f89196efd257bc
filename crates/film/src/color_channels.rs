//! Which channels of an image are its colour, by their names.

use crate::layer::{BACKGROUND, DIRECT, EMISSION, INDIRECT, LAYERS, Layer as FilmLayer};

/// The channels that are an image's colour.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColorChannels {
    /// Positions of red, green and blue; a grey image has one channel three times.
    pub rgb: [usize; 3],
    /// The layer they are in, none for channels without one.
    pub layer: Option<String>,
    /// Further layers that have colours, in the order of the image.
    pub others: Vec<String>,
}

impl ColorChannels {
    /// Whether one channel stands for all three.
    pub fn is_grey(&self) -> bool {
        self.rgb[0] == self.rgb[1]
    }
}

/// Names of layers that are a renderer's picture, beside passes of other meaning.
const PICTURES: [&str; 6] = ["combined", "beauty", "rgba", "rgb", "color", "main"];

/// Layers of a film that are pictures themselves, of some of the light.
static PARTS_OF_LIGHT: [&FilmLayer; 4] = [&BACKGROUND, &EMISSION, &DIRECT, &INDIRECT];

/// Whether a layer says how well a picture is known, or what is in it, as most of our files of
/// layers do: no picture, whatever else the file lacks.
fn is_about_a_picture(layer: &str) -> bool {
    let last = layer.rsplit('.').next();
    let about = |known: &&&FilmLayer| !known.is_picture() && !PARTS_OF_LIGHT.contains(known);
    let channels = LAYERS.iter().filter(about).flat_map(|known| known.channels);
    channels.filter_map(|channel| channel.rsplit_once('.')).any(|(known, _)| Some(known) == last)
}

#[derive(Default)]
struct Layer<'a> {
    name: Option<&'a str>,
    rgb: [Option<usize>; 3],
    y: Option<usize>,
    chroma: bool,
}

impl Layer<'_> {
    fn rgb(&self) -> Option<[usize; 3]> {
        let [Some(r), Some(g), Some(b)] = self.rgb else { return None };
        Some([r, g, b])
    }

    /// Y alone; with chroma (RY, BY) it is not the whole colour.
    fn grey(&self) -> Option<[usize; 3]> {
        self.y.filter(|_| !self.chroma).map(|y| [y; 3])
    }

    /// 0 for channels without a layer, 1 for the picture among passes, 2 for other layers.
    fn rank(&self) -> u8 {
        let Some(name) = self.name else { return 0 };
        let last = name.rsplit('.').next().unwrap_or(name);
        if PICTURES.iter().any(|p| last.eq_ignore_ascii_case(p)) { 1 } else { 2 }
    }
}

/// Finds the colour among channels named `R` or `layer.R`.
///
/// R, G and B without a layer come first, then those of a layer that is called as a renderer's
/// picture (`Combined`, `beauty`, `rgba` and the like), then the first layer that has them, then Y
/// without chroma in the same order, then the only channel there is beside alpha, whatever its
/// name. `red`, `green`, `blue` and small letters count without a layer only: in layers small
/// letters are the ids of Cryptomatte. Layers that say how well a picture is known (`variance` and
/// others of [`LAYERS`]) are none.
pub fn color_channels<'a>(names: impl IntoIterator<Item = &'a str>) -> Option<ColorChannels> {
    let mut layers: Vec<Layer<'a>> = Vec::new();
    let mut not_alpha = Vec::new();
    for (index, full) in names.into_iter().enumerate() {
        let (layer, name) = match full.rsplit_once('.') {
            Some((layer, name)) => (Some(layer), name),
            None => (None, full),
        };
        let small = layer.is_none();
        let is = |short: &str, long: &str| {
            name == short
                || small && (name.eq_ignore_ascii_case(short) || name.eq_ignore_ascii_case(long))
        };
        if layer.is_some_and(is_about_a_picture) {
            continue;
        }
        if !is("A", "alpha") {
            not_alpha.push(index);
        }
        let position = layers.iter().position(|l| l.name == layer).unwrap_or_else(|| {
            layers.push(Layer { name: layer, ..Layer::default() });
            layers.len() - 1
        });
        let entry = &mut layers[position];
        for (slot, (short, long)) in
            [("R", "red"), ("G", "green"), ("B", "blue")].iter().enumerate()
        {
            if is(short, long) {
                entry.rgb[slot] = entry.rgb[slot].or(Some(index));
            }
        }
        if is("Y", "Y") {
            entry.y = entry.y.or(Some(index));
        }
        entry.chroma |= matches!(name, "RY" | "BY");
    }
    let best = |color: fn(&Layer<'a>) -> Option<[usize; 3]>| {
        let found = || layers.iter().filter_map(move |l| Some((l, color(l)?)));
        let (layer, rgb) = found().min_by_key(|(layer, _)| layer.rank())?;
        let others = found().filter_map(|(l, _)| l.name).filter(|n| Some(*n) != layer.name);
        Some(ColorChannels {
            rgb,
            layer: layer.name.map(str::to_owned),
            others: others.map(str::to_owned).collect(),
        })
    };
    best(Layer::rgb).or_else(|| best(Layer::grey)).or_else(|| match not_alpha.as_slice() {
        &[only] if !layers.iter().any(|l| l.chroma) => {
            Some(ColorChannels { rgb: [only; 3], layer: None, others: Vec::new() })
        }
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(names: &[&str]) -> Option<([usize; 3], Option<String>)> {
        color_channels(names.iter().copied()).map(|c| (c.rgb, c.layer))
    }

    #[test]
    fn colours_are_found_by_name() {
        let layer = |name: &str| Some(name.to_owned());
        for (names, expected) in [
            (
                &["A", "B", "G", "R", "variance.B", "variance.G", "variance.R"][..],
                Some(([3, 2, 1], None)),
            ),
            (&["blue", "green", "Red"], Some(([2, 1, 0], None))),
            (
                &[
                    "V.AO.B",
                    "V.AO.G",
                    "V.AO.R",
                    "V.Combined.A",
                    "V.Combined.B",
                    "V.Combined.G",
                    "V.Combined.R",
                ],
                Some(([6, 5, 4], layer("V.Combined"))),
            ),
            (&["a.B", "a.G", "a.R", "b.B", "b.G", "b.R"], Some(([2, 1, 0], layer("a")))),
            (&["Y"], Some(([0; 3], None))),
            (&["A", "Y"], Some(([1; 3], None))),
            (&["x.Y", "x.Z"], Some(([0; 3], layer("x")))),
            (&["V"], Some(([0; 3], None))),
            (&["A", "V"], Some(([1; 3], None))),
            (&["Depth.V"], Some(([0; 3], None))),
            // Chroma beside Y is more than grey, two channels are no colour.
            (&["BY", "RY", "Y"], None),
            (&["RY"], None),
            (&["B", "G"], None),
            (&["U", "V"], None),
            (&["A"], None),
            // How well a picture is known is no picture.
            (&["variance.B", "variance.G", "variance.R", "variance_alpha.Y"], None),
            (&["samples.Y"], None),
            (&[], None),
            // Ids of Cryptomatte are no colours.
            (&["C00.r", "C00.g", "C00.b", "C00.a"], None),
        ] {
            assert_eq!(found(names), expected, "{names:?}");
        }
        let several = color_channels(["a.B", "a.G", "a.R", "b.B", "b.G", "b.R"]).unwrap();
        assert_eq!(several.others, ["b"]);
        assert!(!several.is_grey());
    }
}

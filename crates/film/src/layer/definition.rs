//! What a layer is.

use crate::moments::{PixelMoments, PixelSample};
use crate::path_record::PathRecord;

/// A named set of channels, and how it comes from samples.
///
/// Programs may declare layers of their own beside [`LAYERS`](crate::LAYERS), as constants:
///
/// ```
/// use pileus_film::{Film, Layer, PixelSample, Reconstruction};
///
/// static LUMINANCE: Layer = Layer {
///     name: "luminance",
///     meaning: "luminance of Rec. 709 radiance",
///     channels: &["luminance.Y"],
///     reconstruction: Reconstruction::Mean(|sample, _, value| {
///         let [r, g, b] = sample.rgb;
///         value[0] = 0.2126 * r + 0.7152 * g + 0.0722 * b;
///     }),
/// };
///
/// let mut film = Film::with_layers([1, 1], None, &[&LUMINANCE])?;
/// let mut tile = film.tile(0, 0, 1, 1);
/// tile.start(0..2)?;
/// for (number, v) in [(0, 0.25), (1, 0.75)] {
///     tile.add(0, 0, number, &PixelSample::new([v; 3], 1.0));
/// }
/// film.add_tiles(&[tile]);
/// assert_eq!(film.image_of(&[&LUMINANCE])?.get("luminance.Y", 0, 0), Some(0.5));
/// # Ok::<(), pileus_film::Error>(())
/// ```
#[derive(Debug)]
pub struct Layer {
    /// What jobs, state files and logs call it: 1 to 255 bytes.
    pub name: &'static str,
    /// What it holds, with unit, as a phrase for lists and reference pages.
    pub meaning: &'static str,
    /// Names of its channels in EXR files, `layer.channel`; those of the picture itself (`R`, `A`)
    /// have no layer's name. No two of a layer may begin with the same layer's name and end in `R`,
    /// `G`, `B` and `A`: a second alpha makes other readers fail.
    pub channels: &'static [&'static str],
    /// How its channels come from the samples of a pixel.
    pub reconstruction: Reconstruction,
}

/// How the channels of a layer come from the samples of a pixel, and so how films of other samples
/// merge. Functions fill one value for each channel.
///
/// A sample belongs to one pixel with weight one (see [`Filter`](crate::Filter)), so the plain mean
/// is the reconstruction by the pixel filter.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Reconstruction {
    /// Mean over the samples, of what every film sums in eight replicates, so that its variance is
    /// known ([`PixelMoments::variance_of_mean`]). No bytes beside those of [`PixelMoments`];
    /// merges with them, exactly.
    Replicated(fn(&PixelMoments, &mut [f32])),
    /// A function of those sums and of no sample: it takes no bytes, nothing happens for it while
    /// rendering, and it merges with them.
    Derived(fn(&PixelMoments, &mut [f32])),
    /// Mean over the samples that count, of values that the function takes from each and from what
    /// its path told. Exact sums of 16 bytes a channel and pixel, without a variance of their own;
    /// they merge by addition, bit for bit. Values that are not finite count as zero and are told
    /// by [`Film::values_left_out`](crate::Film::values_left_out): the sample stays in all other
    /// layers.
    Mean(Take),
    /// Mean over the samples with weights: the sum of what the function takes, which is multiplied
    /// by the weight already, over the sum of weights, the last of its values. Sums as those of
    /// [`Self::Mean`], and one for the weight.
    WeightedMean {
        /// Fills one value for each channel, and the weight.
        take: Take,
        /// What all channels are where the weights add up to nothing, or less: weights of flights
        /// may have either sign.
        nothing: f32,
    },
    /// What is left of the picture's radiance, R, G and B, without these layers: their exact means
    /// are subtracted from its. A film that has such a layer has these, too.
    Remainder(&'static [&'static Layer]),
}

/// Takes values from a sample and from what its path told.
pub type Take = fn(&PixelSample, &PathRecord, &mut [f32]);

impl Layer {
    /// Whether it is part of the picture itself: its channels have no layer's name.
    pub fn is_picture(&self) -> bool {
        self.channels.iter().all(|channel| !channel.contains('.'))
    }

    /// Whether the noise of its means is known.
    pub fn has_variance(&self) -> bool {
        matches!(self.reconstruction, Reconstruction::Replicated(_))
    }

    /// Layers that a film keeps beside it, since it comes from them.
    pub fn needs(&self) -> &'static [&'static Layer] {
        match self.reconstruction {
            Reconstruction::Remainder(parts) => parts,
            _ => &[],
        }
    }

    /// Sums that a film keeps for it beside those of [`PixelMoments`], in each pixel.
    pub(crate) fn sums(&self) -> usize {
        match self.reconstruction {
            Reconstruction::Mean(_) => self.channels.len(),
            Reconstruction::WeightedMean { .. } => self.channels.len() + 1,
            Reconstruction::Replicated(_)
            | Reconstruction::Derived(_)
            | Reconstruction::Remainder(_) => 0,
        }
    }
}

/// Layers of one name and the same channels are the same layer.
impl PartialEq for Layer {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name && self.channels == other.channels
    }
}

impl Eq for Layer {}

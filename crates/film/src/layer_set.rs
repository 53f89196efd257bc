//! The layers of one film.

use crate::channel_sum::ChannelSum;
use crate::error::Error;
use crate::image::MAX_CHANNELS;
use crate::layer::{FIRST_LAYERS, LAYERS, Layer, Reconstruction, Take};
use crate::moments::{PixelMoments, PixelSample};
use crate::path_record::PathRecord;

/// Values of a sample that every film has: R, G, B and alpha.
pub(crate) const FIRST_VALUES: usize = 4;

/// A function of a sample, and how many values it fills.
#[derive(Clone, Copy, Debug)]
struct Taken {
    values: usize,
    take: Take,
}

/// The first layers, and those that were asked for.
#[derive(Clone, Debug)]
pub(crate) struct LayerSet {
    layers: Vec<&'static Layer>,
    /// Of layers with sums of their own, in the order of `layers`.
    taken: Vec<Taken>,
    sums: usize,
}

impl LayerSet {
    /// The first layers and `further` ones, each after those that it comes from; those that are
    /// there already are not added twice.
    ///
    /// # Errors
    /// Names that cannot be stored, names or channels that two different layers share, too many
    /// channels.
    pub(crate) fn new(further: &[&'static Layer]) -> Result<Self, Error> {
        let mut layers: Vec<&'static Layer> = LAYERS[..FIRST_LAYERS].to_vec();
        for &layer in further {
            for &layer in layer.needs().iter().chain([&layer]) {
                if layers.contains(&layer) {
                    continue;
                }
                check(layer, &layers)?;
                layers.push(layer);
            }
        }
        let channels: usize = layers.iter().map(|layer| layer.channels.len()).sum();
        if channels > MAX_CHANNELS {
            return Err(Error::too_large(
                "film",
                format!("layers with {channels} channels in all"),
                "ask for at most 1024 channels",
            ));
        }
        let taken: Vec<Taken> = layers
            .iter()
            .filter_map(|layer| match layer.reconstruction {
                Reconstruction::Mean(take) | Reconstruction::WeightedMean { take, .. } => {
                    Some(Taken { values: layer.sums(), take })
                }
                _ => None,
            })
            .collect();
        let sums = taken.iter().map(|taken| taken.values).sum();
        Ok(Self { layers, taken, sums })
    }

    pub(crate) fn layers(&self) -> &[&'static Layer] {
        &self.layers
    }

    /// Sums of a pixel beside those of [`PixelMoments`].
    pub(crate) fn sums(&self) -> usize {
        self.sums
    }

    /// Values that a tile keeps of each sample: the first four, and one for each sum.
    pub(crate) fn values(&self) -> usize {
        FIRST_VALUES + self.sums
    }

    /// Fills one value for each sum from a sample and what its path told; tells how many were not
    /// finite and are zero.
    pub(crate) fn take(
        &self,
        sample: &PixelSample,
        path: &PathRecord,
        mut values: &mut [f32],
    ) -> u64 {
        let mut left_out = 0;
        for taken in &self.taken {
            let Some((own, rest)) = values.split_at_mut_checked(taken.values) else { break };
            (taken.take)(sample, path, own);
            for value in own.iter_mut().filter(|value| !value.is_finite()) {
                *value = 0.0;
                left_out += 1;
            }
            values = rest;
        }
        left_out
    }

    /// Where the sums of a layer begin in a pixel; None if the layer is not in the film.
    pub(crate) fn first_sum(&self, layer: &Layer) -> Option<usize> {
        let position = self.layers.iter().position(|own| *own == layer)?;
        Some(self.layers[..position].iter().map(|layer| layer.sums()).sum())
    }
}

/// A layer of a film, and where in a pixel the sums are that it comes from.
pub(crate) struct Placed<'l> {
    layer: &'l Layer,
    /// Of its own sums, or of those of each layer that it comes from.
    first: Vec<usize>,
}

impl<'l> Placed<'l> {
    /// A layer in a film of these; `None` if it is not there.
    pub(crate) fn new(layers: &LayerSet, layer: &'l Layer) -> Option<Self> {
        let own = layers.first_sum(layer)?;
        let first = match layer.needs() {
            [] => vec![own],
            needs => needs.iter().map(|layer| layers.first_sum(layer)).collect::<Option<_>>()?,
        };
        Some(Self { layer, first })
    }

    /// Its values in a pixel with these sums.
    pub(crate) fn reconstruct(
        &self,
        pixel: &PixelMoments,
        sums: &[ChannelSum],
        values: &mut [f32],
    ) {
        let mean = |sum: usize| sums.get(sum).map_or(0.0, |sum| sum.mean(pixel.count()));
        let own = self.first.first().copied().unwrap_or(sums.len());
        match self.layer.reconstruction {
            Reconstruction::Replicated(of) | Reconstruction::Derived(of) => of(pixel, values),
            Reconstruction::Mean(_) => {
                for (value, sum) in values.iter_mut().zip(own..) {
                    *value = mean(sum) as f32;
                }
            }
            Reconstruction::WeightedMean { nothing, .. } => {
                let weight = mean(own + values.len());
                for (value, sum) in values.iter_mut().zip(own..) {
                    *value = if weight > 0.0 { (mean(sum) / weight) as f32 } else { nothing };
                }
            }
            Reconstruction::Remainder(_) => {
                for (channel, value) in values.iter_mut().enumerate() {
                    let parts: f64 = self.first.iter().map(|first| mean(first + channel)).sum();
                    *value = (pixel.mean_of(channel) - parts) as f32;
                }
            }
        }
    }
}

/// Films of the same layers merge.
impl PartialEq for LayerSet {
    fn eq(&self, other: &Self) -> bool {
        self.layers == other.layers
    }
}

impl Eq for LayerSet {}

fn check(layer: &Layer, before: &[&'static Layer]) -> Result<(), Error> {
    let refuse = |problem: String, remedy| {
        Err(Error::invalid(format!("layer {:?}", layer.name), problem, remedy))
    };
    if layer.name.is_empty() || layer.name.len() > 255 || layer.channels.is_empty() {
        let remedy = "give it a name of 1 to 255 bytes, and at least one channel";
        return refuse("it has no name that can be stored, or no channels".into(), remedy);
    }
    if before.iter().any(|other| other.name == layer.name) {
        return refuse("another layer has this name".into(), "choose another name");
    }
    for (i, channel) in layer.channels.iter().enumerate() {
        if channel.is_empty() || channel.len() > 255 || channel.contains('\0') {
            let remedy = "use 1 to 255 bytes without NUL";
            return refuse(format!("its channel {channel:?} cannot be stored"), remedy);
        }
        let taken = before.iter().flat_map(|other| other.channels);
        if taken.chain(&layer.channels[..i]).any(|other| other == channel) {
            let remedy = "choose another name";
            return refuse(format!("its channel {channel:?} is there already"), remedy);
        }
    }
    Ok(())
}

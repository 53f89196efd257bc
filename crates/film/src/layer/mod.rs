//! Layers: what a film keeps of its samples, by name. Each has a file here and a row in [`LAYERS`].

mod albedo;
mod alpha;
mod background;
mod beauty;
mod definition;
mod depth;
mod direct;
mod emission;
mod indirect;
mod normal;
mod position;
mod samples;
mod transmittance;
mod variance;

pub use albedo::ALBEDO;
pub use alpha::ALPHA;
pub use background::BACKGROUND;
pub use beauty::BEAUTY;
pub use definition::{Layer, Reconstruction, Take};
pub use depth::DEPTH;
pub use direct::DIRECT;
pub use emission::EMISSION;
pub use indirect::INDIRECT;
pub use normal::NORMAL;
pub use position::POSITION;
pub use samples::SAMPLES;
pub use transmittance::TRANSMITTANCE;
pub use variance::VARIANCE;

/// All layers that this crate has, in the order in which films and files keep them. The first
/// [`FIRST_LAYERS`] are in every film.
pub static LAYERS: [&Layer; 13] = [
    &BEAUTY,
    &ALPHA,
    &VARIANCE,
    &SAMPLES,
    &TRANSMITTANCE,
    &DEPTH,
    &POSITION,
    &NORMAL,
    &ALBEDO,
    &BACKGROUND,
    &EMISSION,
    &DIRECT,
    &INDIRECT,
];

/// How many of [`LAYERS`] every film has: radiance, alpha, and the variance of both.
pub const FIRST_LAYERS: usize = 3;

impl Layer {
    /// The layer of this crate with that name.
    pub fn named(name: &str) -> Option<&'static Self> {
        LAYERS.into_iter().find(|layer| layer.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_sound() {
        for (i, layer) in LAYERS.into_iter().enumerate() {
            assert_eq!(Layer::named(layer.name), Some(layer));
            assert!(LAYERS[..i].iter().all(|other| other.name != layer.name), "{}", layer.name);
            assert!(!layer.meaning.is_empty() && !layer.channels.is_empty());
            // Readers take the last part of a name for the channel; alpha beside R, G, B of a
            // layer is what Mitsuba refuses.
            for channel in layer.channels {
                assert!(layer.is_picture() || !channel.ends_with(".A"), "{channel}");
            }
        }
        assert_eq!(LAYERS[..FIRST_LAYERS], [&BEAUTY, &ALPHA, &VARIANCE]);
        assert_eq!(Layer::named("Samples"), None);
    }

    #[test]
    fn what_has_a_variance_has_its_channel_in_the_layer_of_variances() {
        let with: Vec<_> = LAYERS.iter().filter(|layer| layer.has_variance()).collect();
        let channels: usize = with.iter().map(|layer| layer.channels.len()).sum();
        assert_eq!(channels, VARIANCE.channels.len());
    }
}

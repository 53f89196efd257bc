//! What the film of a render holds and takes, known before it is made.

use std::fmt;

use pileus_film::{FIRST_LAYERS, FilmMemory, LAYERS};
use pileus_scene::Scene;
use serde::Serialize;

use crate::failure::Failure;
use crate::settings::Settings;

/// The film of a render.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct FilmPlan {
    /// Width and height of the full image.
    pub(crate) resolution: [u32; 2],
    /// Left, top, width and height of what is rendered.
    pub(crate) crop: [u32; 4],
    /// Names of its layers.
    pub(crate) layers: Vec<&'static str>,
    /// Bytes of the sums of all pixels.
    pub(crate) bytes_sums: u64,
    /// Most bytes of the samples of a pass, which are added when the pass is whole.
    pub(crate) bytes_tiles: u64,
    /// Bytes in all.
    pub(crate) bytes: u64,
}

impl FilmPlan {
    /// The film for a scene; nothing is allocated.
    ///
    /// # Errors
    /// What the film refuses: a crop outside the image, too many pixels.
    pub(crate) fn of(settings: &Settings, scene: &Scene) -> Result<Self, Failure> {
        let resolution = scene.camera.resolution();
        let further = &settings.outputs.further;
        let samples = &settings.render.samples;
        let samples = samples.end.saturating_sub(samples.start);
        let memory = FilmMemory::of(resolution, settings.crop, further, samples)?;
        let crop = settings.crop.map_or([0, 0, resolution[0], resolution[1]], |crop| {
            [crop.x0, crop.y0, crop.width, crop.height]
        });
        let layers = LAYERS[..FIRST_LAYERS].iter().chain(further);
        Ok(Self {
            resolution,
            crop,
            layers: layers.map(|layer| layer.name).collect(),
            bytes_sums: memory.sums,
            bytes_tiles: memory.tiles,
            bytes: memory.total(),
        })
    }

    /// Pixels that are rendered.
    pub(crate) fn pixels(&self) -> u64 {
        u64::from(self.crop[2]) * u64::from(self.crop[3])
    }
}

impl fmt::Display for FilmPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [_, _, width, height] = self.crop;
        let [full_width, full_height] = self.resolution;
        write!(f, "film           {width} x {height} pixels")?;
        if [width, height] != [full_width, full_height] {
            write!(f, " of {full_width} x {full_height}")?;
        }
        let megabytes = |bytes: u64| bytes as f64 * 1e-6;
        write!(
            f,
            ", layers {}: {:.1} MB, of which {:.1} MB for the samples of a pass",
            self.layers.join(", "),
            megabytes(self.bytes),
            megabytes(self.bytes_tiles),
        )
    }
}

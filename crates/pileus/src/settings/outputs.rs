//! Which files are written.

use std::path::{Path, PathBuf};

use pileus_film::{DENOISED, DENOISED_CHANNELS, FIRST_LAYERS, LAYERS, Layer, VARIANCE};

use super::{Overrides, Settings};
use crate::failure::Failure;
use crate::job::{DenoiseWhen, Job, OutputSpec};
use crate::outputs::Target;

/// Which files are written.
#[derive(Debug, Clone, PartialEq)]
pub struct Outputs {
    /// The EXR image.
    pub image: PathBuf,
    /// Whether colours and alpha are stored as 16-bit floats.
    pub half: bool,
    /// The PNG preview.
    pub preview: Option<PathBuf>,
    /// Exposure of the preview, stops.
    pub exposure: f32,
    /// Counters and times.
    pub stats: Option<PathBuf>,
    /// Layers that the film has beside the first ones.
    pub further: Vec<&'static Layer>,
    /// Whether the preview is denoised.
    pub denoise: bool,
    /// Whether the denoised picture is among the layers.
    pub denoised_layer: bool,
    /// Where the layers go that are not the picture.
    pub layers: LayersTo,
}

/// Where the layers of an image go.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LayersTo {
    /// Into an EXR of their own.
    File(PathBuf),
    /// Into the image.
    Image,
    /// They are not written.
    Nowhere,
}

/// The name of the file with the layers of an image, unless another one was asked for.
pub(crate) fn layers_beside(image: &Path) -> PathBuf {
    image.with_extension("layers.exr")
}

/// The layers that a job asks for, whose names the schema has checked, in the order of the table,
/// whatever the job's: slices of equal jobs merge. Those that they come from are among them.
fn further(output: &OutputSpec) -> Vec<&'static Layer> {
    let named = |layer: &Layer| output.aovs.iter().flatten().any(|name| *name == layer.name);
    let needed = |layer: &Layer| LAYERS.iter().any(|of| named(of) && of.needs().contains(&layer));
    let mut further = LAYERS[FIRST_LAYERS..].to_vec();
    further.retain(|layer| named(layer) || needed(layer));
    further
}

impl Outputs {
    /// The files of a job, with those that the command line names. Names in the job the schema has
    /// checked; they are relative to `base`, those on the command line to the current folder.
    pub(super) fn resolve(
        job: &Job,
        overrides: &Overrides,
        input: &Path,
        base: &Path,
    ) -> Result<Self, Failure> {
        let output = job.output.clone().unwrap_or_default();
        check_name(overrides.image.as_deref(), "exr", "an EXR file", NAME_THE_IMAGE)?;
        check_name(overrides.preview.as_deref(), "png", "a PNG file", "name the preview .png")?;
        let stem = input.file_stem().map_or_else(|| "pileus".into(), |s| s.to_string_lossy());
        let image = match (&overrides.image, &output.image) {
            (Some(path), _) => path.clone(),
            (None, Some(name)) => base.join(name),
            (None, None) => PathBuf::from(format!("{stem}.exr")),
        };
        let preview = match (&overrides.preview, &output.preview) {
            _ if overrides.no_preview => None,
            (Some(path), _) => Some(path.clone()),
            (None, Some(None)) => None,
            // An image that goes elsewhere takes its preview along.
            (None, Some(Some(name))) if overrides.image.is_none() => Some(base.join(name)),
            (None, _) => Some(image.with_extension("png")),
        };
        let stats = match &output.stats {
            _ if overrides.no_stats => None,
            Some(None) => None,
            Some(Some(name)) => Some(base.join(name)),
            None => Some(image.with_extension("stats.json")),
        };
        let layers = match &output.layers {
            _ if overrides.no_layers => LayersTo::Nowhere,
            _ if output.layers_in_image() => LayersTo::Image,
            Some(None) => LayersTo::Nowhere,
            Some(Some(name)) if overrides.image.is_none() => LayersTo::File(base.join(name)),
            _ => LayersTo::File(layers_beside(&image)),
        };
        let named = overrides.denoise == Some(true) || !overrides.aovs.is_empty();
        if named && layers == LayersTo::Nowhere {
            return Err(Failure::usage(
                "layers are asked for that the job writes nowhere",
                "name a file with `layers` under `output`, or remove its null",
            ));
        }
        let mut further = further(&output);
        let asked = output.aovs.iter().flatten().any(|name| name == DENOISED);
        let denoised_layer = asked && layers != LayersTo::Nowhere;
        if layers == LayersTo::Nowhere {
            further.clear();
        }
        let denoise = job.denoise.clone().unwrap_or_default().when().0 == DenoiseWhen::End;
        let (half, exposure) = (output.half(), output.exposure());
        Ok(Self { image, half, preview, exposure, stats, further, denoise, denoised_layer, layers })
    }
}

const NAME_THE_IMAGE: &str = "name the image .exr; for a picture to look at add --preview FILE.png";

/// Refuses a name on the command line that is not one of such a file.
fn check_name(
    path: Option<&Path>,
    extension: &str,
    kind: &str,
    remedy: &str,
) -> Result<(), Failure> {
    let Some(path) = path else { return Ok(()) };
    if !path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension)) {
        return Err(Failure::usage(format!("{} is not {kind}", path.display()), remedy));
    }
    if path.file_name().is_some_and(|name| name.to_string_lossy().contains('#')) {
        // Written as it stands, every frame would overwrite the one before.
        return Err(Failure::usage(
            "no frame number is filled in for the `#` in the name of an output by this version",
            "give each frame a name of its own, without `#`",
        ));
    }
    Ok(())
}

impl Settings {
    /// What is written, for messages and to be checked; `pixels`: how many the image has, if that
    /// is known.
    pub(crate) fn targets(&self, pixels: u64) -> Vec<Target> {
        let Outputs { image, half, preview, stats, further, denoised_layer, layers, .. } =
            &self.outputs;
        let of_image = self.overrides.image.is_some();
        let at = |key: &str, by_option: bool| (!by_option).then(|| self.places.at(key));
        // Colour and alpha; variances and what was asked for in single precision; the job's text.
        let picture = if *half { 4 * 2 } else { 4 * 4 };
        let channels: usize = further.iter().map(|layer| layer.channels.len()).sum();
        let denoised = if *denoised_layer { DENOISED_CHANNELS.len() } else { 0 };
        let of_layers = 4 * (VARIANCE.channels.len() + channels + denoised) as u64;
        let per_pixel = if *layers == LayersTo::Image { picture + of_layers } else { picture };
        let mut targets = vec![Target {
            what: "the image",
            path: image.clone(),
            at: at("/output/image", of_image),
            bytes: pixels.saturating_mul(per_pixel).saturating_add(1 << 12),
            remedy: "name another file: `image` under `output`, or -o on the command line",
        }];
        targets.extend(preview.iter().map(|path| Target {
            what: "the preview",
            path: path.clone(),
            at: at("/output/preview", self.overrides.preview.is_some() || of_image),
            bytes: pixels.saturating_mul(3),
            remedy: "name another file: `preview` under `output`, or --preview on the command \
                     line; null or --no-preview for none",
        }));
        if let LayersTo::File(path) = layers {
            targets.push(Target {
                what: "the file of layers",
                path: path.clone(),
                at: at("/output/layers", of_image),
                bytes: pixels.saturating_mul(of_layers).saturating_add(1 << 12),
                remedy: "name another file: `layers` under `output`; null or --no-layers for none",
            });
        }
        targets.extend(stats.iter().map(|path| Target {
            what: "the statistics file",
            path: path.clone(),
            at: at("/output/stats", of_image),
            bytes: 1 << 14,
            remedy: "name another file: `stats` under `output`; null or --no-stats for none",
        }));
        targets.extend(self.overrides.save_job.iter().map(|path| Target {
            what: "the saved job",
            path: path.clone(),
            at: None,
            bytes: 1 << 12,
            remedy: "name another file",
        }));
        targets
    }
}

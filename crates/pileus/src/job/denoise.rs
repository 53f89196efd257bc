//! How the picture is freed of noise.

use pileus_media::method::Named;
use pileus_scene::{ByName, options};

options! {
    /// How the picture is freed of noise. The image itself never is.
    #[derive(Default)]
    pub struct DenoiseSpec {
        /// When the picture to look at, and the layer `denoised` if it is asked for, is denoised.
        when: ByName<DenoiseWhen> = ByName(DenoiseWhen::End);
    }
}

/// When the picture is denoised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DenoiseWhen {
    /// Once, when it has all its samples.
    #[default]
    End,
    /// Not at all.
    Never,
}

impl Named for DenoiseWhen {
    const ALL: &'static [DenoiseWhen] = &[DenoiseWhen::End, DenoiseWhen::Never];
    const TITLE: &'static str = "Denoising";
    const QUESTION: &'static str = "When the picture to look at is denoised";

    fn name(self) -> &'static str {
        match self {
            DenoiseWhen::End => "end",
            DenoiseWhen::Never => "never",
        }
    }

    fn about(self) -> &'static str {
        match self {
            DenoiseWhen::End => "When it has all its samples, if these are four a pixel or more.",
            DenoiseWhen::Never => "Not at all: what is shown has the noise of the image.",
        }
    }
}

//! From settings to a scene.

use std::borrow::Cow;
use std::time::Instant;

use pileus_scene::volume::NAME_THE_GRID;
use pileus_scene::{Error, Loaded, Scene, SceneRequest};

use super::Settings;
use super::places::Places;
use crate::escape;
use crate::failure::Failure;

impl Settings {
    /// Loads all files and builds the scene.
    ///
    /// # Errors
    /// If a file cannot be read, or what it holds cannot be rendered.
    pub fn load(&self) -> Result<Loaded, Failure> {
        let start = Instant::now();
        let environment = self.lights.environment(&self.places)?;
        let seconds = start.elapsed().as_secs_f64();
        let mut loaded = Scene::load(SceneRequest {
            gltf: self.gltf.clone(),
            glass_rule: self.glass_rule,
            volumes: self.volumes.clone(),
            volume_place: &|i, key| self.places.at(&format!("/volumes/{i}{key}")),
            camera: self.camera.clone(),
            lens: self.lens.clone(),
            lights: self.lights.lights.clone(),
            environment,
            resolution: self.resolution,
            default_scale: self.default_scale,
        })
        .map_err(|error| self.in_words_of_options(error))?;
        loaded.seconds_load += seconds;
        show_safely(&mut loaded);
        Ok(loaded)
    }

    /// Errors about volumes that were given on the command line speak of its options.
    fn in_words_of_options(&self, error: Error) -> Failure {
        if matches!(self.places, Places::Job(_)) || self.gltf.is_some() {
            return error.into();
        }
        match error {
            Error::Missing { place, what, remedy } => {
                let remedy = remedy.replace(NAME_THE_GRID, "name one with --grid NAME");
                Error::Missing { place, what, remedy }.into()
            }
            // Nobody but `--grid` names a grid here.
            Error::Vdb { source, .. } if matches!(*source, pileus_vdb::Error::Missing { .. }) => {
                Failure::usage(source.to_string(), "name a grid of the file with --grid NAME")
            }
            other => other.into(),
        }
    }
}

/// Names from files reach the terminal, the plan and the metadata: without control characters.
fn show_safely(loaded: &mut Loaded) {
    let names = loaded.scene.volumes.iter_mut().map(|volume| &mut volume.name);
    let sentences = loaded.notes.iter_mut().chain(&mut loaded.scene.not_modelled);
    for text in names.chain(sentences) {
        if let Cow::Owned(safe) = escape::line(text) {
            *text = safe;
        }
    }
}

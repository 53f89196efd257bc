//! `pileus check`.

use crate::cli::InputOptions;
use crate::command::{Prepared, prepare_to_write};
use crate::failure::Failure;
use crate::report::Report;
use crate::settings::Overrides;

pub(crate) fn run(options: &InputOptions, report: &Report) -> Result<(), Failure> {
    // No path is traced: it takes as long as loading does.
    let overrides = Overrides::default();
    let Prepared { settings, loaded, film, .. } = prepare_to_write(options, &overrides)?;
    let [width, height] = loaded.scene.camera.resolution();
    let environment = match &loaded.scene.environment {
        environment if environment.image.is_some() => "an image",
        environment if environment.is_black() => "none",
        _ => "constant",
    };
    report.text(format_args!(
        "{}: good; {} volumes, {} lights, environment: {environment}, {width} x {height} pixels, {} \
         samples per pixel",
        options.input.display(),
        loaded.scene.volumes.len(),
        loaded.scene.lights.len(),
        settings.render.samples.end,
    ));
    report.text(format_args!("  {film}"));
    // The job itself is named above.
    for file in settings.reads(Some(&loaded)).iter().skip(1) {
        report.text(format_args!("  reads {}", file.display()));
    }
    for target in settings.targets(0) {
        report.text(format_args!("  writes {}", target.path.display()));
    }
    Ok(())
}

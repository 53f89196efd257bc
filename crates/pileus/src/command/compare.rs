//! `pileus compare`.

use std::path::Path;

use pileus_film::{
    ColorSpace, Curve, ExrSettings, Image, ToneMap, read_exr, read_exr_header, write_exr, write_png,
};
use pileus_lab::{CompareSettings, Comparison, compare_with, difference_image, difference_view};

use crate::cli::CompareOptions;
use crate::failure::Failure;
use crate::outputs::{self, Target};
use crate::report::Report;
use crate::settings::layers_beside;

pub(crate) fn run(options: &CompareOptions, report: &Report) -> Result<(), Failure> {
    let png = match options.difference.as_ref().map(|path| path.extension()) {
        None => false,
        Some(Some(extension)) if extension.eq_ignore_ascii_case("png") => true,
        Some(Some(extension)) if extension.eq_ignore_ascii_case("exr") => false,
        Some(_) => {
            let what = "the difference image is neither .exr nor .png";
            return Err(Failure::usage(what, "name it .exr (signed values) or .png (to look at)"));
        }
    };
    if let Some(path) = &options.difference {
        let target = Target::by_option("the difference image", path, 0);
        let [a, b] = [&options.a, &options.b].map(|path| [path.clone(), layers_beside(path)]);
        outputs::check(&[a, b].concat(), &[target])?;
    }
    let (a, b) = (read_with_variance(&options.a)?, read_with_variance(&options.b)?);
    let (space_a, space_b) = (color_space(&options.a)?, color_space(&options.b)?);
    if space_a != space_b {
        tracing::warn!("A is in {space_a}, B in {space_b}: their numbers are compared as they are");
    }
    let settings =
        CompareSettings { exposure_stops: options.exposure, ..CompareSettings::default() };
    let comparison = compare_with(&a, &b, &settings)?;
    if let Some(path) = &options.difference {
        let difference = difference_image(&a, &b)?;
        if png {
            let tone = ToneMap { exposure_stops: 0.0, curve: Curve::Srgb };
            write_png(path, &difference_view(&difference, options.gain)?, &tone)?;
        } else {
            write_exr(path, &difference, &ExrSettings::default())?;
        }
    }
    if options.json {
        report.json(&comparison);
    } else {
        report.text(table(&comparison));
    }
    Ok(())
}

/// An image with its layer `variance`: its own, or that of the file of layers beside it where that
/// is from the same render.
fn read_with_variance(path: &Path) -> Result<Image, Failure> {
    let mut image = read_exr(path)?;
    if image.rgb_planes().is_none() {
        let names: Vec<_> = image.channels().iter().map(|c| c.name.as_str()).collect();
        return Err(Failure::NoColor { path: path.to_owned(), names: names.join(", ") });
    }
    let beside = layers_beside(path);
    if image.layer("variance").is_some() || !beside.is_file() {
        return Ok(image);
    }
    let layers = read_exr(&beside)?;
    let same = ["pileus:version", "pileus:job_hash", "pileus:samples"]
        .iter()
        .all(|name| image.meta(name).is_some() && image.meta(name) == layers.meta(name));
    match layers.layer("variance") {
        Some(variance) if same && layers.data_window() == image.data_window() => {
            image.add_layer("variance", &variance)?;
        }
        _ => tracing::warn!(
            "{} is not from the render of {}: its variance is not used",
            beside.display(),
            path.display()
        ),
    }
    Ok(image)
}

/// What the first part of an image says its colours are in.
fn color_space(path: &Path) -> Result<ColorSpace, Failure> {
    let header = read_exr_header(path)?;
    let part = header.parts.first();
    let id = part.and_then(|part| part.color_interop_id.as_deref());
    Ok(ColorSpace::of_exr(id, part.and_then(|part| part.chromaticities)).0)
}

fn table(c: &Comparison) -> String {
    let rgb = |v: [f64; 3]| format!("{:>12.6} {:>12.6} {:>12.6}", v[0], v[1], v[2]);
    let noise =
        |v: Option<f64>| v.map_or(String::new(), |v| format!("  (noise of A alone {v:.6e})"));
    let mut lines = vec![
        format!("size        {} x {}", c.width, c.height),
        format!("MSE         {:.6e}{}", c.mse, noise(c.mse_noise_a)),
        format!("relMSE      {:.6e}{}", c.rel_mse, noise(c.rel_mse_noise_a)),
    ];
    if let Some(flip) = c.flip {
        lines.push(format!("FLIP        {flip:.6}"));
    }
    lines.push(format!("mean A      {}", rgb(c.mean_a)));
    if let Some(stderr) = c.stderr_a {
        lines.push(format!("  std. err. {}", rgb(stderr)));
    }
    lines.push(format!("mean B      {}", rgb(c.mean_b)));
    if let Some(stderr) = c.stderr_b {
        lines.push(format!("  std. err. {}", rgb(stderr)));
    }
    lines.push(format!("A - B       {}", rgb(c.mean_difference)));
    lines.push(format!("  std. err. {}", rgb(c.stderr_difference)));
    lines.push(format!("largest     {:.6}", c.max_difference));
    if c.skipped_pixels > 0 {
        lines.push(format!("skipped     {} pixels that are not finite in both", c.skipped_pixels));
    }
    lines.join("\n")
}

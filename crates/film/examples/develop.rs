//! Develops an EXR into a PNG: `cargo run --example develop -- in.exr out.png [stops] [srgb]`.

use std::path::Path;

use pileus_film::{Curve, ToneMap, read_exr, write_png};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, rest @ ..] = arguments.as_slice() else {
        return Err("usage: develop in.exr out.png [stops] [srgb]".into());
    };
    let mut tone = ToneMap::default();
    if let Some(stops) = rest.first() {
        tone.exposure_stops = stops.parse()?;
    }
    if rest.get(1).is_some_and(|curve| curve == "srgb") {
        tone.curve = Curve::Srgb;
    }
    write_png(Path::new(output), &read_exr(Path::new(input))?, &tone)?;
    Ok(())
}

//! The memory that is announced is the memory that is taken; alone in its program, which it weighs.

use pileus_film::{Film, FilmMemory, Layer, PixelSample, Reconstruction, SAMPLES};

static PAIR: Layer = Layer {
    name: "pair",
    meaning: "two means",
    channels: &["pair.X", "pair.Y"],
    reconstruction: Reconstruction::Mean(|sample, _, values| {
        values.copy_from_slice(&sample.rgb[..2]);
    }),
};

/// Bytes of this program that are in memory; None where the system does not tell.
fn resident() -> Option<i64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(line.split_whitespace().next()?.parse::<i64>().ok()? * 1024)
}

#[test]
fn a_film_and_a_pass_take_what_was_announced() {
    let (resolution, further) = ([960, 540], [&SAMPLES, &PAIR]);
    let before = resident();
    let memory = FilmMemory::of(resolution, None, &further, 1000).unwrap();
    let mut film = Film::with_layers(resolution, None, &further).unwrap();
    let pass = film.samples_per_pass();
    let rectangles = film.tiles(16);
    let mut tiles: Vec<_> =
        rectangles.into_iter().map(|(x, y, w, h)| film.tile(x, y, w, h)).collect();
    for tile in &mut tiles {
        tile.start(0..pass).unwrap();
        assert!(tile.add(tile.x0, tile.y0, 0, &PixelSample::default()));
    }
    film.add_tiles(&tiles).unwrap();
    // 303 MB of sums and 100 MB or less of samples; some MB of the program's come on top.
    assert!(memory.total() > 350_000_000, "{memory:?}");
    if let (Some(before), Some(after)) = (before, resident()) {
        let ratio = (after - before) as f64 / memory.total() as f64;
        assert!((0.98..1.02).contains(&ratio), "{ratio} of {memory:?}");
    }
}

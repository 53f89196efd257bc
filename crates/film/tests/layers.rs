//! The layers of a film, and what they cost.

use pileus_film::{Crop, Error, Film, FilmMemory, Layer, Reconstruction, SAMPLES};

static PAIR: Layer = Layer {
    name: "pair",
    meaning: "two means",
    channels: &["pair.X", "pair.Y"],
    reconstruction: Reconstruction::Mean(|sample, _, values| {
        values.copy_from_slice(&sample.rgb[..2]);
    }),
};

#[test]
fn layers_cost_what_they_sum() {
    let (resolution, pixels) = ([64, 36], 64 * 36);
    for (further, per_pixel, per_sample) in
        [(vec![], 552, 16), (vec![&SAMPLES], 552, 16), (vec![&SAMPLES, &PAIR], 552 + 2 * 16, 24)]
    {
        let memory = FilmMemory::of(resolution, None, &further, 1000).unwrap();
        let film = Film::with_layers(resolution, None, &further).unwrap();
        assert_eq!(memory.sums, per_pixel * pixels);
        assert_eq!(film.allocated_bytes(), memory.sums);
        let pass = film.samples_per_pass();
        assert_eq!(memory.tiles, per_sample * pixels * pass.min(1000));
        assert_eq!(memory.total(), memory.sums + memory.tiles);
    }
}

#[test]
fn the_tiles_of_a_pass_stay_small_beside_the_sums() {
    let of = |resolution, samples| FilmMemory::of(resolution, None, &[], samples).unwrap();
    // Eight samples of 16 bytes beside 552.
    let large = of([1920, 1080], 4096);
    assert_eq!(large.tiles, 1920 * 1080 * 8 * 16);
    assert!(large.total() < large.sums * 5 / 4);
    // Small films have long passes, up to 64 MiB, but not longer than the render.
    assert_eq!(of([64, 64], 1 << 20).tiles, 1 << 26);
    assert_eq!(of([64, 64], 3).tiles, 64 * 64 * 3 * 16);
    assert_eq!(of([64, 64], 0).tiles, 0);
    // The largest film that there is, without taking any of it.
    assert_eq!(of([1 << 14, 1 << 14], 64).sums, 552 << 28);
    let crop = Some(Crop { x0: 1, y0: 1, width: 10, height: 10 });
    assert_eq!(FilmMemory::of([1 << 20, 1 << 20], crop, &[], 1).unwrap().sums, 55200);
    let error = FilmMemory::of([1 << 20, 1 << 20], None, &[], 1).unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
}

#[test]
fn layers_that_cannot_be_are_refused() {
    static SAME_NAME: Layer = Layer { channels: &["other.X"], ..PAIR };
    static SAME_CHANNEL: Layer = Layer { name: "other", ..PAIR };
    static OWN_TWICE: Layer = Layer { channels: &["a.X", "a.X"], ..PAIR };
    static ALPHA_AGAIN: Layer = Layer { name: "more", channels: &["A"], ..PAIR };
    static NO_CHANNELS: Layer = Layer { channels: &[], ..PAIR };
    static NO_NAME: Layer = Layer { name: "", ..PAIR };
    static NUL: Layer = Layer { channels: &["a\0b"], ..PAIR };
    let refused = |layers: &[&'static Layer]| {
        let error = Film::with_layers([1, 1], None, layers).unwrap_err();
        assert!(matches!(error, Error::Invalid { .. }), "{error}");
        let before = FilmMemory::of([1, 1], None, layers, 1).unwrap_err();
        assert_eq!(error.to_string(), before.to_string());
    };
    refused(&[&PAIR, &SAME_NAME]);
    refused(&[&PAIR, &SAME_CHANNEL]);
    for layer in [&OWN_TWICE, &ALPHA_AGAIN, &NO_CHANNELS, &NO_NAME, &NUL] {
        refused(&[layer]);
    }
    // What is there already is not added twice.
    let film = Film::with_layers([1, 1], None, &[&PAIR, &PAIR, &pileus_film::BEAUTY]).unwrap();
    assert_eq!(film.layers().len(), 4);
}

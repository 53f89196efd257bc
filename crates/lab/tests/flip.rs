//! FLIP against the authors' program, and what follows from its definition.

use pileus_lab::flip_rgb8;

/// A picture of waves, noise and a hard edge, the same everywhere.
fn picture(width: usize, height: usize, seed: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    for y in 0..height {
        for x in 0..width {
            for c in 0..3u32 {
                let mut hash = (x as u32) ^ (y as u32).rotate_left(11) ^ c.rotate_left(22) ^ seed;
                hash = hash.wrapping_mul(0x9e37_79b1).rotate_right(15).wrapping_mul(0x85eb_ca77);
                let noise = (hash >> 24) as f64;
                let edge = if x * 2 > width { 90.0 } else { 0.0 };
                let ramp = 60.0 * (y as f64) / height as f64 + 10.0 * f64::from(c);
                bytes.push((edge + ramp + noise * 0.3) as u8);
            }
        }
    }
    bytes
}

/// Means and pixels by the authors' C++ program (nv-flip 0.1.2 with its default of 67 pixels per
/// degree) on the same pictures. All pixels of the two programs differed by less than 3e-6.
#[test]
fn agrees_with_the_authors() {
    type Case = ([usize; 2], [u32; 2], f64, [f32; 4]);
    let cases: [Case; 3] = [
        ([64, 48], [1, 2], 0.121_121_955_7, [0.296_755_4, 0.173_915_2, 0.339_069_6, 0.242_291_2]),
        ([7, 5], [3, 4], 0.228_360_702_3, [0.235_359_8, 0.111_850_4, 0.381_189_9, 0.178_571]),
        ([33, 70], [5, 900], 0.547_443_496_7, [0.361_913_9, 0.473_738, 0.560_115_9, 0.440_906_7]),
    ];
    for ([width, height], seeds, mean, pixels) in cases {
        let [a, mut b] = seeds.map(|seed| picture(width, height, seed));
        if seeds[1] == 900 {
            // A tint, for differences near the end of the scale.
            b.iter_mut().step_by(3).for_each(|red| *red = red.saturating_add(70));
        }
        let map = flip_rgb8(&a, &b, width);
        let own = map.iter().map(|&v| f64::from(v)).sum::<f64>() / map.len() as f64;
        assert!((own - mean).abs() < 1e-5, "{own} instead of {mean}");
        let at = [0, map.len() / 2, map.len() - 1, map.len() / 3];
        for (place, expected) in at.into_iter().zip(pixels) {
            assert!((map[place] - expected).abs() < 1e-5, "{place}: {} for {expected}", map[place]);
        }
    }
}

#[test]
fn equal_pictures_have_no_error_and_order_does_not_matter() {
    let [a, b] = [1, 2].map(|seed| picture(20, 9, seed));
    assert!(flip_rgb8(&a, &a, 20).iter().all(|&v| v == 0.0));
    assert_eq!(flip_rgb8(&a, &b, 20), flip_rgb8(&b, &a, 20));
    // As far apart as colours can be, without an edge: all of the scale but for its upper end.
    let far = flip_rgb8(&[0, 255, 0].repeat(100), &[0, 0, 255].repeat(100), 10);
    assert!(far.iter().all(|&v| (0.999..=1.0).contains(&v)), "{far:?}");
    assert!(flip_rgb8(&[], &[], 0).is_empty());
    assert_eq!(flip_rgb8(&[9, 9, 9], &[9, 9, 9], 1), [0.0]);
}

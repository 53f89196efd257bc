//! Files appear whole or not at all; PNG previews hold what was asked for.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use pileus_film::{
    Curve, Error, Image, MetaValue, ToneMap, preview_rgb8, srgb_encode, write_atomically, write_png,
};

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn a_failed_write_leaves_the_old_file_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stats.json");
    write_atomically(&path, |w| w.write_all(b"old")).unwrap();

    let error = write_atomically(&path, |w| {
        w.write_all(&[1; 1 << 20])?;
        Err::<(), _>(io::Error::other("disk full"))
    });
    assert!(matches!(error, Err(Error::Io { .. })));
    let panic = std::panic::catch_unwind(|| {
        let _ = write_atomically(&path, |w| -> io::Result<()> {
            w.write_all(&[1; 1 << 20])?;
            panic!("in the middle");
        });
    });
    let message = panic.unwrap_err().downcast::<&str>().unwrap();
    assert_eq!(*message, "in the middle");
    assert_eq!(names(folder.path()), ["stats.json"]);
    assert_eq!(fs::read(&path).unwrap(), b"old");

    let length = write_atomically(&path, |w| w.write_all(b"newer").map(|()| 5)).unwrap();
    assert_eq!((length, fs::read(&path).unwrap()), (5, b"newer".to_vec()));
    assert_eq!(names(folder.path()), ["stats.json"]);
}

#[test]
fn targets_that_cannot_be_are_errors_without_traces() {
    let folder = tempfile::tempdir().unwrap();
    let write = |path: &Path| write_atomically(path, |w| w.write_all(b"x"));
    let missing = write(&folder.path().join("no/such/folder/a.exr")).unwrap_err();
    assert!(matches!(missing, Error::Io { .. }), "{missing}");
    assert!(missing.to_string().contains("check that the folder exists"));
    assert!(matches!(write(Path::new("/")), Err(Error::Invalid { .. })));
    assert!(matches!(write(&folder.path().join("..")), Err(Error::Invalid { .. })));
    // A folder of that name is in the way.
    fs::create_dir(folder.path().join("a.exr")).unwrap();
    fs::write(folder.path().join("a.exr/content"), b"").unwrap();
    let taken = write(&folder.path().join("a.exr")).unwrap_err();
    assert!(matches!(taken, Error::Io { .. }), "{taken}");
    assert!(taken.place() == folder.path().join("a.exr"), "{taken}");
    assert!(taken.to_string().contains("put a file where a folder is"), "{taken}");
    assert_eq!(names(folder.path()), ["a.exr"]);
}

#[test]
fn the_file_is_not_visible_while_it_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bin");
    write_atomically(&path, |w| {
        w.write_all(b"part")?;
        w.flush()?;
        assert!(!path.exists());
        Ok(())
    })
    .unwrap();
    assert!(path.exists());
}

#[test]
fn png_decodes_to_the_preview() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ramp.png");
    let mut image = Image::new(64, 3, &["R", "G", "B", "A"]).unwrap();
    for x in 0..64 {
        let v = x as f32 / 32.0;
        for (y, name) in ["R", "G", "B"].into_iter().enumerate() {
            assert!(image.set(name, x, y as u32, v));
        }
    }
    for curve in [Curve::Srgb, Curve::Filmic] {
        let tone = ToneMap { exposure_stops: -0.5, curve };
        write_png(&path, &image, &tone).unwrap();
        let decoded = image::open(&path).unwrap();
        assert_eq!(decoded.color(), image::ColorType::Rgb8);
        let decoded = decoded.into_rgb8();
        assert_eq!(decoded.dimensions(), (64, 3));
        assert_eq!(decoded.as_raw(), &preview_rgb8(&image, &tone).unwrap());
        if curve == Curve::Srgb {
            for x in 0..64 {
                let expected = srgb_encode(x as f32 / 32.0 * 0.5f32.sqrt()) * 255.0;
                let pixel = decoded.get_pixel(x, 1).0;
                assert!((f32::from(pixel[1]) - expected).abs() <= 0.501);
                assert_eq!([pixel[0], pixel[2]], [0, 0]);
            }
        }
    }
    assert_eq!(names(folder.path()), ["ramp.png"]);
}

#[test]
fn grey_images_are_shown_and_colourless_ones_refused() {
    let mut grey = Image::new(1, 1, &["Y"]).unwrap();
    grey.set("Y", 0, 0, 0.5);
    let tone = ToneMap { exposure_stops: 0.0, curve: Curve::Srgb };
    assert_eq!(preview_rgb8(&grey, &tone).unwrap(), [188; 3]);
    // A single channel is grey, whatever its name; of two without a meaning none is.
    let mut single = Image::new(1, 1, &["V"]).unwrap();
    single.set("V", 0, 0, 0.5);
    assert_eq!(preview_rgb8(&single, &tone).unwrap(), [188; 3]);
    let motion = Image::new(1, 1, &["X", "Z"]).unwrap();
    let error = preview_rgb8(&motion, &tone).unwrap_err();
    assert!(error.to_string().contains("its channels are X, Z"), "{error}");
}

#[test]
fn images_check_what_they_are_given() {
    let empty = Image::new(0, 1, &["R"]).unwrap_err();
    assert!(matches!(empty, Error::Invalid { .. }), "{empty}");
    assert!(empty.to_string().contains("0 x 1 pixels"), "{empty}");
    assert!(matches!(Image::new(1 << 16, 1 << 15, &["R"]), Err(Error::TooLarge { .. })));
    let mut image = Image::new(2, 2, &["R"]).unwrap();
    for (name, values, says) in [
        ("R", 4, "has a channel of that name"),
        ("", 4, "the name cannot be stored"),
        ("G", 3, "3 values"),
    ] {
        let error = image.add_channel(name, vec![0.0; values]).unwrap_err();
        assert!(matches!(error, Error::Invalid { .. }), "{error}");
        assert_eq!(error.place(), Path::new(&format!("channel {name:?}")));
        assert!(error.to_string().contains(says), "{error}");
    }
    assert!(image.add_channel("G", vec![0.0; 4]).is_ok());
    assert!(!image.set("G", 2, 0, 1.0) && !image.set("Z", 0, 0, 1.0));
    assert_eq!(image.get("G", 0, 2), None);
    assert_eq!(image.layer("variance"), None);
    image.metadata.push(("a".into(), MetaValue::I32(1)));
    assert_eq!(image.meta("a"), Some(&MetaValue::I32(1)));
}

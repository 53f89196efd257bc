//! What a file is that is named as a VDB file and is none.

use crate::error::{Fault, REWRITE};

/// First bytes, what they mean, and what to do about it.
const KNOWN: [(&[u8], &str, &str); 13] = [
    (b"NanoVDB", NANO, NANO_REMEDY),
    (b"\x1f\x8b", "the file is packed by gzip", UNPACK),
    (b"PK\x03\x04", "the file is a zip archive", UNPACK),
    (b"\x28\xb5\x2f\xfd", "the file is packed by zstd", UNPACK),
    (b"\xfd7zXZ\0", "the file is packed by xz", UNPACK),
    (b"BZh", "the file is packed by bzip2", UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "the file is a 7z archive", UNPACK),
    (
        b"version https://git-lfs",
        "the file is a pointer of git-lfs that stands for the VDB file",
        "fetch the file itself by `git lfs pull`",
    ),
    (b"\x89HDF", "the file is HDF5", CONVERT),
    (b"Field3D", "the file is Field3D", CONVERT),
    (b"<", "the file is a text, perhaps a web page saved in its place", "download the file again"),
    (b"{", "the file is a text that begins as JSON", "give the path of a file written by OpenVDB"),
    (b"glTF", "the file is a binary glTF scene", "name it .glb, and its volumes inside of it"),
];
const NANO: &str = "the file is NanoVDB, not OpenVDB";
const NANO_REMEDY: &str = "convert it, for instance by `nanovdb_convert in.nvdb out.vdb`";
const UNPACK: &str = "unpack it first";
const CONVERT: &str = "convert it to OpenVDB";

/// The error for a file that begins with these bytes, which are not those of a VDB file.
pub(crate) fn fault(start: &[u8]) -> Fault {
    if start.is_empty() {
        let remedy = "write, copy or download the file again";
        return Fault::invalid_with(0, "the file is empty", remedy);
    }
    if b" BDV\0\0\0\0".starts_with(start) {
        return Fault::invalid_with(0, "the file is cut off in its first bytes", REWRITE);
    }
    match KNOWN.iter().find(|(magic, ..)| start.starts_with(magic)) {
        Some((_, what, remedy)) => Fault::unsupported(0, *what, remedy),
        // The magic number of NanoVDB's grids may also stand in the other order of bytes.
        None if start.starts_with(b"BDVonaN") || start.get(1..8) == Some(b"BDVonaN") => {
            Fault::unsupported(0, NANO, NANO_REMEDY)
        }
        None => Fault::unsupported(
            0,
            "this is no VDB file",
            "give the path of a file written by OpenVDB",
        ),
    }
}

#[cfg(test)]
mod tests {
    use crate::{Error, VdbFile};

    #[test]
    fn files_of_other_kinds_are_named_with_the_way_out() {
        let lfs = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n";
        for (bytes, what, remedy) in [
            (&b"NanoVDB2\0\0\0\0"[..], "NanoVDB", "nanovdb_convert"),
            (b"NanoVDB0", "NanoVDB", "nanovdb_convert"),
            (b"0BDVonaN", "NanoVDB", "nanovdb_convert"),
            (b"\x1f\x8b\x08\0\0\0\0\0\0", "gzip", "unpack"),
            (b"\x28\xb5\x2f\xfd\0\0", "zstd", "unpack"),
            (b"PK\x03\x04\0\0\0\0", "zip", "unpack"),
            (lfs, "git-lfs", "git lfs pull"),
            (b"<!DOCTYPE html>", "web page", "download"),
            (b"anything at all", "no VDB file", "OpenVDB"),
        ] {
            let error = VdbFile::from_bytes("a.vdb", bytes.to_vec()).unwrap_err();
            assert!(matches!(error, Error::Unsupported { .. }), "{error}");
            let text = error.to_string();
            assert!(text.contains(what) && text.contains(remedy), "{text}");
        }
        for (bytes, what) in [(&b""[..], "empty"), (b" BDV\0\0", "cut off"), (b" BDV", "cut off")] {
            let error = VdbFile::from_bytes("a.vdb", bytes.to_vec()).unwrap_err();
            assert!(matches!(error, Error::Invalid { .. }), "{error}");
            assert!(error.to_string().contains(what), "{error}");
        }
    }
}

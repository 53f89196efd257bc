//! Named values that a file or a grid carries beside its voxels.

use std::fmt;

use crate::cursor::Cursor;
use crate::error::Fault;

/// One metadata value. Types this crate does not know are kept as bytes.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the variants are named after the types they hold")]
pub enum MetaValue {
    Bool(bool),
    Int32(i32),
    Int64(i64),
    Float(f32),
    Double(f64),
    String(String),
    Vec2i([i32; 2]),
    Vec2f([f32; 2]),
    Vec2d([f64; 2]),
    Vec3i([i32; 3]),
    Vec3f([f32; 3]),
    Vec3d([f64; 3]),
    Vec4i([i32; 4]),
    Vec4f([f32; 4]),
    Vec4d([f64; 4]),
    /// Row by row.
    Mat4f([f32; 16]),
    /// Row by row.
    Mat4d([f64; 16]),
    /// A type of another name, or a known one whose length is not the usual.
    Unknown {
        type_name: String,
        bytes: Vec<u8>,
    },
}

fn elements<const N: usize, const SIZE: usize, T: Copy + Default>(
    bytes: &[u8],
    read: fn([u8; SIZE]) -> T,
) -> Option<[T; N]> {
    if bytes.len() != N * SIZE {
        return None;
    }
    let mut out = [T::default(); N];
    for (value, chunk) in out.iter_mut().zip(bytes.chunks_exact(SIZE)) {
        *value = read(chunk.try_into().ok()?);
    }
    Some(out)
}

impl MetaValue {
    fn parse(type_name: &str, bytes: &[u8]) -> Option<MetaValue> {
        use MetaValue::*;
        Some(match type_name {
            "bool" => Bool(*elements::<1, 1, u8>(bytes, |b| b[0])?.first()? != 0),
            "int32" => Int32(*elements::<1, 4, _>(bytes, i32::from_le_bytes)?.first()?),
            "int64" => Int64(*elements::<1, 8, _>(bytes, i64::from_le_bytes)?.first()?),
            "float" => Float(*elements::<1, 4, _>(bytes, f32::from_le_bytes)?.first()?),
            "double" => Double(*elements::<1, 8, _>(bytes, f64::from_le_bytes)?.first()?),
            "string" => String(std::string::String::from_utf8_lossy(bytes).into_owned()),
            "vec2i" => Vec2i(elements(bytes, i32::from_le_bytes)?),
            "vec2s" => Vec2f(elements(bytes, f32::from_le_bytes)?),
            "vec2d" => Vec2d(elements(bytes, f64::from_le_bytes)?),
            "vec3i" => Vec3i(elements(bytes, i32::from_le_bytes)?),
            "vec3s" => Vec3f(elements(bytes, f32::from_le_bytes)?),
            "vec3d" => Vec3d(elements(bytes, f64::from_le_bytes)?),
            "vec4i" => Vec4i(elements(bytes, i32::from_le_bytes)?),
            "vec4s" => Vec4f(elements(bytes, f32::from_le_bytes)?),
            "vec4d" => Vec4d(elements(bytes, f64::from_le_bytes)?),
            "mat4s" => Mat4f(elements(bytes, f32::from_le_bytes)?),
            "mat4d" => Mat4d(elements(bytes, f64::from_le_bytes)?),
            _ => return None,
        })
    }
}

fn list<T: fmt::Debug>(f: &mut fmt::Formatter<'_>, values: &[T]) -> fmt::Result {
    f.write_str("(")?;
    for (index, value) in values.iter().enumerate() {
        write!(f, "{}{value:?}", if index == 0 { "" } else { ", " })?;
    }
    f.write_str(")")
}

impl fmt::Display for MetaValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MetaValue::Bool(v) => write!(f, "{v}"),
            MetaValue::Int32(v) => write!(f, "{v}"),
            MetaValue::Int64(v) => write!(f, "{v}"),
            MetaValue::Float(v) => write!(f, "{v:?}"),
            MetaValue::Double(v) => write!(f, "{v:?}"),
            MetaValue::String(v) => f.write_str(v),
            MetaValue::Vec2i(v) => list(f, v),
            MetaValue::Vec2f(v) => list(f, v),
            MetaValue::Vec2d(v) => list(f, v),
            MetaValue::Vec3i(v) => list(f, v),
            MetaValue::Vec3f(v) => list(f, v),
            MetaValue::Vec3d(v) => list(f, v),
            MetaValue::Vec4i(v) => list(f, v),
            MetaValue::Vec4f(v) => list(f, v),
            MetaValue::Vec4d(v) => list(f, v),
            MetaValue::Mat4f(v) => list(f, v),
            MetaValue::Mat4d(v) => list(f, v),
            MetaValue::Unknown { type_name, bytes } => {
                write!(f, "<{} bytes of type {type_name}>", bytes.len())
            }
        }
    }
}

/// Metadata of a file or a grid, in the order of the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Metadata {
    items: Vec<(String, MetaValue)>,
}

impl Metadata {
    /// The value of that name; of several the last, as in OpenVDB.
    pub fn get(&self, name: &str) -> Option<&MetaValue> {
        self.items.iter().rev().find(|(key, _)| key == name).map(|(_, value)| value)
    }

    /// The text of that name, if it is text.
    pub fn text(&self, name: &str) -> Option<&str> {
        match self.get(name) {
            Some(MetaValue::String(text)) => Some(text),
            _ => None,
        }
    }

    /// All names with their values, in the order of the file.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &MetaValue)> {
        self.items.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    #[cfg(any(test, feature = "vdb-rs"))]
    pub(crate) fn from_items(items: impl Iterator<Item = (String, MetaValue)>) -> Metadata {
        let mut items: Vec<_> = items.collect();
        items.sort_by(|a, b| a.0.cmp(&b.0));
        Metadata { items }
    }

    /// Reads a count, then name, type name, length and value of each item. The block sizes that
    /// OpenVDB keeps for its delayed loading (type `__delayedload`) are of no use to a reader that
    /// scans, and are dropped like all types with that prefix.
    pub(crate) fn read(cursor: &mut Cursor<'_>) -> Result<Metadata, Fault> {
        let count = cursor.u32("the number of metadata items")?;
        cursor.check_count(count.into(), 12, "metadata items")?;
        let mut items = Vec::new();
        for _ in 0..count {
            let name = cursor.string("a metadata name")?;
            let type_name = cursor.string("a metadata type")?;
            let size = cursor.u32("the size of a metadata value")?;
            let bytes = cursor.take(size as usize, "a metadata value")?;
            if type_name.starts_with("__") {
                continue;
            }
            let value = MetaValue::parse(&type_name, bytes)
                .unwrap_or_else(|| MetaValue::Unknown { type_name, bytes: bytes.to_vec() });
            items.push((name, value));
        }
        Ok(Metadata { items })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(name: &str, type_name: &str, value: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        for part in [name.as_bytes(), type_name.as_bytes(), value] {
            out.extend((part.len() as u32).to_le_bytes());
            out.extend(part);
        }
        out
    }

    fn read(items: &[Vec<u8>]) -> Metadata {
        let mut bytes = (items.len() as u32).to_le_bytes().to_vec();
        bytes.extend(items.concat());
        Metadata::read(&mut Cursor::new(&bytes, 0)).unwrap()
    }

    #[test]
    fn every_type_reads_and_prints() {
        let f = |v: &[f32]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>();
        let d = |v: &[f64]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>();
        let i = |v: &[i32]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>();
        let cases = [
            ("bool", vec![1], "true"),
            ("int32", i(&[-3]), "-3"),
            ("int64", 1i64.to_le_bytes().to_vec(), "1"),
            ("float", f(&[1.5]), "1.5"),
            ("double", d(&[2.0]), "2.0"),
            ("string", b"hello".to_vec(), "hello"),
            ("vec2i", i(&[1, 2]), "(1, 2)"),
            ("vec2s", f(&[1.0, 2.0]), "(1.0, 2.0)"),
            ("vec2d", d(&[1.0, 2.0]), "(1.0, 2.0)"),
            ("vec3i", i(&[1, 2, 3]), "(1, 2, 3)"),
            ("vec3s", f(&[1.0, 2.0, 3.0]), "(1.0, 2.0, 3.0)"),
            ("vec3d", d(&[1.0, 2.0, 3.0]), "(1.0, 2.0, 3.0)"),
            ("vec4i", i(&[1, 2, 3, 4]), "(1, 2, 3, 4)"),
            ("vec4s", f(&[1.0, 2.0, 3.0, 4.0]), "(1.0, 2.0, 3.0, 4.0)"),
            ("vec4d", d(&[1.0, 2.0, 3.0, 4.0]), "(1.0, 2.0, 3.0, 4.0)"),
            ("odd", vec![1, 2], "<2 bytes of type odd>"),
            ("int32", vec![1, 2], "<2 bytes of type int32>"),
        ];
        for (type_name, bytes, text) in cases {
            let metadata = read(&[item("key", type_name, &bytes)]);
            assert_eq!(metadata.get("key").unwrap().to_string(), text, "{type_name}");
        }
        let metadata = read(&[
            item("a", "mat4s", &f(&[0.5; 16])),
            item("b", "mat4d", &d(&[0.25; 16])),
            item("c", "__delayedload", &[0; 40]),
        ]);
        assert_eq!(metadata.get("a"), Some(&MetaValue::Mat4f([0.5; 16])));
        assert_eq!(metadata.get("b"), Some(&MetaValue::Mat4d([0.25; 16])));
        assert_eq!(metadata.len(), 2);
        assert!(!metadata.is_empty());
    }

    #[test]
    fn a_huge_count_is_refused_at_once() {
        let fault = Metadata::read(&mut Cursor::new(&[0xff; 64], 0)).unwrap_err();
        assert!(fault.into_error("f", None).to_string().contains("metadata items"));
    }
}

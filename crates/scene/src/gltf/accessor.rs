//! Accessors of a glTF file, read with every count, type and range checked.

use std::cell::RefCell;
use std::collections::HashMap;
use std::sync::Arc;

use glam::{Mat4, Vec2, Vec3, Vec4};
use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::validation::Checked;

use super::buffer::Buffers;
use crate::error::Error;

/// What an accessor is read for, which decides the types it may have (glTF 2.0, section 3.7.2.1,
/// and `KHR_mesh_quantization`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Use {
    Position,
    Normal,
    Tangent,
    Uv,
    Color,
    /// Translation or scale of an instance (`EXT_mesh_gpu_instancing`).
    Vector,
    Rotation,
    /// What a morph target adds to a position.
    PositionShift,
    /// What a morph target adds to a normal or a tangent.
    DirectionShift,
    /// Numbers of joints in a skin.
    Joints,
    /// Weights of joints.
    Weights,
    /// Inverse bind matrices, by columns.
    Matrix,
}

impl Use {
    fn types(self) -> &'static [Type] {
        match self {
            Self::Position
            | Self::Normal
            | Self::Vector
            | Self::PositionShift
            | Self::DirectionShift => &[Type::Vec3],
            Self::Tangent | Self::Rotation | Self::Joints | Self::Weights => &[Type::Vec4],
            Self::Matrix => &[Type::Mat4],
            Self::Uv => &[Type::Vec2],
            Self::Color => &[Type::Vec3, Type::Vec4],
        }
    }

    /// Whether components of this type are allowed.
    fn allows(self, component: ComponentType, normalized: bool, quantized: bool) -> bool {
        use ComponentType::{F32, I8, I16, U8, U16, U32};
        match component {
            F32 => self != Self::Joints,
            U32 => false,
            U8 | U16 => match self {
                Self::Uv => normalized || quantized,
                Self::Color | Self::Weights => normalized,
                Self::Joints => !normalized,
                Self::Position => quantized,
                _ => false,
            },
            I8 | I16 => match self {
                Self::Uv | Self::Position | Self::PositionShift => quantized,
                Self::Normal | Self::Tangent | Self::DirectionShift => quantized && normalized,
                Self::Rotation => normalized,
                _ => false,
            },
        }
    }

    /// What components that an accessor does not have are.
    fn missing<const N: usize>(self) -> [f32; N] {
        if self == Self::Color { [1.0; N] } else { [0.0; N] }
    }
}

/// Reads accessors; each is decoded once for each use.
pub(crate) struct Accessors<'a> {
    pub(crate) buffers: &'a Buffers<'a>,
    quantized: bool,
    vec2: Cache<Vec2>,
    vec3: Cache<Vec3>,
    vec4: Cache<Vec4>,
}

type Cache<T> = RefCell<HashMap<(usize, Use), Arc<[T]>>>;

/// How the elements of an accessor lie in its view.
struct Layout<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
}

fn size_of_component(component: ComponentType) -> usize {
    match component {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

/// A component at the start of `bytes`; integers as glTF's section 3.11 turns them into numbers.
fn component(bytes: &[u8], component: ComponentType, normalized: bool) -> Option<f32> {
    let scaled = |value: f32, largest: f32| {
        if normalized { (value / largest).max(-1.0) } else { value }
    };
    Some(match component {
        ComponentType::I8 => scaled(f32::from(i8::from_le_bytes(*bytes.first_chunk()?)), 127.0),
        ComponentType::U8 => scaled(f32::from(u8::from_le_bytes(*bytes.first_chunk()?)), 255.0),
        ComponentType::I16 => scaled(f32::from(i16::from_le_bytes(*bytes.first_chunk()?)), 32767.0),
        ComponentType::U16 => scaled(f32::from(u16::from_le_bytes(*bytes.first_chunk()?)), 65535.0),
        ComponentType::U32 => u32::from_le_bytes(*bytes.first_chunk()?) as f32,
        ComponentType::F32 => f32::from_le_bytes(*bytes.first_chunk()?),
    })
}

fn integer(bytes: &[u8], component: ComponentType) -> Option<u32> {
    match component {
        ComponentType::U8 => bytes.first().copied().map(u32::from),
        ComponentType::U16 => Some(u32::from(u16::from_le_bytes(*bytes.first_chunk()?))),
        ComponentType::U32 => Some(u32::from_le_bytes(*bytes.first_chunk()?)),
        _ => None,
    }
}

impl<'a> Accessors<'a> {
    pub(crate) fn new(buffers: &'a Buffers<'a>) -> Self {
        let quantized =
            buffers.root.extensions_used.iter().any(|name| name == "KHR_mesh_quantization");
        Self {
            buffers,
            quantized,
            vec2: RefCell::default(),
            vec3: RefCell::default(),
            vec4: RefCell::default(),
        }
    }

    pub(crate) fn vec2(&self, index: usize, wanted: Use) -> Result<Arc<[Vec2]>, Error> {
        self.cached(&self.vec2, index, wanted, |[x, y, _, _]| Vec2::new(x, y))
    }

    pub(crate) fn vec3(&self, index: usize, wanted: Use) -> Result<Arc<[Vec3]>, Error> {
        self.cached(&self.vec3, index, wanted, |[x, y, z, _]| Vec3::new(x, y, z))
    }

    pub(crate) fn vec4(&self, index: usize, wanted: Use) -> Result<Arc<[Vec4]>, Error> {
        self.cached(&self.vec4, index, wanted, Vec4::from_array)
    }

    /// Matrices of four rows and columns; not kept.
    pub(crate) fn mat4(&self, index: usize, wanted: Use) -> Result<Vec<Mat4>, Error> {
        self.floats(index, wanted, |columns: [f32; 16]| Mat4::from_cols_array(&columns))
    }

    /// Whether the components are integers.
    pub(crate) fn is_integer(&self, index: usize) -> bool {
        let accessor = self.buffers.root.accessors.get(index);
        accessor.is_some_and(|accessor| match accessor.component_type {
            Checked::Valid(kind) => kind.0 != ComponentType::F32,
            Checked::Invalid => false,
        })
    }

    /// The integers of an accessor of indices, each below `vertices`.
    pub(crate) fn indices(&self, index: usize, vertices: usize) -> Result<Vec<u32>, Error> {
        let accessor = self.accessor(index)?;
        let kind = self.component_type(index, accessor)?;
        let scalar = matches!(accessor.type_, Checked::Valid(Type::Scalar));
        if !scalar || accessor.normalized || integer(&[0; 4], kind).is_none() {
            return Err(self.wrong_type(index, accessor, "indices are unsigned integers"));
        }
        let count = accessor.count.0;
        let invalid = |what: String| self.invalid(index, what);
        let mut values: Vec<u32> = Vec::new();
        match accessor.buffer_view {
            Some(view) => {
                let layout = self.layout(
                    index,
                    view.value(),
                    accessor.byte_offset.map_or(0, |offset| offset.0),
                    count,
                    size_of_component(kind),
                )?;
                self.reserve(index, count, 4)?;
                values.extend(layout.elements(count).filter_map(|bytes| integer(bytes, kind)));
            }
            None => {
                self.reserve(index, count, 4)?;
                values.resize(usize::try_from(count).unwrap_or(0), 0);
            }
        }
        self.sparse(index, accessor, size_of_component(kind), |place, bytes| {
            if let (Some(slot), Some(value)) = (values.get_mut(place), integer(bytes, kind)) {
                *slot = value;
            }
        })?;
        match values.iter().position(|&value| value as usize >= vertices) {
            // Values are not shown: whose file the buffer is is not known.
            Some(at) => Err(invalid(format!("index {at} is beyond the {vertices} vertices"))),
            None => Ok(values),
        }
    }

    fn cached<T: Copy>(
        &self,
        cache: &Cache<T>,
        index: usize,
        wanted: Use,
        make: impl Fn([f32; 4]) -> T,
    ) -> Result<Arc<[T]>, Error> {
        if let Some(found) = cache.borrow().get(&(index, wanted)) {
            return Ok(found.clone());
        }
        let values: Arc<[T]> = self.floats(index, wanted, make)?.into();
        cache.borrow_mut().insert((index, wanted), values.clone());
        Ok(values)
    }

    /// Elements of `N` components at most.
    fn floats<T: Copy, const N: usize>(
        &self,
        index: usize,
        wanted: Use,
        make: impl Fn([f32; N]) -> T,
    ) -> Result<Vec<T>, Error> {
        let accessor = self.accessor(index)?;
        let kind = self.component_type(index, accessor)?;
        let Checked::Valid(type_) = accessor.type_ else {
            return Err(self.wrong_type(index, accessor, "the type is unknown"));
        };
        if !wanted.types().contains(&type_) {
            let expected = format!("{:?}s are expected", wanted.types()[0]);
            return Err(self.wrong_type(index, accessor, &expected));
        }
        if !wanted.allows(kind, accessor.normalized, self.quantized) {
            let why = format!("{wanted:?} values are not stored so, or need KHR_mesh_quantization");
            return Err(self.wrong_type(index, accessor, &why));
        }
        let (step, n) = (size_of_component(kind), type_.multiplicity().min(N));
        let size = step * n;
        let count = accessor.count.0;
        let mut broken = None;
        let mut place = 0usize;
        let mut decode = |bytes: &[u8]| {
            let mut value = wanted.missing::<N>();
            for (slot, bytes) in value.iter_mut().zip(bytes.chunks_exact(step)).take(n) {
                let found = component(bytes, kind, accessor.normalized).unwrap_or(f32::NAN);
                if !found.is_finite() {
                    broken = broken.or(Some((place, found)));
                }
                *slot = found;
            }
            place += 1;
            value
        };
        let bytes_each = size_of::<T>() as u64;
        let mut values: Vec<T> = Vec::new();
        match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                let layout = self.layout(index, view.value(), offset, count, size)?;
                self.reserve(index, count, bytes_each)?;
                values.reserve_exact(usize::try_from(count).unwrap_or(0));
                values.extend(layout.elements(count).map(|bytes| make(decode(bytes))));
            }
            None => {
                self.reserve(index, count, bytes_each)?;
                // Without a view all values are zero (glTF 2.0, section 3.6.2.1).
                let mut zero = wanted.missing::<N>();
                zero.iter_mut().take(n).for_each(|slot| *slot = 0.0);
                values.resize(usize::try_from(count).unwrap_or(0), make(zero));
            }
        }
        self.sparse(index, accessor, size, |place, bytes| {
            if let Some(slot) = values.get_mut(place) {
                *slot = make(decode(bytes));
            }
        })?;
        match broken {
            Some((at, found)) => {
                Err(self.invalid(index, format!("element {at} has a component that is {found}")))
            }
            None => Ok(values),
        }
    }

    fn reserve(&self, index: usize, count: u64, bytes_each: u64) -> Result<(), Error> {
        let bytes = count.saturating_mul(bytes_each);
        self.buffers.reserve(&format!("/accessors/{index}"), bytes)
    }

    /// Calls `put` with the place and bytes of each element that a sparse accessor replaces.
    fn sparse(
        &self,
        index: usize,
        accessor: &Accessor,
        size: usize,
        mut put: impl FnMut(usize, &[u8]),
    ) -> Result<(), Error> {
        let Some(sparse) = &accessor.sparse else { return Ok(()) };
        let Checked::Valid(kind) = &sparse.indices.component_type else {
            return Err(self.invalid(index, "its sparse indices have an unknown type".into()));
        };
        let (kind, count) = (kind.0, sparse.count.0);
        let places = self.layout(
            index,
            sparse.indices.buffer_view.value(),
            sparse.indices.byte_offset.0,
            count,
            size_of_component(kind),
        )?;
        let view = sparse.values.buffer_view.value();
        let values = self.layout(index, view, sparse.values.byte_offset.0, count, size)?;
        let mut before = None;
        for (place, value) in places.elements(count).zip(values.elements(count)) {
            let place = integer(place, kind).unwrap_or(u32::MAX);
            if u64::from(place) >= accessor.count.0 || before.is_some_and(|b| b >= place) {
                return Err(self.invalid(
                    index,
                    "a sparse index is too large or not above the one before".into(),
                ));
            }
            before = Some(place);
            put(place as usize, value);
        }
        Ok(())
    }

    fn accessor(&self, index: usize) -> Result<&'a Accessor, Error> {
        self.buffers.root.accessors.get(index).ok_or_else(|| {
            Error::invalid(
                self.buffers.document.place("/meshes"),
                format!("accessor {index} does not exist"),
                "export the file again",
            )
        })
    }

    fn component_type(&self, index: usize, accessor: &Accessor) -> Result<ComponentType, Error> {
        match accessor.component_type {
            Checked::Valid(kind) => Ok(kind.0),
            Checked::Invalid => {
                Err(self.wrong_type(index, accessor, "the type of its components is unknown"))
            }
        }
    }

    /// The elements in a view, which must hold all of them.
    fn layout(
        &self,
        index: usize,
        view: usize,
        offset: u64,
        count: u64,
        size: usize,
    ) -> Result<Layout<'_>, Error> {
        let pointer = format!("/accessors/{index}");
        let view = self.buffers.view(view, &pointer)?;
        let stride = view.stride.unwrap_or(size);
        if stride < size {
            return Err(self.invalid(
                index,
                format!("its elements of {size} bytes are only {stride} bytes apart"),
            ));
        }
        let length = match count {
            0 => Some(0),
            _ => (count - 1).checked_mul(stride as u64).and_then(|l| l.checked_add(size as u64)),
        };
        let range = length.and_then(|length| {
            let end = offset.checked_add(length)?;
            view.bytes.get(usize::try_from(offset).ok()?..usize::try_from(end).ok()?)
        });
        match range {
            Some(bytes) => Ok(Layout { bytes, stride, size }),
            None => Err(self.invalid(
                index,
                format!(
                    "{count} elements of {size} bytes from byte {offset} on do not fit into its \
                     buffer view of {} bytes",
                    view.bytes.len()
                ),
            )),
        }
    }

    fn wrong_type(&self, index: usize, accessor: &Accessor, why: &str) -> Error {
        let kind = match accessor.component_type {
            Checked::Valid(kind) => format!("{:?}", kind.0),
            Checked::Invalid => "unknown".into(),
        };
        let type_ = match accessor.type_ {
            Checked::Valid(type_) => format!("{type_:?}"),
            Checked::Invalid => "unknown".into(),
        };
        let normalized = if accessor.normalized { ", normalized" } else { "" };
        self.invalid(index, format!("it holds {type_} of {kind}{normalized}: {why}"))
    }

    fn invalid(&self, index: usize, what: String) -> Error {
        let name = self.buffers.root.accessors.get(index).and_then(|a| a.name.as_deref());
        let name = name.map_or(String::new(), |name| format!(" `{name}`"));
        Error::invalid(
            self.buffers.document.place(&format!("/accessors/{index}")),
            format!("accessor {index}{name}: {what}"),
            "export the file again",
        )
    }
}

impl<'a> Layout<'a> {
    fn elements(&self, count: u64) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let (bytes, stride, size) = (self.bytes, self.stride, self.size);
        (0..usize::try_from(count).unwrap_or(0)).map_while(move |i| {
            let start = i.checked_mul(stride)?;
            bytes.get(start..start.checked_add(size)?)
        })
    }
}

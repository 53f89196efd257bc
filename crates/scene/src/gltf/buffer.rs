//! Buffers of a glTF file and checked views of them.

use std::cell::{Cell, OnceCell};
use std::path::Path;

use gltf::json;

use crate::error::{Error, Place};
use crate::file;
use crate::json::Document;
use crate::uri::{data_of_uri, decode_data_uri, resolve_uri};

/// Bytes of a data URI or a file before they are decoded; what a name may stand for.
pub(crate) enum Resource {
    Bytes(Vec<u8>),
    File(std::path::PathBuf),
}

/// The buffers of a file; each is read when it is first asked for.
pub(crate) struct Buffers<'a> {
    pub(crate) document: &'a Document,
    pub(crate) root: &'a json::Root,
    /// The binary chunk of a .glb file.
    bin: Option<&'a [u8]>,
    loaded: Vec<OnceCell<Vec<u8>>>,
    /// Bytes of all buffers that were read.
    total: Cell<u64>,
    /// Bytes of decoded accessors.
    decoded: Cell<u64>,
}

/// What decoding may take at least, however small the buffers.
const FREE: u64 = 16 << 20;
/// How often larger decoded accessors may be than the buffers they come from: a byte becomes a
/// float, three components four, and vertices are shared.
const GROWTH: u64 = 16;

/// A range of a buffer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View<'a> {
    pub(crate) bytes: &'a [u8],
    pub(crate) stride: Option<usize>,
}

impl<'a> Buffers<'a> {
    pub(crate) fn new(document: &'a Document, root: &'a json::Root, bin: Option<&'a [u8]>) -> Self {
        Self {
            document,
            root,
            bin,
            loaded: root.buffers.iter().map(|_| OnceCell::new()).collect(),
            total: Cell::new(0),
            decoded: Cell::new(0),
        }
    }

    /// Bytes of all buffers that were read so far.
    pub(crate) fn total(&self) -> u64 {
        self.total.get()
    }

    /// Accounts for `bytes` that are about to be allocated for the value at `pointer`: a small
    /// file must not ask for much.
    pub(crate) fn reserve(&self, pointer: &str, bytes: u64) -> Result<(), Error> {
        let decoded = self.decoded.get().saturating_add(bytes);
        if decoded > self.total.get().saturating_mul(GROWTH).saturating_add(FREE) {
            return Err(Error::invalid(
                self.document.place(pointer),
                "the file's accessors describe far more data than its buffers hold",
                "export the file again",
            ));
        }
        self.decoded.set(decoded);
        Ok(())
    }

    /// Whether the data of an accessor are nowhere: glTF allows buffers that name no file (2.0,
    /// section 3.6.1.2), which other programs may know how to fill.
    pub(crate) fn lacks_data(&self, accessor: usize) -> bool {
        let view = self.root.accessors.get(accessor).and_then(|accessor| accessor.buffer_view);
        let view = view.and_then(|view| self.root.buffer_views.get(view.value()));
        view.is_some_and(|view| {
            let index = view.buffer.value();
            let buffer = self.root.buffers.get(index);
            let in_chunk = index == 0 && self.bin.is_some();
            buffer.is_some_and(|buffer| buffer.uri.is_none()) && !in_chunk
        })
    }

    /// The bytes that a URI of the file means: decoded data, or a file to be read.
    pub(crate) fn resource(&self, uri: &str, pointer: &str) -> Result<Resource, Error> {
        if let Some(rest) = data_of_uri(uri) {
            let bytes = decode_data_uri(rest).map_err(|what| {
                Error::invalid(self.document.place(pointer), what, "export the file again")
            })?;
            return Ok(Resource::Bytes(bytes));
        }
        let folder = self.document.path().parent().unwrap_or(Path::new(""));
        let path = resolve_uri(folder, uri, &self.document.place(pointer))?;
        Ok(Resource::File(path))
    }

    fn buffer(&self, index: usize) -> Result<&[u8], Error> {
        let Some(cell) = self.loaded.get(index) else {
            return Err(Error::invalid(
                self.document.place("/bufferViews"),
                format!("buffer {index} does not exist"),
                "export the file again",
            ));
        };
        if let Some(bytes) = cell.get() {
            return Ok(bytes);
        }
        let bytes = self.read(index)?;
        self.total.set(self.total.get().saturating_add(bytes.len() as u64));
        Ok(cell.get_or_init(|| bytes))
    }

    fn read(&self, index: usize) -> Result<Vec<u8>, Error> {
        let pointer = format!("/buffers/{index}");
        let declared = self.root.buffers.get(index).map_or(0, |buffer| buffer.byte_length.0);
        let short = |length: u64| {
            Error::invalid(
                self.document.place(&pointer),
                format!("the buffer has {length} bytes, {declared} are declared"),
                "export the file again, its data are cut off",
            )
        };
        let uri = self.root.buffers.get(index).and_then(|buffer| buffer.uri.as_deref());
        let mut bytes = match uri {
            // Only the first buffer may be the binary chunk.
            None => match self.bin.filter(|_| index == 0) {
                Some(bin) => {
                    let end = usize::try_from(declared).ok();
                    let part = end.and_then(|end| bin.get(..end));
                    part.ok_or_else(|| short(bin.len() as u64))?.to_vec()
                }
                None => {
                    return Err(Error::invalid(
                        self.document.place(&pointer),
                        "the buffer has no `uri`, and there is no binary chunk for it",
                        "export the file again, its data are missing",
                    ));
                }
            },
            Some(uri) => match self.resource(uri, &format!("{pointer}/uri"))? {
                Resource::Bytes(bytes) => bytes,
                Resource::File(path) => self.read_file(&path, declared, &pointer)?,
            },
        };
        if (bytes.len() as u64) < declared {
            return Err(short(bytes.len() as u64));
        }
        bytes.truncate(usize::try_from(declared).unwrap_or(usize::MAX));
        Ok(bytes)
    }

    /// At most `limit` bytes of a plain file.
    fn read_file(&self, path: &Path, limit: u64, pointer: &str) -> Result<Vec<u8>, Error> {
        let io = |source| {
            let by = format!("named by {} of {}", pointer, self.document.path().display());
            Error::io(Place::part(path, by), source)
        };
        file::read(path, limit).map_err(io)
    }

    /// All bytes of a file that an image names, up to `limit`.
    pub(crate) fn whole_file(
        &self,
        path: &Path,
        limit: u64,
        pointer: &str,
    ) -> Result<Vec<u8>, Error> {
        let bytes = self.read_file(path, limit.saturating_add(1), pointer)?;
        if bytes.len() as u64 > limit {
            return Err(Error::unsupported(
                self.document.place(pointer),
                format!("`{}` has more than {limit} bytes", path.display()),
                "use a smaller image",
            ));
        }
        Ok(bytes)
    }

    /// A buffer view, checked against its buffer; `pointer` is who wants it.
    pub(crate) fn view(&self, index: usize, pointer: &str) -> Result<View<'_>, Error> {
        let Some(view) = self.root.buffer_views.get(index) else {
            return Err(Error::invalid(
                self.document.place(pointer),
                format!("buffer view {index} does not exist"),
                "export the file again",
            ));
        };
        if let Some(name) = ["EXT_meshopt_compression", "KHR_meshopt_compression"]
            .iter()
            .find(|name| view.extensions.as_ref().is_some_and(|e| e.others.contains_key(**name)))
        {
            return Err(Error::unsupported(
                self.document.place(&format!("/bufferViews/{index}")),
                format!("the buffer view is compressed ({name})"),
                "export without compression",
            ));
        }
        let bytes = self.buffer(view.buffer.value())?;
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        let range = start
            .checked_add(view.byte_length.0)
            .and_then(|end| bytes.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?));
        let Some(part) = range else {
            return Err(Error::invalid(
                self.document.place(&format!("/bufferViews/{index}")),
                format!(
                    "the buffer view takes {} bytes from byte {start} on, its buffer has {}",
                    view.byte_length.0,
                    bytes.len()
                ),
                "export the file again",
            ));
        };
        Ok(View { bytes: part, stride: view.byte_stride.map(|stride| stride.0) })
    }
}

//! How node values are packed: the compression flags of a grid and one block of values.

use flate2::{Decompress, FlushDecompress, Status};

use crate::blosc;
use crate::cursor::Cursor;
use crate::error::Fault;

/// How the values of a grid are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Compression {
    /// Each block is a zlib stream.
    pub zip: bool,
    /// Each block is a Blosc chunk (before `zip` if both are set).
    pub blosc: bool,
    /// Inactive values are left out and made up from the background and at most two other values.
    pub active_mask: bool,
}

impl Compression {
    pub(crate) fn read(cursor: &mut Cursor<'_>) -> Result<Compression, Fault> {
        let start = cursor.offset();
        let flags = cursor.u32("the compression flags")?;
        if flags > 7 {
            return Err(Fault::unsupported(
                start,
                format!("the compression flags {flags:#x} are unknown"),
                "write the file with OpenVDB's zip, Blosc or no compression",
            ));
        }
        Ok(Compression { zip: flags & 1 != 0, active_mask: flags & 2 != 0, blosc: flags & 4 != 0 })
    }
}

/// Why a block could not be unpacked.
#[derive(Debug)]
pub(crate) struct CodecError {
    what: String,
    unsupported: bool,
}

impl CodecError {
    pub(crate) fn damaged(what: String) -> CodecError {
        CodecError { what, unsupported: false }
    }

    pub(crate) fn unsupported(what: String) -> CodecError {
        CodecError { what, unsupported: true }
    }

    pub(crate) fn at(self, offset: u64) -> Fault {
        if self.unsupported {
            let what = format!("{} cannot be read", self.what);
            Fault::unsupported(offset, what, "write the file with OpenVDB's own Blosc (LZ4) or zip")
        } else {
            Fault::invalid(offset, self.what)
        }
    }
}

/// One block of values as it lies in the file.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Block<'a> {
    /// The bytes themselves.
    Plain(&'a [u8]),
    /// A Blosc chunk and where it begins.
    Blosc(&'a [u8], u64),
    /// A zlib stream and where it begins.
    Zip(&'a [u8], u64),
}

impl<'a> Block<'a> {
    /// Steps over the block of `bytes` unpacked bytes. A compressed grid writes a 64-bit length in
    /// front of it: negative or zero for plain bytes, whose number it then must match.
    #[inline]
    pub(crate) fn read(
        cursor: &mut Cursor<'a>,
        compression: Compression,
        bytes: usize,
    ) -> Result<Block<'a>, Fault> {
        if !compression.zip && !compression.blosc {
            return Ok(Block::Plain(cursor.take(bytes, "a block of values")?));
        }
        let start = cursor.offset();
        let size = cursor.i64("the size of a block of values")?;
        let count = usize::try_from(size.unsigned_abs()).unwrap_or(usize::MAX);
        if size <= 0 {
            if count != bytes {
                let what = format!("a block of values has {count} bytes instead of {bytes}");
                return Err(Fault::invalid(start, what));
            }
            return Ok(Block::Plain(cursor.take(bytes, "a block of values")?));
        }
        let start = cursor.offset();
        let packed = cursor.take(count, "a compressed block of values")?;
        if compression.blosc {
            Ok(Block::Blosc(packed, start))
        } else {
            Ok(Block::Zip(packed, start))
        }
    }
}

/// Unpacks blocks; keeps its buffers between them.
pub(crate) struct Unpacker {
    bytes: Vec<u8>,
    scratch: Vec<u8>,
    inflate: Option<Decompress>,
}

impl Unpacker {
    pub(crate) fn new() -> Unpacker {
        Unpacker { bytes: Vec::new(), scratch: Vec::new(), inflate: None }
    }

    /// The `count` bytes of a block.
    pub(crate) fn unpack<'s>(
        &'s mut self,
        block: Block<'s>,
        count: usize,
    ) -> Result<&'s [u8], Fault> {
        if let Block::Plain(bytes) = block {
            return Ok(bytes);
        }
        if self.bytes.len() < count {
            self.bytes.resize(count, 0);
        }
        let (out, _) = self.bytes.split_at_mut(count);
        match block {
            Block::Plain(_) => {}
            Block::Blosc(packed, start) => blosc::decompress(packed, out, &mut self.scratch)
                .map_err(|error| error.at(start))?,
            Block::Zip(packed, start) => {
                let inflate = self.inflate.get_or_insert_with(|| Decompress::new(true));
                inflate.reset(true);
                let done = inflate.decompress(packed, out, FlushDecompress::Finish);
                let whole = matches!(done, Ok(Status::StreamEnd));
                if !whole || inflate.total_out() != count as u64 {
                    let error = CodecError::damaged("zlib data is damaged".into());
                    return Err(error.at(start));
                }
            }
        }
        Ok(out)
    }
}

//! A bounds-checked reader of little-endian fields that knows where in the file it is.

use crate::error::Fault;
use crate::tree::Coord;

/// Reads from a slice that begins `base` bytes into the file.
#[derive(Debug, Clone)]
pub(crate) struct Cursor<'a> {
    data: &'a [u8],
    pos: usize,
    base: u64,
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(data: &'a [u8], base: u64) -> Cursor<'a> {
        Cursor { data, pos: 0, base }
    }

    /// Bytes from the start of the file.
    pub(crate) fn offset(&self) -> u64 {
        self.base.saturating_add(self.pos as u64)
    }

    /// Bytes from the start of the slice.
    pub(crate) fn position(&self) -> usize {
        self.pos
    }

    pub(crate) fn remaining(&self) -> usize {
        self.data.len() - self.pos
    }

    /// A cursor over the same bytes at another place of the slice (clamped to its end).
    pub(crate) fn at(&self, position: usize) -> Cursor<'a> {
        Cursor { data: self.data, pos: position.min(self.data.len()), base: self.base }
    }

    /// The next `count` bytes; `what` names them in the error.
    #[inline]
    pub(crate) fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], Fault> {
        match self.data.get(self.pos..).and_then(|rest| rest.get(..count)) {
            Some(bytes) => {
                self.pos += count;
                Ok(bytes)
            }
            None => Err(self.short(count as u64, what)),
        }
    }

    #[cold]
    fn short(&self, count: u64, what: &str) -> Fault {
        let left = self.remaining();
        let needed = self.offset().saturating_add(count);
        Fault::truncated(
            self.offset(),
            needed,
            format!("{what} needs {count} bytes, only {left} are left"),
        )
    }

    #[inline]
    pub(crate) fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], Fault> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N, what)?);
        Ok(out)
    }

    pub(crate) fn u8(&mut self, what: &str) -> Result<u8, Fault> {
        Ok(u8::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn u32(&mut self, what: &str) -> Result<u32, Fault> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn i32(&mut self, what: &str) -> Result<i32, Fault> {
        Ok(i32::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn i64(&mut self, what: &str) -> Result<i64, Fault> {
        Ok(i64::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn f64(&mut self, what: &str) -> Result<f64, Fault> {
        Ok(f64::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn coord(&mut self, what: &str) -> Result<Coord, Fault> {
        Ok([self.i32(what)?, self.i32(what)?, self.i32(what)?])
    }

    pub(crate) fn f64s<const N: usize>(&mut self, what: &str) -> Result<[f64; N], Fault> {
        let mut out = [0.0; N];
        for value in &mut out {
            *value = self.f64(what)?;
        }
        Ok(out)
    }

    /// A string with a 32-bit length in front. Bytes that are no UTF-8 become replacement
    /// characters.
    pub(crate) fn string(&mut self, what: &str) -> Result<String, Fault> {
        let count = self.u32(what)?;
        let bytes = self.take(count as usize, what)?;
        Ok(String::from_utf8_lossy(bytes).into_owned())
    }

    /// Refuses a count of items that cannot fit into the bytes that are left.
    pub(crate) fn check_count(
        &self,
        count: u64,
        least_bytes_each: u64,
        what: &str,
    ) -> Result<(), Fault> {
        let least = count.saturating_mul(least_bytes_each);
        if least > self.remaining() as u64 {
            return Err(self.short(least, &format!("{count} {what}")));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_to_read_past_the_end() {
        let mut cursor = Cursor::new(&[1, 0, 0, 0, 9], 100);
        assert_eq!(cursor.u32("n").ok(), Some(1));
        let fault = cursor.u32("a number").unwrap_err();
        assert_eq!(fault.needed(), Some(108));
        assert_eq!(cursor.offset(), 104);
        assert_eq!(cursor.u8("b").ok(), Some(9));
        assert_eq!(cursor.remaining(), 0);
    }

    #[test]
    fn a_count_beyond_the_bytes_is_an_error() {
        let cursor = Cursor::new(&[0; 8], 0);
        assert!(cursor.check_count(2, 4, "things").is_ok());
        assert!(cursor.check_count(3, 4, "things").is_err());
        assert!(cursor.check_count(u64::MAX, 4, "things").is_err());
    }

    #[test]
    fn strings_are_lossy_utf8() {
        let mut cursor = Cursor::new(&[2, 0, 0, 0, b'a', 0xff], 0);
        assert_eq!(cursor.string("name").unwrap(), "a\u{fffd}");
    }
}

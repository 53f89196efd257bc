//! The checksum of streams that carry a film.

use std::io::{self, Read, Write};

use crc::{CRC_64_XZ, Crc, Digest, Table};

/// CRC-64/XZ: detects every burst of up to 64 bits, others with probability 1 - 2^-64.
static CRC: Crc<u64, Table<16>> = Crc::<u64, Table<16>>::new(&CRC_64_XZ);

/// Passes bytes on and keeps their checksum.
pub(crate) struct Summed<S> {
    stream: S,
    digest: Digest<'static, u64, Table<16>>,
}

impl<S> Summed<S> {
    pub(crate) fn new(stream: S) -> Self {
        Self { stream, digest: CRC.digest() }
    }

    /// The stream, behind what went through, and the checksum of that.
    pub(crate) fn finish(self) -> (S, u64) {
        (self.stream, self.digest.finalize())
    }
}

impl<W: Write> Summed<W> {
    pub(crate) fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.digest.update(bytes);
        self.stream.write_all(bytes)
    }
}

impl<R: Read> Summed<R> {
    pub(crate) fn get<const N: usize>(&mut self) -> io::Result<[u8; N]> {
        let mut bytes = [0; N];
        self.fill(&mut bytes)?;
        Ok(bytes)
    }

    pub(crate) fn fill(&mut self, bytes: &mut [u8]) -> io::Result<()> {
        self.stream.read_exact(bytes)?;
        self.digest.update(bytes);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_value_of_the_catalogue() {
        // CRC-64/XZ, "check" in G. Cook's catalogue of parametrised CRC algorithms.
        let mut summed = Summed::new(Vec::new());
        summed.put(b"1234").unwrap();
        summed.put(b"56789").unwrap();
        let (stream, sum) = summed.finish();
        assert_eq!((stream.as_slice(), sum), (b"123456789".as_slice(), 0x995D_C9BB_DF19_39FA));
    }
}

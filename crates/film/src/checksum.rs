//! CRC-64 of the streams that carry a film.

use std::io::{self, Read, Write};

/// Reflected polynomial of ECMA-182, as used by the xz format.
const POLYNOMIAL: u64 = 0xC96C_5795_D787_0F42;

const TABLE: [u64; 256] = {
    let mut table = [0; 256];
    let mut i = 0;
    while i < 256 {
        let mut value = i as u64;
        let mut bit = 0;
        while bit < 8 {
            value = if value & 1 == 1 { (value >> 1) ^ POLYNOMIAL } else { value >> 1 };
            bit += 1;
        }
        table[i] = value;
        i += 1;
    }
    table
};

/// Running CRC-64/XZ: detects every burst of up to 64 bits, others with probability 1 - 2^-64.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crc64(u64);

impl Crc64 {
    pub(crate) fn new() -> Self {
        Self(u64::MAX)
    }

    pub(crate) fn update(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = TABLE[usize::from((self.0 as u8) ^ byte)] ^ (self.0 >> 8);
        }
    }

    pub(crate) fn value(self) -> u64 {
        !self.0
    }
}

/// Passes bytes on and keeps their checksum.
pub(crate) struct Summed<S> {
    pub(crate) stream: S,
    pub(crate) crc: Crc64,
}

impl<S> Summed<S> {
    pub(crate) fn new(stream: S) -> Self {
        Self { stream, crc: Crc64::new() }
    }
}

impl<W: Write> Summed<W> {
    pub(crate) fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.crc.update(bytes);
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
        self.crc.update(bytes);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_value_of_the_catalogue() {
        // CRC-64/XZ, "check" in G. Cook's catalogue of parametrised CRC algorithms.
        let mut crc = Crc64::new();
        crc.update(b"1234");
        crc.update(b"56789");
        assert_eq!(crc.value(), 0x995D_C9BB_DF19_39FA);
    }
}

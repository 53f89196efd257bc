//! Undoes the byte and bit transpositions that Blosc applies before compression.

/// Undoes the byte shuffle: plane `j` of `src` holds byte `j` of every element. Bytes behind the
/// last whole element stay put.
pub(crate) fn unshuffle(type_size: usize, src: &[u8], dst: &mut [u8]) {
    let count = src.len().min(dst.len()) / type_size.max(1);
    let (planes, tail) = src.split_at(count * type_size);
    let (body, rest) = dst.split_at_mut(count * type_size);
    rest.iter_mut().zip(tail).for_each(|(to, from)| *to = *from);
    match type_size {
        2 => {
            let (a, b) = planes.split_at(count);
            for ((out, a), b) in body.as_chunks_mut::<2>().0.iter_mut().zip(a).zip(b) {
                *out = [*a, *b];
            }
        }
        4 => {
            let (ab, cd) = planes.split_at(2 * count);
            let ((a, b), (c, d)) = (ab.split_at(count), cd.split_at(count));
            let inputs = a.iter().zip(b).zip(c.iter().zip(d));
            for (out, ((a, b), (c, d))) in body.as_chunks_mut::<4>().0.iter_mut().zip(inputs) {
                *out = [*a, *b, *c, *d];
            }
        }
        _ => {
            for (index, plane) in planes.chunks_exact(count.max(1)).enumerate() {
                for (out, byte) in body.chunks_exact_mut(type_size).zip(plane) {
                    out[index] = *byte;
                }
            }
        }
    }
}

/// Undoes the bit shuffle: row `8 j + k` of `src` holds bit `k` of byte `j` of every element, eight
/// elements a byte. Blosc leaves blocks whose number of elements is no multiple of eight, and bytes
/// behind the last element, as they are.
pub(crate) fn bit_unshuffle(type_size: usize, src: &[u8], dst: &mut [u8]) {
    let type_size = type_size.max(1);
    let count = src.len().min(dst.len()) / type_size;
    if !count.is_multiple_of(8) {
        dst.iter_mut().zip(src).for_each(|(to, from)| *to = *from);
        return;
    }
    let row = count / 8;
    let (planes, tail) = src.split_at(count * type_size);
    let (body, rest) = dst.split_at_mut(count * type_size);
    rest.iter_mut().zip(tail).for_each(|(to, from)| *to = *from);
    for (group, out) in body.chunks_exact_mut(8 * type_size).enumerate() {
        for byte in 0..type_size {
            // Eight rows of one byte each form an 8 x 8 bit matrix whose transpose is this byte of
            // eight elements.
            let mut bits = 0u64;
            for bit in 0..8 {
                let value = planes.get((8 * byte + bit) * row + group).copied().unwrap_or(0);
                bits |= u64::from(value) << (8 * bit);
            }
            for (element, value) in transpose(bits).to_le_bytes().into_iter().enumerate() {
                if let Some(to) = out.get_mut(element * type_size + byte) {
                    *to = value;
                }
            }
        }
    }
}

/// Transposes an 8 x 8 matrix of bits (Warren, Hacker's Delight, section 7-3).
fn transpose(mut x: u64) -> u64 {
    let mut swap = |shift: u32, mask: u64| {
        let t = (x ^ (x >> shift)) & mask;
        x ^= t ^ (t << shift);
    };
    swap(7, 0x00AA_00AA_00AA_00AA);
    swap(14, 0x0000_CCCC_0000_CCCC);
    swap(28, 0x0000_0000_F0F0_F0F0);
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shuffle(type_size: usize, src: &[u8]) -> Vec<u8> {
        let count = src.len() / type_size;
        let mut out = src.to_vec();
        for i in 0..count {
            for j in 0..type_size {
                out[j * count + i] = src[i * type_size + j];
            }
        }
        out
    }

    fn bit_shuffle(type_size: usize, src: &[u8]) -> Vec<u8> {
        let count = src.len() / type_size;
        let mut out = src.to_vec();
        if count.is_multiple_of(8) {
            out[..count * type_size].fill(0);
            for i in 0..count {
                for j in 0..type_size {
                    for k in 0..8 {
                        let bit = src[i * type_size + j] >> k & 1;
                        out[(8 * j + k) * (count / 8) + i / 8] |= bit << (i % 8);
                    }
                }
            }
        }
        out
    }

    #[test]
    fn both_shuffles_are_undone() {
        let bytes: Vec<u8> = (0..413u32).map(|i| (i * i * 7 + i / 3) as u8).collect();
        for type_size in [1, 2, 3, 4, 8, 12, 16] {
            for length in [0, 1, 7, 16, 64, 96, 384, 411] {
                let src = &bytes[..length];
                let mut out = vec![0; length];
                unshuffle(type_size, &shuffle(type_size, src), &mut out);
                assert_eq!(out, src, "bytes, {type_size} of {length}");
                out.fill(0);
                bit_unshuffle(type_size, &bit_shuffle(type_size, src), &mut out);
                assert_eq!(out, src, "bits, {type_size} of {length}");
            }
        }
    }

    #[test]
    fn unequal_lengths_do_not_panic() {
        for (a, b) in [(5, 9), (9, 5), (0, 3), (64, 7)] {
            unshuffle(4, &vec![1; a], &mut vec![0; b]);
            bit_unshuffle(4, &vec![1; a], &mut vec![0; b]);
        }
    }
}

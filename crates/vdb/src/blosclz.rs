//! Decoder of BloscLZ, the small LZ77 codec inside Blosc (a relative of FastLZ).

/// Longest distance of a short match; a long one adds 16 bits to it.
const MAX_DISTANCE: usize = 8191;

/// Decodes `src` into `dst` and returns the number of bytes written, or nothing when the stream is
/// damaged.
///
/// The stream is a sequence of tokens. Below 32 the token is a run of `token + 1` literals.
/// Otherwise its upper three bits are the match length (7 goes on in further bytes while they
/// are 255) and its lower five the high byte of the distance, whose low byte follows; distance 31 *
/// 256 + 255 announces a 16-bit distance. The first token is always a literal run.
pub(crate) fn decompress(src: &[u8], dst: &mut [u8]) -> Option<usize> {
    let mut input = src;
    let mut written = 0usize;
    let mut token = next(&mut input)? & 31;
    loop {
        if token < 32 {
            let count = usize::from(token) + 1;
            let (literals, rest) = input.split_at_checked(count)?;
            let end = written + count;
            dst.get_mut(written..end)?.copy_from_slice(literals);
            (written, input) = (end, rest);
        } else {
            let mut length = usize::from(token >> 5) - 1;
            let high = usize::from(token & 31) << 8;
            if length == 6 {
                loop {
                    let more = next(&mut input)?;
                    length += usize::from(more);
                    if more != 255 {
                        break;
                    }
                }
            }
            let low = next(&mut input)?;
            let mut distance = high + usize::from(low) + 1;
            if low == 255 && high == 31 << 8 {
                let far = usize::from(next(&mut input)?) << 8 | usize::from(next(&mut input)?);
                distance = far + MAX_DISTANCE + 1;
            }
            written = copy_match(dst, written, distance, length + 3)?;
        }
        match next(&mut input) {
            Some(byte) => token = byte,
            None => return Some(written),
        }
    }
}

fn next(input: &mut &[u8]) -> Option<u8> {
    let (first, rest) = input.split_first()?;
    *input = rest;
    Some(*first)
}

/// Repeats `length` bytes that begin `distance` before `at`; the two ranges may overlap.
fn copy_match(dst: &mut [u8], at: usize, distance: usize, length: usize) -> Option<usize> {
    let from = at.checked_sub(distance)?;
    let end = at.checked_add(length)?;
    if end > dst.len() {
        return None;
    }
    if distance >= length {
        dst.copy_within(from..from + length, at);
    } else {
        for index in at..end {
            dst[index] = dst[index - distance];
        }
    }
    Some(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_and_matches() {
        // "abc", then 9 bytes from 3 back, then "x".
        let src = [2, b'a', b'b', b'c', 0b1110_0000, 0, 2, 0, b'x'];
        let mut dst = [0; 13];
        assert_eq!(decompress(&src, &mut dst), Some(13));
        assert_eq!(&dst, b"abcabcabcabcx");
    }

    #[test]
    fn damage_is_noticed() {
        let mut dst = [0; 8];
        assert_eq!(decompress(&[], &mut dst), None);
        assert_eq!(decompress(&[9, 1, 2], &mut dst), None, "too few literals");
        assert_eq!(decompress(&[0, 7, 32, 9], &mut dst), None, "before the start");
        assert_eq!(decompress(&[0, 7, 0b1110_0000, 200, 0], &mut dst), None, "too long");
        assert_eq!(decompress(&[0, 7, 0b1110_0000, 255], &mut dst), None, "cut off");
    }
}

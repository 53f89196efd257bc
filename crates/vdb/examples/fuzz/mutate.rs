//! Ways to damage a file that know what its bytes mean.

/// SplitMix64 (Steele, Lea and Flood 2014): small, stable, good enough to choose damage.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64, number: u64) -> Random {
        Random(seed ^ number.wrapping_mul(0xD134_2543_DE82_EF95))
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number below `end`, or 0.
    pub(crate) fn below(&mut self, end: usize) -> usize {
        if end == 0 { 0 } else { (self.next() % end as u64) as usize }
    }

    fn pick<T: Copy>(&mut self, items: &[T]) -> Option<T> {
        items.get(self.below(items.len())).copied()
    }
}

/// A file to damage, and where its fields are.
pub(crate) struct Sample {
    pub(crate) name: String,
    pub(crate) bytes: Vec<u8>,
    /// Where the length of a string stands.
    strings: Vec<usize>,
    /// Where a Blosc chunk begins, behind its 64-bit length.
    chunks: Vec<usize>,
}

impl Sample {
    pub(crate) fn new(name: String, bytes: Vec<u8>) -> Sample {
        let u32_at = |at: usize| {
            bytes
                .get(at..at + 4)
                .map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize)
        };
        let text = |at: usize, count: usize| {
            bytes.get(at..at + count).is_some_and(|b| b.iter().all(|c| (32..127).contains(c)))
        };
        let head = bytes.len().min(1 << 16);
        let strings = (0..head)
            .filter(|at| (3..64).contains(&u32_at(*at)) && text(at + 4, u32_at(*at)))
            .collect();
        let chunks = (8..bytes.len().saturating_sub(16))
            .filter(|at| bytes[*at] == 2 && bytes[at + 3] == 4 && u32_at(at + 12) == u32_at(at - 8))
            .collect();
        Sample { name, bytes, strings, chunks }
    }
}

const NUMBERS: [u64; 18] = [
    0,
    1,
    2,
    3,
    7,
    8,
    127,
    128,
    255,
    256,
    512,
    4096,
    0x7FFF_FFFF,
    0x8000_0000,
    0xFFFF_FFFF,
    0x7FFF_FFFF_FFFF_FFFF,
    0x8000_0000_0000_0000,
    u64::MAX,
];

const TYPES: [&str; 11] = [
    "float",
    "double",
    "half",
    "int32",
    "int64",
    "bool",
    "mask",
    "vec3s",
    "vec3d",
    "vec3i",
    "ptdataidx32",
];

const MAPS: [&str; 8] = [
    "UniformScaleMap",
    "ScaleMap",
    "UniformScaleTranslateMap",
    "ScaleTranslateMap",
    "TranslationMap",
    "UnitaryMap",
    "AffineMap",
    "NonlinearFrustumMap",
];

/// A damaged copy of one of the samples and what was done to it.
pub(crate) fn candidate(samples: &[Sample], random: &mut Random) -> (Vec<u8>, String) {
    let Some(sample) = samples.get(random.below(samples.len())) else {
        return Default::default();
    };
    let mut bytes = sample.bytes.clone();
    let mut story = sample.name.clone();
    for _ in 0..=random.below(3) {
        story += "; ";
        story += &damage(&mut bytes, sample, samples, random);
    }
    if bytes.len() != sample.bytes.len() && random.below(8) > 0 {
        story += &mend_end(&mut bytes, sample.bytes.len());
    }
    (bytes, story)
}

/// Moves the end of the last grid to the new end of the file, so that other damage than a short
/// file is met.
fn mend_end(bytes: &mut [u8], old: usize) -> String {
    let (old, new) = ((old as u64).to_le_bytes(), (bytes.len() as u64).to_le_bytes());
    let head = bytes.len().min(1 << 16);
    match bytes[..head].windows(8).position(|window| window == old) {
        Some(at) => {
            put(bytes, at, &new);
            format!("; end at {at} mended")
        }
        None => String::new(),
    }
}

/// A position: sometimes among the first 2 kB, where the headers are.
fn position(bytes: &[u8], random: &mut Random) -> usize {
    let end = match random.below(8) {
        0 => bytes.len().min(2048),
        1 | 2 => bytes.len().min(16384),
        _ => bytes.len(),
    };
    random.below(end)
}

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes.iter_mut().skip(at).zip(value).for_each(|(to, from)| *to = *from);
}

fn number(random: &mut Random, length: usize) -> u64 {
    match random.below(4) {
        0 => random.next(),
        1 => (length as u64).wrapping_add(random.next() % 64).wrapping_sub(32),
        _ => random.pick(&NUMBERS).unwrap_or(0),
    }
}

fn damage(bytes: &mut Vec<u8>, sample: &Sample, samples: &[Sample], random: &mut Random) -> String {
    let at = position(bytes, random);
    let length = bytes.len();
    match random.below(32) {
        0..=7 => {
            let bit = random.below(8);
            let flipped = bytes.get(at).map_or(0, |byte| byte ^ 1 << bit);
            put(bytes, at, &[flipped]);
            format!("flip bit {bit} at {at}")
        }
        8 | 9 => {
            let value = random.next() as u8;
            put(bytes, at, &[value]);
            format!("byte {at} = {value}")
        }
        10 | 11 => {
            let value = number(random, length) as u32;
            put(bytes, at, &value.to_le_bytes());
            format!("u32 at {at} = {value}")
        }
        12 | 13 => {
            let value = number(random, length);
            put(bytes, at, &value.to_le_bytes());
            format!("u64 at {at} = {value}")
        }
        14 => {
            bytes.truncate(at);
            format!("cut at {at}")
        }
        15 | 16 => {
            let count = random.below(64.min(length - at.min(length)));
            bytes.drain(at..at + count);
            format!("remove {count} bytes at {at}")
        }
        17 | 18 => {
            let extra: Vec<u8> = (0..random.below(64)).map(|_| random.next() as u8).collect();
            bytes.splice(at..at, extra.iter().copied());
            format!("insert {} bytes at {at}", extra.len())
        }
        19 | 20 => {
            let Some(other) = samples.get(random.below(samples.len())) else {
                return String::new();
            };
            let from = position(&other.bytes, random);
            let count = random.below(4096.min(other.bytes.len() - from.min(other.bytes.len())));
            put(bytes, at, other.bytes.get(from..from + count).unwrap_or(&[]));
            format!("{count} bytes of {} from {from} at {at}", other.name)
        }
        21 => {
            let Some(at) = random.pick(&sample.strings) else { return String::new() };
            let value = number(random, length) as u32;
            put(bytes, at, &value.to_le_bytes());
            format!("string length at {at} = {value}")
        }
        22..=26 => {
            let Some(at) = random.pick(&sample.chunks) else { return String::new() };
            let (field, size) = random
                .pick(&[(-8, 8), (0, 1), (2, 1), (3, 1), (4, 4), (8, 4), (12, 4), (16, 4), (20, 4)])
                .unwrap_or((0, 1));
            let value = number(random, length).to_le_bytes();
            let at = at.saturating_add_signed(field);
            put(bytes, at, &value[..size]);
            format!("Blosc field {field} at {at} = {:?}", &value[..size])
        }
        27 | 28 => rename(bytes, random),
        29 => {
            let version = 219 + random.below(8) as u32;
            put(bytes, 8, &version.to_le_bytes());
            format!("version {version}")
        }
        30 => {
            put(bytes, 20, &[random.below(2) as u8]);
            "other offset flag".into()
        }
        _ => {
            let Some(value) = bytes.get(at..at + 4) else { return String::new() };
            let value = u32::from_le_bytes([value[0], value[1], value[2], value[3]]);
            let step = random.below(33) as u32;
            put(bytes, at, &value.wrapping_add(step).wrapping_sub(16).to_le_bytes());
            format!("u32 at {at} changed by {step} - 16")
        }
    }
}

/// Gives the first tree or map another type, lengths and offsets adapted or not.
fn rename(bytes: &mut Vec<u8>, random: &mut Random) -> String {
    let find = |bytes: &[u8], text: &str| {
        bytes.windows(text.len()).take(1 << 16).position(|window| window == text.as_bytes())
    };
    let (old, new) = if random.below(3) > 0 {
        let pair = (random.pick(&TYPES).unwrap_or(""), random.pick(&TYPES).unwrap_or(""));
        (format!("Tree_{}_5_4_3", pair.0), format!("Tree_{}_5_4_3", pair.1))
    } else {
        let pair = (random.pick(&MAPS).unwrap_or(""), random.pick(&MAPS).unwrap_or(""));
        (pair.0.to_owned(), pair.1.to_owned())
    };
    let Some(at) = find(bytes, &old).filter(|at| *at >= 4) else { return String::new() };
    bytes.splice(at..at + old.len(), new.bytes());
    put(bytes, at - 4, &(new.len() as u32).to_le_bytes());
    if random.below(4) > 0 && old.starts_with("Tree") {
        // Two positions behind the (usually empty) parent's name move with the name.
        let shift = new.len() as i64 - old.len() as i64;
        let half =
            if bytes[at..].starts_with(format!("{new}_HalfFloat").as_bytes()) { 10 } else { 0 };
        for field in 0..3 {
            let at = at + new.len() + half + 4 + 8 * field;
            if let Some(value) = bytes.get(at..at + 8) {
                let value = i64::from_le_bytes(value.try_into().unwrap_or_default());
                put(bytes, at, &value.wrapping_add(shift).to_le_bytes());
            }
        }
    }
    format!("{old} becomes {new}")
}

//! Changes of bytes as a fuzzer makes them, repeatable by a seed.

/// Numbers at the ends of what programs count with.
const NUMBERS: [u64; 10] = [0, 1, 0x7f, 0xff, 0x7fff, 0xffff, 0x7fff_ffff, 0xffff_ffff, 1 << 62, u64::MAX];
/// Texts that stand where a text file has a number or a word.
const WORDS: [&str; 12] =
    ["NaN", "inf", "-1", "1e999", "1e-400", "18446744073709551616", "null", "[]", "{}", "\"\"", "..", "0x10"];
/// Changes of one input at most.
const MAX_CHANGES: u64 = 4;
/// Longest input.
const MAX_BYTES: usize = 1 << 16;

/// A source of changed inputs (`SplitMix64` of Steele, Lea, Flood 2014 decides).
#[derive(Clone, Debug)]
pub struct Mutator(u64);

impl Mutator {
    /// The source with this seed.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `end`, which is above 0.
    fn below(&mut self, end: usize) -> usize {
        usize::try_from(self.bits() % end.max(1) as u64).unwrap_or(0)
    }

    /// One of `seeds` with a few changes; nothing where there is no seed.
    pub fn next(&mut self, seeds: &[Vec<u8>]) -> Vec<u8> {
        let Some(seed) = seeds.get(self.below(seeds.len())) else { return Vec::new() };
        let Some((&which, content)) = seed.split_first() else { return Vec::new() };
        let mut content = content.to_vec();
        for _ in 0..1 + self.bits() % MAX_CHANGES {
            let other = &seeds[self.below(seeds.len())];
            self.change(&mut content, other);
        }
        content.truncate(MAX_BYTES);
        content.insert(0, which);
        content
    }

    fn change(&mut self, bytes: &mut Vec<u8>, other: &[u8]) {
        let at = self.below(bytes.len() + 1);
        let (part, end) = (self.below(64), bytes.len());
        match self.below(10) {
            0 => self.overwrite(bytes, at, 1),
            1 => self.overwrite(bytes, at, 4),
            2 => self.overwrite(bytes, at, 8),
            3 => bytes.truncate(at),
            4 => drop(bytes.drain(at..(at + part).min(end))),
            5 => {
                let piece = bytes[at..(at + part).min(end)].to_vec();
                bytes.splice(at..at, piece);
            }
            6 => {
                let from = self.below(other.len());
                let piece = other[from..(from + part).min(other.len())].to_vec();
                bytes.splice(at..(at + part).min(end), piece);
            }
            7 | 8 => self.word(bytes, at),
            _ => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << self.below(8);
                }
            }
        }
    }

    /// A number of so many bytes over what is there.
    fn overwrite(&mut self, bytes: &mut [u8], at: usize, size: usize) {
        let floats = [f64::NAN, f64::INFINITY, f64::MAX, 5e-324].map(f64::to_bits);
        let value = match self.below(3) {
            0 => NUMBERS[self.below(NUMBERS.len())],
            1 if size == 4 => u64::from([f32::NAN, f32::INFINITY, f32::MAX, 1e-45][self.below(4)].to_bits()),
            1 => floats[self.below(floats.len())],
            _ => self.bits(),
        };
        let room = bytes.iter_mut().skip(at);
        room.zip(value.to_le_bytes().into_iter().take(size)).for_each(|(byte, new)| *byte = new);
    }

    /// A word in the place of the number from `at` on, if there is one.
    fn word(&mut self, bytes: &mut Vec<u8>, at: usize) {
        let is_number = |byte: &u8| byte.is_ascii_digit() || b"+-.eE".contains(byte);
        let Some(start) = bytes[at..].iter().position(is_number).map(|k| at + k) else { return };
        let length = bytes[start..].iter().position(|byte| !is_number(byte)).unwrap_or(bytes.len() - start);
        let word = WORDS[self.below(WORDS.len())];
        bytes.splice(start..start + length, word.bytes());
    }
}

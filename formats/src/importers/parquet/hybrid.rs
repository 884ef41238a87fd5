//! Small numbers of a page: runs of one value, and values of a few bits each.
//!
//! # Source
//! apache/parquet-format, `Encodings.md`, RLE.

/// The numbers of a hybrid of runs and packed bits, one after the other; `None` where the bytes say no more.
#[derive(Clone, Debug)]
pub(super) struct Hybrid<'a> {
    bytes: &'a [u8],
    width: u32,
    run: Run,
}

#[derive(Clone, Debug)]
enum Run {
    /// So many more of one value.
    Same { left: u64, value: u32 },
    /// So many more, from the bit on of the bytes.
    Packed { left: u64, bit: u64 },
}

impl<'a> Hybrid<'a> {
    /// The numbers of `width` bits, at most 32.
    pub(super) const fn new(bytes: &'a [u8], width: u32) -> Self {
        Self { bytes, width, run: Run::Same { left: 0, value: 0 } }
    }

    /// The numbers from 0 to `max`.
    pub(super) const fn up_to(bytes: &'a [u8], max: u32) -> Self {
        Self::new(bytes, u32::BITS - max.leading_zeros())
    }

    /// The next number.
    pub(super) fn next(&mut self) -> Option<u32> {
        if self.width == 0 {
            return Some(0);
        }
        loop {
            match &mut self.run {
                Run::Same { left: 0, .. } => self.run = self.next_run()?,
                Run::Same { left, value } => {
                    *left -= 1;
                    return Some(*value);
                }
                Run::Packed { left: 0, bit } => {
                    let used = usize::try_from(bit.div_ceil(8)).ok()?;
                    self.bytes = self.bytes.get(used..)?;
                    self.run = Run::Same { left: 0, value: 0 };
                }
                Run::Packed { left, bit } => {
                    let value = packed(self.bytes, *bit, self.width)?;
                    *left -= 1;
                    *bit += u64::from(self.width);
                    return Some(value);
                }
            }
        }
    }

    fn next_run(&mut self) -> Option<Run> {
        let mut head = 0_u64;
        for shift in (0..35).step_by(7) {
            let (&byte, rest) = self.bytes.split_first()?;
            self.bytes = rest;
            head |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                let left = head >> 1;
                return if head & 1 == 1 { Some(Run::Packed { left: left * 8, bit: 0 }) } else { self.same(left) };
            }
        }
        None
    }

    fn same(&mut self, left: u64) -> Option<Run> {
        let size = usize::try_from(self.width.div_ceil(8)).ok()?;
        let (value, rest) = self.bytes.split_at_checked(size)?;
        self.bytes = rest;
        let value = value.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte));
        Some(Run::Same { left, value })
    }
}

/// The number of `width` bits from `bit` on, lowest first.
fn packed(bytes: &[u8], bit: u64, width: u32) -> Option<u32> {
    let first = usize::try_from(bit / 8).ok()?;
    let last = usize::try_from((bit + u64::from(width)).div_ceil(8)).ok()?;
    let part = bytes.get(first..last)?;
    let whole = part.iter().rev().fold(0_u64, |value, &byte| value << 8 | u64::from(byte));
    u32::try_from(whole >> (bit % 8) & ((1 << width) - 1)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_and_packed_bits() {
        // Three of 5, eight of three bits (0 to 7), as the format's own page shows them.
        let bytes = [6, 5, 3, 0b1000_1000, 0b1100_0110, 0b1111_1010];
        let mut numbers = Hybrid::up_to(&bytes, 7);
        let found: Vec<u32> = std::iter::from_fn(|| numbers.next()).collect();
        assert_eq!(found, [5, 5, 5, 0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(Hybrid::up_to(&[], 0).next(), Some(0));
    }

    #[test]
    fn wide_numbers_and_cut_bytes() {
        let bytes = [2, 0x78, 0x56, 0x34, 0x12, 3, 0xff, 0xff, 0xff, 0xff, 1];
        let mut numbers = Hybrid::new(&bytes, 32);
        assert_eq!([numbers.next(), numbers.next(), numbers.next()], [Some(0x1234_5678), Some(u32::MAX), None]);
        assert_eq!(Hybrid::new(&[0xff, 0xff, 0xff, 0xff, 0xff, 0xff], 3).next(), None);
        assert_eq!(Hybrid::new(&[4], 9).next(), None);
        assert_eq!(Hybrid::new(&[0x80], 1).next(), None);
    }
}

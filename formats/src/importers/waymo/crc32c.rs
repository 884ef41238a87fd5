//! The checksum of `TFRecord` files: CRC-32C, masked.
//!
//! # Source
//! G. Castagnoli et al., "Optimization of cyclic redundancy-check codes", 1993; tensorflow, `tensorflow/core/lib/hash/crc32c.h` (the mask).

/// The polynomial, lowest power at the highest bit.
const POLYNOMIAL: u32 = 0x82f6_3b78;
/// Bytes that are taken at once.
const STRIDE: usize = 8;
/// What is added to a turned checksum.
const MASK: u32 = 0xa282_ead8;

static TABLES: [[u32; 256]; STRIDE] = tables();

/// `[k][byte]` what a byte leaves behind after `k` bytes of zero.
const fn tables() -> [[u32; 256]; STRIDE] {
    let mut tables = [[0; 256]; STRIDE];
    let (mut byte, mut value) = (0, 0_u32);
    while byte < 256 {
        let (mut rest, mut bit) = (value, 0);
        while bit < 8 {
            rest = (rest >> 1) ^ if rest & 1 == 1 { POLYNOMIAL } else { 0 };
            bit += 1;
        }
        tables[0][byte] = rest;
        byte += 1;
        value += 1;
    }
    let mut k = 1;
    while k < STRIDE {
        let mut byte = 0;
        while byte < 256 {
            let before = tables[k - 1][byte];
            tables[k][byte] = (before >> 8) ^ tables[0][(before & 0xff) as usize];
            byte += 1;
        }
        k += 1;
    }
    tables
}

/// A checksum that grows with what is read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crc32c(u32);

impl Crc32c {
    /// The checksum of nothing.
    pub(super) const fn new() -> Self {
        Self(u32::MAX)
    }

    /// Takes these bytes in.
    pub(super) fn update(&mut self, bytes: &[u8]) {
        let low = |value: u32, shift: u32| (value >> shift & 0xff) as usize;
        let mut crc = self.0;
        let (strides, rest) = bytes.as_chunks::<STRIDE>();
        for &[a, b, c, d, e, f, g, h] in strides {
            let first = crc ^ u32::from_le_bytes([a, b, c, d]);
            crc = TABLES[7][low(first, 0)]
                ^ TABLES[6][low(first, 8)]
                ^ TABLES[5][low(first, 16)]
                ^ TABLES[4][low(first, 24)]
                ^ TABLES[3][usize::from(e)]
                ^ TABLES[2][usize::from(f)]
                ^ TABLES[1][usize::from(g)]
                ^ TABLES[0][usize::from(h)];
        }
        for &byte in rest {
            crc = (crc >> 8) ^ TABLES[0][low(crc ^ u32::from(byte), 0)];
        }
        self.0 = crc;
    }

    /// The checksum as `TFRecord` files store it.
    pub(super) const fn masked(self) -> u32 {
        (!self.0).rotate_right(15).wrapping_add(MASK)
    }
}

/// The checksum of some bytes as `TFRecord` files store it.
pub(super) fn masked(bytes: &[u8]) -> u32 {
    let mut crc = Crc32c::new();
    crc.update(bytes);
    crc.masked()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_checksums() {
        // RFC 3720, B.4, and the mask undone.
        for (bytes, want) in
            [(vec![0_u8; 32], 0x8a91_36aa_u32), (vec![0xff; 32], 0x62a8_ab43), ((0..32).collect(), 0x46dd_794e)]
        {
            assert_eq!(masked(&bytes).wrapping_sub(MASK).rotate_left(15), want);
        }
        assert_eq!(masked(b"123456789").wrapping_sub(MASK).rotate_left(15), 0xe306_9283);
    }

    #[test]
    fn pieces_make_the_whole() {
        let bytes: Vec<u8> = (0..100).map(|k: u8| k.wrapping_mul(37)).collect();
        for cut in 0..bytes.len() {
            let mut crc = Crc32c::new();
            crc.update(&bytes[..cut]);
            crc.update(&bytes[cut..]);
            assert_eq!(crc.masked(), masked(&bytes), "{cut}");
        }
    }
}

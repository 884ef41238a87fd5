//! The slow twin: lists of bits, highest first.

/// Interleaves the bits of the axes, the first axis highest.
pub fn morton(axes: [u32; 3], depth: u32) -> u64 {
    number((0..depth).rev().flat_map(|bit| axes.map(|axis| axis >> bit & 1 == 1)))
}

/// Skilling's Hilbert index: exchange and inversion of bits from the highest level down, then a Gray code undone bit by bit.
pub fn hilbert(axes: [u32; 3], depth: u32) -> u64 {
    let mut bits = axes.map(|axis| (0..depth).rev().map(|bit| axis >> bit & 1 == 1).collect::<Vec<bool>>());
    let levels = depth as usize;
    for level in 0..levels {
        for axis in 0..3 {
            let inverts = bits[axis][level];
            for lower in level + 1..levels {
                if inverts {
                    bits[0][lower] = !bits[0][lower];
                } else {
                    let exchanged = bits[0][lower];
                    bits[0][lower] = bits[axis][lower];
                    bits[axis][lower] = exchanged;
                }
            }
        }
    }
    let gray = (0..levels).flat_map(|level| [0, 1, 2].map(|axis| bits[axis][level]));
    let mut odd = false;
    number(gray.map(|bit| {
        odd ^= bit;
        odd
    }))
}

fn number(bits: impl Iterator<Item = bool>) -> u64 {
    bits.fold(0, |number, bit| number << 1 | u64::from(bit))
}

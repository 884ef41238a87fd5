//! The slow twin: lists of bits, highest first.

/// Interleaves the bits of the axes, the first axis highest.
pub fn morton(axes: [u32; 3], depth: u32) -> u64 {
    number((0..depth).rev().flat_map(|bit| axes.map(|axis| axis >> bit & 1 == 1)))
}

/// Skilling's Hilbert index: exchange and inversion of bits from the highest level down, then a Gray code undone bit by bit.
pub fn hilbert(axes: [u32; 3], depth: u32) -> u64 {
    let mut levels: Vec<[bool; 3]> = (0..depth).rev().map(|bit| axes.map(|axis| axis >> bit & 1 == 1)).collect();
    for level in 0..levels.len() {
        for axis in 0..3 {
            let inverts = levels[level][axis];
            for lower in &mut levels[level + 1..] {
                if inverts {
                    lower[0] = !lower[0];
                } else {
                    lower.swap(0, axis);
                }
            }
        }
    }
    let mut odd = false;
    number(levels.into_iter().flatten().map(|bit| {
        odd ^= bit;
        odd
    }))
}

fn number(bits: impl Iterator<Item = bool>) -> u64 {
    bits.fold(0, |number, bit| number << 1 | u64::from(bit))
}

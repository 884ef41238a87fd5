//! Buffers that layers hand on, so that fresh pages are touched once and not by every layer.

/// Free buffers.
#[derive(Debug, Default)]
pub struct Buffers {
    free: Vec<Vec<f32>>,
}

impl Buffers {
    /// A buffer of `len` values of any content.
    pub fn take(&mut self, len: usize) -> Vec<f32> {
        // The smallest that is large enough, else the largest.
        let fits = |b: &Vec<f32>| if b.capacity() >= len { (0, b.capacity()) } else { (1, usize::MAX - b.capacity()) };
        let best = self.free.iter().enumerate().min_by_key(|(_, b)| fits(b)).map(|(i, _)| i);
        let mut buffer = best.map(|i| self.free.swap_remove(i)).unwrap_or_default();
        buffer.resize(len, 0.0);
        buffer
    }

    /// Takes a buffer back.
    pub fn give(&mut self, buffer: Vec<f32>) {
        self.free.push(buffer);
    }
}

//! Loops on all threads that are compiled once.
//!
//! An iterator of rayon is compiled anew for every closure and every type that it meets, a quarter of a second each. Here one loop over numbers
//! calls what it is given through a pointer, a run of items at a time.

use std::{
    ops::Range,
    sync::{Mutex, PoisonError},
};

use rayon::prelude::*;

/// Runs into which items are divided, for each thread: as many as balance what takes unequally long.
const RUNS: usize = 16;

/// Calls `body` with each of `0..len`.
fn each(len: usize, body: &(dyn Fn(usize) + Sync)) {
    (0..len).into_par_iter().for_each(body);
}

/// Items that a thread takes in a row, of so many of which it is to take at least `least`.
fn run(len: usize, least: usize) -> usize {
    len.div_ceil(RUNS * rayon::current_num_threads()).max(least).max(1)
}

/// `[f(0), f(1), ..., f(len - 1)]`; a thread takes at least `least` in a row.
#[expect(unsafe_code, reason = "the items are written by several threads")]
pub(crate) fn map<T: Send>(len: usize, least: usize, f: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    let mut items = Vec::with_capacity(len);
    let size = run(len, least);
    for_chunks(&mut items.spare_capacity_mut()[..len], size, &|chunk, items| {
        for (i, item) in items.iter_mut().enumerate() {
            item.write(f(chunk * size + i));
        }
    });
    // SAFETY: the chunks are all of the first `len` places, and each has written all of its own.
    unsafe { items.set_len(len) };
    items
}

/// Those of `f(0), f(1), ..., f(len - 1)` that are something, in this order; a thread takes at least `least` in a row.
pub(crate) fn filter_map<T: Send>(len: usize, least: usize, f: &(dyn Fn(usize) -> Option<T> + Sync)) -> Vec<T> {
    let size = run(len, least);
    let part = |chunk: usize| -> Vec<T> { part(len, size, chunk).filter_map(f).collect() };
    let mut parts = map(len.div_ceil(size), 1, &part);
    let mut items = Vec::with_capacity(parts.iter().map(Vec::len).sum());
    parts.iter_mut().for_each(|part| items.append(part));
    items
}

/// Indices of a chunk of `size` of so many items.
fn part(len: usize, size: usize, chunk: usize) -> Range<usize> {
    chunk * size..len.min((chunk + 1) * size)
}

/// Calls `f` with the index of each of some items and the item; a thread takes at least `least` in a row.
pub(crate) fn for_each<T: Send>(items: &mut [T], least: usize, f: &(dyn Fn(usize, &mut T) + Sync)) {
    let size = run(items.len(), least);
    for_chunks(items, size, &|chunk, items| {
        items.iter_mut().enumerate().for_each(|(i, item)| f(chunk * size + i, item))
    });
}

/// Calls `f` with each index and the items that two slices have there, as far as both reach; a thread takes at least `least` in a row.
pub(crate) fn for_each_pair<A: Send, B: Send>(
    first: &mut [A],
    second: &mut [B],
    least: usize,
    f: &(dyn Fn(usize, &mut A, &mut B) + Sync),
) {
    let size = run(first.len().min(second.len()), least);
    let mut chunks: Vec<(&mut [A], &mut [B])> = first.chunks_mut(size).zip(second.chunks_mut(size)).collect();
    for_chunks(&mut chunks, 1, &|chunk, pair| {
        for (first, second) in pair {
            let both = first.iter_mut().zip(second.iter_mut()).enumerate();
            both.for_each(|(i, (a, b))| f(chunk * size + i, a, b));
        }
    });
}

/// Calls `f` with the index of each chunk of `size` items, at least one (the last chunk may be shorter), and the chunk.
pub(crate) fn for_chunks<T: Send>(items: &mut [T], size: usize, f: &(dyn Fn(usize, &mut [T]) + Sync)) {
    // A lock for each chunk, which only its own call takes.
    let chunks: Vec<Mutex<&mut [T]>> = items.chunks_mut(size).map(Mutex::new).collect();
    each(chunks.len(), &|i| f(i, &mut chunks[i].lock().unwrap_or_else(PoisonError::into_inner)));
}

#[cfg(test)]
mod tests {
    use super::{filter_map, for_chunks, for_each, for_each_pair, map};

    #[test]
    fn all_are_visited_once_in_order() {
        assert_eq!(map(5, 2, &|i| i * i), [0, 1, 4, 9, 16]);
        assert_eq!(filter_map(6, 1, &|i| (i % 2 == 1).then_some(i)), [1, 3, 5]);
        let (mut a, mut b) = ([0; 4], [0; 3]);
        for_each(&mut a, 1, &|i, item| *item += i + 1);
        for_each_pair(&mut a, &mut b, 1, &|i, a, b| (*a, *b) = (*a * 10, *a + i));
        assert_eq!((a, b), ([10, 20, 30, 4], [1, 3, 5]));
        let mut sizes = [0; 5];
        for_chunks(&mut sizes, 2, &|i, chunk| chunk.fill(10 * i + chunk.len()));
        assert_eq!(sizes, [2, 2, 12, 12, 21]);
    }
}

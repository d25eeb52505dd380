//! Parallel loops whose results do not depend on the number of threads.
//!
//! The kernels' only door to rayon. Work is cut into chunks of a fixed size that the caller chooses from the problem,
//! never from the machine; results come back in index order, and whoever folds them folds in that order. The pool is
//! the caller's: inside [`install`] everything runs on at most that many threads.
//!
//! Loops take their bodies by reference, so that the machinery is compiled once for each type of item and not for each
//! body; otherwise it is a fifth of all code.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Runs `work` on a pool of `jobs` threads (at least one); nested loops of this module stay on it.
pub fn install<R: Send>(jobs: usize, work: impl FnOnce() -> R + Send) -> R {
    let (mut work, mut result) = (Some(work), None);
    on_pool(jobs, &mut || result = work.take().map(|work| work()));
    result.unwrap_or_else(|| unreachable!("a pool runs what it is given"))
}

fn on_pool(jobs: usize, work: &mut (dyn FnMut() + Send)) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs.max(1)).build();
    match pool {
        Ok(pool) => pool.install(work),
        // No threads to be had: the same work on this one gives the same result.
        Err(_) => work(),
    }
}

/// `(0..n).map(f)` in parallel, in index order.
pub fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    fn map_dyn<T: Send>(n: usize, f: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
        (0..n).into_par_iter().with_min_len(64).map(f).collect()
    }
    map_dyn(n, &f)
}

/// Maps each whole chunk `start..end` of `chunk` indices (the last may be shorter), in order. For work whose items are
/// dear or need scratch memory per chunk.
pub fn map_chunks<T: Send>(n: usize, chunk: usize, f: impl Fn(std::ops::Range<usize>) -> T + Sync) -> Vec<T> {
    let chunk = chunk.max(1);
    let results: Vec<Mutex<Option<T>>> = (0..n.div_ceil(chunk)).map(|_| Mutex::new(None)).collect();
    for_indices(results.len(), &|c| {
        let result = f(c * chunk..((c + 1) * chunk).min(n));
        *results[c].lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
    });
    results.into_iter().filter_map(|result| result.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
}

fn for_indices(n: usize, f: &(dyn Fn(usize) + Sync)) {
    (0..n).into_par_iter().for_each(f);
}

/// Memory that tasks use one after the other. What a task finds in it must not show in its result.
#[derive(Debug, Default)]
pub struct Scratch<T>(Mutex<Vec<T>>);

impl<T: Default> Scratch<T> {
    /// Calls `work` with what another task has left, the last one if it may be, or something new.
    pub fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        let left = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut mine = left().pop().unwrap_or_default();
        let result = work(&mut mine);
        left().push(mine);
        result
    }
}

/// Both results; the two may run at the same time.
pub fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    rayon::join(a, b)
}

/// Calls `f` for every item, in parallel.
pub fn for_each<T: Send>(items: Vec<T>, f: impl Fn(T) + Sync + Send) {
    fn for_each_dyn<T: Send>(items: Vec<T>, f: &(dyn Fn(T) + Sync)) {
        items.into_par_iter().for_each(f);
    }
    for_each_dyn(items, &f);
}

/// Calls `f(index, row)` for every `row_len` items of `data`, in parallel.
pub fn for_rows<T: Send>(data: &mut [T], row_len: usize, f: impl Fn(usize, &mut [T]) + Sync) {
    fn for_rows_dyn<T: Send>(data: &mut [T], row_len: usize, f: &(dyn Fn(usize, &mut [T]) + Sync)) {
        data.par_chunks_mut(row_len.max(1)).enumerate().for_each(|(i, row)| f(i, row));
    }
    for_rows_dyn(data, row_len, &f);
}

/// Fills rows of differing length in parallel: the items of row `i` of `n` lie in `data` between `start(i)` and
/// `start(i + 1)`. Calls `f(first..last, part)` for each whole chunk of `chunk` rows (the last may be shorter) with their
/// items. Panics if starts fall or lie beyond the data.
pub fn fill_rows<T: Send>(
    mut data: &mut [T],
    n: usize,
    chunk: usize,
    start: impl Fn(usize) -> usize,
    f: impl Fn(std::ops::Range<usize>, &mut [T]) + Sync,
) {
    let mut parts = Vec::with_capacity(n.div_ceil(chunk.max(1)));
    for first in (0..n).step_by(chunk.max(1)) {
        let last = (first + chunk.max(1)).min(n);
        let (part, rest) = data.split_at_mut(start(last) - start(first));
        parts.push((first..last, part));
        data = rest;
    }
    for_each(parts, |(rows, part)| f(rows, part));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_and_chunks_do_not_depend_on_threads() {
        let run = |jobs| install(jobs, || (map(1000, |i| i * i), map_chunks(10, 4, |r| (r.start, r.end))));
        assert_eq!(run(1), run(8));
        assert_eq!(run(2).1, vec![(0, 4), (4, 8), (8, 10)]);
    }

    #[test]
    fn scratch_is_used_again() {
        let scratch = Scratch::<Vec<u32>>::default();
        scratch.with(|a| {
            a.push(1);
            scratch.with(|b| b.push(2));
        });
        assert_eq!(scratch.with(std::mem::take), [1]);
        assert_eq!(scratch.with(std::mem::take), [0; 0]);
    }

    #[test]
    fn rows_of_any_length_are_filled() {
        let starts = [0, 2, 2, 3, 7, 8];
        let mut data = [0; 8];
        let row = |rows: std::ops::Range<usize>, part: &mut [usize]| {
            let first = starts[rows.start];
            rows.for_each(|r| part[starts[r] - first..starts[r + 1] - first].fill(r));
        };
        fill_rows(&mut data, 5, 2, |r| starts[r], row);
        assert_eq!(data, [0, 0, 2, 3, 3, 3, 3, 4]);
    }
}

//! Many pairs on some threads, each of which has one in memory.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;

use anyhow::Result;
use indicatif::ProgressBar;

use super::rows::Row;

/// The pairs that were not taken yet.
struct Untaken<N> {
    /// Function that returns the next pair; `None` after the last pair and after a failure.
    next: Option<N>,
    taken: usize,
    failed: Result<()>,
}

/// Takes the pairs that `next` gives until there are none, each thread one at a time, and returns what `row`
/// makes of them, in their order. A row that tells of an error is told at once; after each, `done` learns
/// how many there are.
///
/// # Errors
/// Fails as `next` does; no pair is taken after that.
pub(super) fn rows<T>(
    threads: usize,
    bar: &ProgressBar,
    next: impl FnMut() -> Result<Option<T>> + Send,
    row: impl Fn(T) -> Row + Sync,
    done: impl Fn(usize) + Sync,
) -> Result<Vec<Row>> {
    let untaken = Mutex::new(Untaken {
        next: Some(next),
        taken: 0,
        failed: Ok(()),
    });
    let rows = Mutex::new(Vec::new());
    // A function of its own, so that the lock is let go before the pair is matched.
    let take = || locked(&untaken).take();
    let work = || {
        while let Some((index, pair)) = take() {
            let row = row(pair);
            bar.suspend(|| row.tell());
            let mut rows = locked(&rows);
            rows.push((index, row));
            done(rows.len());
        }
    };
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(work);
        }
    });
    bar.finish_and_clear();
    let untaken = untaken.into_inner();
    untaken.unwrap_or_else(PoisonError::into_inner).failed?;
    let mut rows = rows.into_inner().unwrap_or_else(PoisonError::into_inner);
    rows.sort_by_key(|(index, _)| *index);
    Ok(rows.into_iter().map(|(_, row)| row).collect())
}

impl<T, N: FnMut() -> Result<Option<T>>> Untaken<N> {
    /// The next pair, and how many were taken before it.
    fn take(&mut self) -> Option<(usize, T)> {
        let given = self.next.as_mut()?();
        let pair = given.unwrap_or_else(|error| {
            self.failed = Err(error);
            None
        });
        let Some(pair) = pair else {
            self.next = None;
            return None;
        };
        self.taken += 1;
        Some((self.taken - 1, pair))
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
    use std::time::Duration;

    use anyhow::anyhow;

    use super::*;

    /// Each of two pairs waits until the other has begun.
    #[test]
    fn threads_match_at_the_same_time() {
        type Ends = (SyncSender<()>, Receiver<()>);
        let (first, second) = (sync_channel(1), sync_channel(1));
        let mut pairs: Vec<Ends> = vec![(first.0, second.1), (second.0, first.1)];
        let next = || Ok(pairs.pop());
        let row = |(begun, other): Ends| {
            begun.send(()).unwrap();
            let met = other.recv_timeout(Duration::from_secs(60));
            let matched = Err(anyhow!(if met.is_ok() { "met" } else { "alone" }));
            Row::new(String::new(), Vec::new(), matched)
        };
        let rows = rows(2, &ProgressBar::hidden(), next, row, |_| {}).unwrap();
        let errors: Vec<_> = rows.iter().map(|row| row.error.as_deref()).collect();
        assert_eq!(errors, [Some("met"); 2]);
    }
}

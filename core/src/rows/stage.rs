//! Stages: filters from rows to rows, with a latency of a few rows.

/// A stage of the refinement, from row to row. `C` is the other data that it uses.
///
/// Rows are taken and returned from the top; a returned row replaces the one that was taken.
pub(crate) trait RowStage<C> {
    /// Whether a program has the stage: see [`Scope`](crate::kernel::Scope).
    const IS_IN_SCOPE: bool = true;

    /// Forgets the frame.
    fn reset(&mut self);

    /// Takes a row. If this completes one, writes it in the place of `row` and returns true.
    fn push(&mut self, row: &mut [i16], context: &mut C) -> bool;

    /// Writes the next remaining row to `row` after the last one was taken, and returns true;
    /// returns false if there are no more.
    fn flush(&mut self, row: &mut [i16], context: &mut C) -> bool;
}

/// A stage that may be left out: `None` returns rows unchanged. It is always `None` if the stage is not in scope.
impl<C, S: RowStage<C>> RowStage<C> for Option<S> {
    fn reset(&mut self) {
        if let Some(stage) = self
            && S::IS_IN_SCOPE
        {
            stage.reset();
        }
    }

    fn push(&mut self, row: &mut [i16], context: &mut C) -> bool {
        match self {
            Some(stage) if S::IS_IN_SCOPE => stage.push(row, context),
            _ => true,
        }
    }

    fn flush(&mut self, row: &mut [i16], context: &mut C) -> bool {
        match self {
            Some(stage) if S::IS_IN_SCOPE => stage.flush(row, context),
            _ => false,
        }
    }
}

/// Two stages, the second after the first.
#[derive(Debug)]
pub(crate) struct Then<A, B>(pub(crate) A, pub(crate) B);

impl<C, A: RowStage<C>, B: RowStage<C>> RowStage<C> for Then<A, B> {
    const IS_IN_SCOPE: bool = A::IS_IN_SCOPE && B::IS_IN_SCOPE;

    fn reset(&mut self) {
        self.0.reset();
        self.1.reset();
    }

    fn push(&mut self, row: &mut [i16], context: &mut C) -> bool {
        self.0.push(row, context) && self.1.push(row, context)
    }

    fn flush(&mut self, row: &mut [i16], context: &mut C) -> bool {
        while self.0.flush(row, context) {
            if self.1.push(row, context) {
                return true;
            }
        }
        self.1.flush(row, context)
    }
}

/// Demand of a part of the pipeline, as the part itself states it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// Name of the part.
    pub name: &'static str,
    /// Working memory, words of 32 bits.
    pub words: usize,
    /// Number of lines of the reference view, above the newest row taken, that the part still
    /// reads.
    pub look_back_lines: u32,
    /// Number of rows that must be taken after a row before that row is returned.
    pub latency_lines: u32,
}

impl Part {
    /// A part that only needs memory.
    pub(crate) const fn memory(name: &'static str, words: usize) -> Self {
        Self {
            name,
            words,
            look_back_lines: 0,
            latency_lines: 0,
        }
    }
}

/// Largest number of parts of a pipeline.
const MAX_PARTS: usize = 16;

/// Parts of a pipeline, in the order in which a line passes them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Parts {
    list: [Part; MAX_PARTS],
    count: usize,
}

impl Parts {
    /// No part.
    pub(crate) const NONE: Self = Self {
        list: [Part::memory("", 0); MAX_PARTS],
        count: 0,
    };

    /// These parts and `part` after them. No pipeline has more than [`MAX_PARTS`]: a test builds
    /// the one with all stages.
    #[must_use]
    pub(crate) const fn and(mut self, part: Part) -> Self {
        if let Some((_, free)) = self.list.split_at_mut_checked(self.count)
            && let Some((slot, _)) = free.split_first_mut()
        {
            *slot = part;
            self.count += 1;
        }
        self
    }

    /// The parts in order.
    pub(crate) const fn as_slice(&self) -> &[Part] {
        match self.list.split_at_checked(self.count) {
            Some((parts, _)) => parts,
            None => &self.list,
        }
    }

    /// Sum of the parts' memory, words.
    pub(crate) const fn words(&self) -> usize {
        let mut total = 0;
        let mut rest = self.as_slice();
        while let Some((part, after)) = rest.split_first() {
            total += part.words;
            rest = after;
        }
        total
    }

    /// Sum of the parts' latencies, lines.
    pub(crate) const fn latency_lines(&self) -> u32 {
        let mut total = 0;
        let mut rest = self.as_slice();
        while let Some((part, after)) = rest.split_first() {
            total += part.latency_lines;
            rest = after;
        }
        total
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    /// A stage that delays rows, and adds to each the row taken last.
    struct Delay {
        rows: Vec<i16>,
        ahead: usize,
    }

    impl RowStage<()> for Delay {
        fn reset(&mut self) {
            self.rows.clear();
        }

        fn push(&mut self, row: &mut [i16], (): &mut ()) -> bool {
            self.rows.push(row[0]);
            self.rows.len() > self.ahead && self.flush(row, &mut ())
        }

        fn flush(&mut self, row: &mut [i16], (): &mut ()) -> bool {
            if self.rows.is_empty() {
                return false;
            }
            row[0] = self.rows.remove(0) * 2;
            true
        }
    }

    #[test]
    fn rows_pass_all_stages_in_order_and_none_is_lost() {
        let delay = |ahead| Delay {
            rows: vec![],
            ahead,
        };
        for (a, b) in [(0, 0), (1, 0), (0, 2), (3, 2)] {
            let mut chain = Then(Some(delay(a)), Then(None::<Delay>, delay(b)));
            for count in [0, 1, 2, 9] {
                chain.reset();
                let mut found = vec![];
                for y in 0..count {
                    let mut row = [y];
                    let is_complete = chain.push(&mut row, &mut ());
                    assert_eq!(is_complete, y as usize >= a + b);
                    found.extend(is_complete.then_some(row[0]));
                }
                let mut row = [0];
                while chain.flush(&mut row, &mut ()) {
                    found.push(row[0]);
                }
                assert_eq!(found, (0..count).map(|y| 4 * y).collect::<Vec<_>>());
            }
        }
    }
}

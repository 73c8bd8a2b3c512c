//! State of a pixel in a row of disparities between the left-right check and the fill.

use crate::disparity::INVALID;

/// A pixel of a row of disparities: found, in doubt, or not found.
///
/// Disparities are counted from the lowest that is searched, in 1/16 px (suffix `_index_q4`),
/// and so are never negative. Rows store an `i16` per pixel, so that kernels see plain numbers:
/// the index where it was found, its complement (a negative number) where it is in doubt, and
/// [`INVALID`] where none was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Found(i16);

impl Found {
    /// No disparity.
    pub(crate) const NOT_FOUND: Self = Self(INVALID);

    /// Reads a stored value.
    #[inline(always)]
    pub(crate) const fn of(stored: i16) -> Self {
        Self(stored)
    }

    /// The value to store.
    #[inline(always)]
    pub(crate) const fn stored(self) -> i16 {
        self.0
    }

    /// Whether a disparity was found that is not in doubt.
    #[inline(always)]
    pub(crate) const fn holds(self) -> bool {
        self.0 >= 0
    }

    /// Whether there is a disparity, in doubt or not.
    #[inline(always)]
    pub(crate) const fn is_found(self) -> bool {
        self.0 != INVALID
    }

    /// The disparity, in doubt or not, counted from the lowest, 1/16 px. If there is none, a number
    /// above all disparities.
    #[inline(always)]
    pub(crate) const fn index_q4(self) -> i16 {
        // The complement of the sentinel is the largest number.
        self.0 ^ (self.0 >> 15)
    }

    /// This pixel with its disparity in doubt; one without a disparity stays so.
    #[inline(always)]
    pub(crate) const fn doubted(self) -> Self {
        if self.holds() { Self(!self.0) } else { self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_three_states_tell_themselves_apart() {
        for index_q4 in [0, 1, 16, 32_752] {
            let found = Found::of(index_q4);
            let doubted = Found::of(!index_q4);
            assert_eq!(found.stored(), index_q4);
            assert!(found.holds() && found.is_found());
            assert!(!doubted.holds() && doubted.is_found());
            assert_eq!((found.index_q4(), doubted.index_q4()), (index_q4, index_q4));
            assert_eq!((found.doubted(), doubted.doubted()), (doubted, doubted));
            assert_eq!(Found::of(doubted.stored()), doubted);
            assert!(Found::NOT_FOUND.index_q4() > index_q4);
        }
        let none = Found::NOT_FOUND;
        assert!(!none.holds() && !none.is_found());
        assert_eq!(none.doubted(), none);
        assert_eq!(none.stored(), INVALID);
    }
}

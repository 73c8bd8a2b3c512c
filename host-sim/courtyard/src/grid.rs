//! Lists of the objects near a place, so that a ray tries only few of them.

/// A grid of square cells over a plane. For each cell it lists the objects that a ray through
/// the cell can meet.
///
/// Rays of a camera use a grid over its image, px. Shadow rays use a grid over a plane across
/// the direction of the sun, m.
#[derive(Debug)]
pub(crate) struct Grid {
    left: f64,
    top: f64,
    /// The side of a cell.
    cell: f64,
    columns: usize,
    rows: usize,
    /// The indices of the objects of each cell, row-major.
    cells: Vec<Vec<u16>>,
}

impl Grid {
    /// Returns an empty grid from the corner `(left, top)` on, whose cells have the side `cell`.
    pub(crate) fn new(left: f64, top: f64, cell: f64, columns: usize, rows: usize) -> Self {
        Self {
            left,
            top,
            cell,
            columns,
            rows,
            cells: vec![Vec::new(); columns * rows],
        }
    }

    /// Adds an object to the cells that the rectangle `[left, right, top, bottom]` touches.
    pub(crate) fn insert(&mut self, object: u16, [left, right, top, bottom]: [f64; 4]) {
        // Saturating casts: spans off the grid end at its border.
        let clip =
            |position: f64, cells: usize| (position / self.cell).clamp(0.0, cells as f64) as usize;
        let first_column = clip(left - self.left, self.columns);
        let last_column = clip(right - self.left + self.cell, self.columns);
        let first_row = clip(top - self.top, self.rows);
        let last_row = clip(bottom - self.top + self.cell, self.rows);
        for row in first_row..last_row {
            for column in first_column..last_column {
                self.cells[row * self.columns + column].push(object);
            }
        }
    }

    /// Returns the objects that a ray at a position can meet; none outside the grid.
    pub(crate) fn at(&self, x: f64, y: f64) -> &[u16] {
        let column = (x - self.left) / self.cell;
        let row = (y - self.top) / self.cell;
        if column < 0.0 || row < 0.0 {
            return &[];
        }
        let (column, row) = (column as usize, row as usize);
        if column >= self.columns || row >= self.rows {
            return &[];
        }
        &self.cells[row * self.columns + column]
    }
}

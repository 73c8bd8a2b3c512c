//! Colours of surfaces. They depend only on the surface point, so that both views show equal
//! colours.
//!
//! Detail finer than a pixel fades to its mean, so that it does not alias differently in
//! the two views.

use crate::noise::{
    edge, fractal2, fractal3, fraction, hash, mix, noise2, noise3, pebbles, split, step, visible,
};
use crate::vector::Vec3;

/// Squares of the board of squares, along its long and its short side.
pub const SQUARES: [u32; 2] = [10, 7];
/// The side of a square, mm.
pub const SQUARE_MM: u32 = 40;
/// The side of a square, m.
pub(crate) const SQUARE: f64 = SQUARE_MM as f64 / 1000.0;

/// Red, green and blue as they are displayed, each 0 to 1.
pub(crate) type Colour = [f64; 3];

/// The material of a surface, which decides its texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Material {
    /// A brick wall, partly under smooth plaster.
    Wall,
    /// A path of slabs between gravel.
    Ground,
    /// The wood of a crate.
    Crate,
    /// Veined stone.
    Marble,
    /// The glaze of a ball, with wavy bands.
    Glaze,
    /// The bark of a tree.
    Bark,
    /// Tin with a diamond pattern.
    Tin,
    /// A printed board.
    Board,
    /// A diagonal lattice, open between its slats.
    Lattice,
    /// A bamboo cane.
    Bamboo,
    /// The plain wood of thin parts, painted or grown.
    Stick,
    /// A leaf, cut out of its sheet.
    Leaf,
    /// A board of black and white squares with a white border.
    Squares,
}

/// A place on a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    /// The position in the world, m.
    pub point: Vec3,
    /// The coordinates on the surface, m.
    pub u: f64,
    pub v: f64,
    /// Half the extent of the surface along `u` and `v`, m.
    pub half_u: f64,
    pub half_v: f64,
    /// The width of a pixel on the surface, m.
    pub pixel: f64,
    /// A number that makes the textures of objects of one material differ.
    pub tint: u32,
}

/// Returns `a` at `share` 0, `b` at `share` 1, and a mixture in proportion between.
pub(crate) fn blend(a: Colour, b: Colour, share: f64) -> Colour {
    [
        mix(a[0], b[0], share),
        mix(a[1], b[1], share),
        mix(a[2], b[2], share),
    ]
}

fn scale(colour: Colour, factor: f64) -> Colour {
    colour.map(|channel| channel * factor)
}

fn pick(palette: &[Colour], bits: u32) -> Colour {
    let index = (bits >> 8) as usize % palette.len().max(1);
    palette.get(index).copied().unwrap_or_default()
}

/// Returns whether a sheet of `material` is solid at `(u, v)`, m, rather than open. `half_u` and
/// `half_v` are half the extents of the sheet, m.
pub(crate) fn is_solid(material: Material, u: f64, v: f64, half_u: f64, half_v: f64) -> bool {
    match material {
        Material::Leaf => {
            let along = u / half_u;
            let width = (1.0 - along * along) * (1.0 - 0.35 * along);
            v.abs() < half_v * width * 0.9
        }
        Material::Lattice => {
            if u.abs() > half_u - LATTICE_SLAT || v.abs() > half_v - LATTICE_SLAT {
                return true;
            }
            let (_, rising) = split((u + v) / LATTICE_STEP);
            let (_, falling) = split((u - v) / LATTICE_STEP);
            let share = LATTICE_SLAT / LATTICE_STEP;
            rising < share || falling < share
        }
        _ => true,
    }
}

/// The distance between the slats of the lattice along `u + v`, m.
const LATTICE_STEP: f64 = 0.2;
/// The width of a slat of the lattice along `u + v`, m.
const LATTICE_SLAT: f64 = 0.042;

/// Returns the colour of a material at a place.
pub(crate) fn colour(material: Material, place: &Place, seed: u32) -> Colour {
    let seed = seed ^ place.tint;
    match material {
        Material::Wall => wall(place, seed),
        Material::Ground => ground(place, seed),
        Material::Crate => crate_face(place, seed),
        Material::Marble => marble(place, seed),
        Material::Glaze => glaze(place, seed),
        Material::Bark => bark(place, seed),
        Material::Tin => tin(place, seed),
        Material::Board => board(place, seed),
        Material::Lattice => {
            let grain = fractal2(place.u * 40.0, place.v * 40.0, place.pixel * 40.0, 3, seed);
            scale([0.86, 0.88, 0.84], 1.0 + 0.12 * grain)
        }
        Material::Bamboo => bamboo(place, seed),
        Material::Stick => {
            let grain = fractal2(place.u * 90.0, place.v * 35.0, place.pixel * 60.0, 3, seed);
            scale([0.44, 0.33, 0.23], 1.0 + 0.4 * grain)
        }
        Material::Leaf => leaf(place, seed),
        Material::Squares => squares(place),
    }
}

/// Returns the colour of a material without its texture: about the mean of its colours.
pub(crate) fn paint(material: Material) -> Colour {
    match material {
        Material::Wall => [0.74, 0.58, 0.48],
        Material::Ground => [0.60, 0.55, 0.47],
        Material::Crate => [0.58, 0.43, 0.27],
        Material::Marble => [0.52, 0.63, 0.60],
        Material::Glaze => [0.66, 0.46, 0.28],
        Material::Bark => [0.42, 0.34, 0.27],
        Material::Tin => [0.55, 0.55, 0.45],
        Material::Board => [0.80, 0.77, 0.69],
        Material::Lattice => [0.86, 0.88, 0.84],
        Material::Bamboo => [0.69, 0.64, 0.34],
        Material::Stick => [0.44, 0.33, 0.23],
        Material::Leaf => [0.37, 0.51, 0.18],
        Material::Squares => blend(INK, PAPER, 0.5),
    }
}

/// The black and the white of the board of squares. Even in the sun, white is not clipped, which would
/// move the edges.
const INK: Colour = [0.10; 3];
const PAPER: Colour = [0.66; 3];

fn squares(place: &Place) -> Colour {
    // 1 and -1 in alternating squares along a side, with a step between; and whether there are any.
    let side = |at: f64, count: u32| {
        let reach = 0.5 * f64::from(count) * SQUARE;
        let (index, _) = split((at + reach) / SQUARE);
        let lines = (1..count).map(|line| (at + reach - f64::from(line) * SQUARE).abs());
        let nearest = lines.fold(f64::INFINITY, f64::min);
        let step = edge(0.0, nearest, place.pixel) * 2.0 - 1.0;
        let inside = edge(0.0, reach - at.abs(), place.pixel);
        (if index & 1 == 0 { step } else { -step }, inside)
    };
    let [columns, rows] = SQUARES;
    let (column, within_columns) = side(place.u, columns);
    let (row, within_rows) = side(place.v, rows);
    let ink = (0.5 + 0.5 * column * row) * within_columns * within_rows;
    blend(PAPER, INK, ink)
}

fn wall(place: &Place, seed: u32) -> Colour {
    let &Place { u, v, pixel, .. } = place;
    const LENGTH: f64 = 0.30;
    const HEIGHT: f64 = 0.11;
    const PALETTE: [Colour; 6] = [
        [0.66, 0.35, 0.26],
        [0.72, 0.42, 0.30],
        [0.58, 0.29, 0.23],
        [0.76, 0.50, 0.36],
        [0.52, 0.31, 0.27],
        [0.69, 0.39, 0.31],
    ];
    // Where the plaster still holds: the upper right, with a ragged border.
    let border = (u - 0.15).min(v - 0.62) + 0.30 * fractal2(u * 1.7, v * 1.7, pixel * 1.7, 5, seed);
    let plaster = edge(0.0, border, pixel.max(0.012));
    let rim = step(0.0, 0.06, border);
    let smooth = scale(
        [0.83, 0.78, 0.68],
        (0.90 + 0.10 * rim) * (1.0 + 0.025 * fractal2(u * 2.0, v * 2.0, pixel * 2.0, 6, seed ^ 3)),
    );
    if plaster >= 1.0 {
        return smooth;
    }
    let (row, fv) = split(v / HEIGHT);
    let (column, fu) = split(u / LENGTH + if row & 1 == 0 { 0.0 } else { 0.5 });
    let from_edge = (fu.min(1.0 - fu) * LENGTH).min(fv.min(1.0 - fv) * HEIGHT);
    let ragged = from_edge + 0.004 * noise2(u * 45.0, v * 45.0, seed ^ 5) * visible(0.02 / pixel);
    let face = edge(0.0085, ragged, pixel + 0.003);
    let bits = hash(column, row, 3, seed);
    let grain = fractal2(u * 14.0, v * 20.0, pixel * 17.0, 5, bits);
    let tone = 0.85 + 0.3 * fraction(bits.rotate_left(9));
    let brick = scale(pick(&PALETTE, bits), tone * (1.0 + 0.30 * grain));
    let mortar = scale(
        [0.70, 0.66, 0.59],
        1.0 + 0.2 * fractal2(u * 30.0, v * 30.0, pixel * 30.0, 3, seed ^ 6),
    );
    let wear = fractal2(u * 0.9, v * 1.3, pixel, 5, seed ^ 7);
    let bare = scale(blend(mortar, brick, face), 1.0 + 0.22 * wear);
    let damp = (1.0 - step(0.0, 0.45, v + 0.25 * wear)) * 0.55;
    blend(blend(bare, [0.27, 0.30, 0.20], damp), smooth, plaster)
}

fn gravel(x: f64, z: f64, pixel: f64, seed: u32) -> Colour {
    const PALETTE: [Colour; 7] = [
        [0.66, 0.62, 0.55],
        [0.54, 0.51, 0.47],
        [0.76, 0.72, 0.64],
        [0.43, 0.40, 0.38],
        [0.63, 0.53, 0.42],
        [0.84, 0.81, 0.76],
        [0.50, 0.43, 0.36],
    ];
    const SIZE: f64 = 0.045;
    let (inside, bits) = pebbles(x / SIZE, z / SIZE, seed);
    let round = 0.30 + 0.70 * step(0.0, 0.45, inside);
    let grain = fractal2(x * 60.0, z * 60.0, pixel * 60.0, 3, bits);
    let pebble = scale(pick(&PALETTE, bits), round * (1.0 + 0.2 * grain));
    let patches = 1.0 + 0.22 * fractal2(x * 3.0, z * 3.0, pixel * 3.0, 6, seed ^ 1);
    let far = [0.52, 0.48, 0.43];
    scale(blend(far, pebble, visible(SIZE / pixel)), patches)
}

fn ground(place: &Place, seed: u32) -> Colour {
    let &Place {
        u: x, v: z, pixel, ..
    } = place;
    const SLAB: f64 = 0.36;
    let stones = gravel(x, z, pixel, seed);
    // The path leaves the camera at an angle.
    let across = x * 0.94 - z * 0.34 + 0.42;
    let along = x * 0.34 + z * 0.94;
    let wander = 0.05 * fractal2(x * 7.0, z * 7.0, pixel * 7.0, 4, seed ^ 2);
    let path = edge(0.0, 2.0 * SLAB - across.abs() + wander * 0.6, pixel);
    if path <= 0.0 {
        return stones;
    }
    let (column, fx) = split(across / SLAB);
    let (row, fz) = split(along / SLAB);
    let joint = fx.min(1.0 - fx).min(fz.min(1.0 - fz)) * SLAB + 0.12 * wander;
    let bits = hash(column, row, 5, seed);
    let base = if (column ^ row) & 1 == 0 {
        [0.72, 0.62, 0.50]
    } else {
        [0.47, 0.45, 0.45]
    };
    let grain = fractal2(x * 18.0, z * 18.0, pixel * 18.0, 6, bits);
    let tone = 0.86 + 0.26 * fraction(bits);
    let pits = fractal2(x * 85.0, z * 85.0, pixel * 85.0, 3, seed ^ 4);
    let slab = scale(base, tone * (1.0 + 0.30 * grain + 0.20 * pits));
    let moss = blend([0.26, 0.30, 0.17], stones, 0.35);
    let face = edge(0.012, joint, pixel + 0.004);
    blend(stones, blend(moss, slab, face), path)
}

/// Returns the colour of wood whose grain runs along the coordinate `along`.
fn wood(along: f64, across: f64, pixel: f64, seed: u32) -> Colour {
    let bend = 0.05 * noise2(along * 3.0, across * 4.0, seed ^ 9);
    let rings = fractal2(
        along * 2.5,
        (across + bend) * 38.0,
        pixel * 38.0,
        4,
        seed ^ 10,
    );
    let pores = fractal2(along * 16.0, across * 110.0, pixel * 90.0, 2, seed ^ 11);
    let share = (0.5 + 0.55 * rings + 0.2 * pores).clamp(0.0, 1.0);
    blend([0.80, 0.62, 0.40], [0.47, 0.30, 0.17], share)
}

fn crate_face(place: &Place, seed: u32) -> Colour {
    let &Place { u, v, pixel, .. } = place;
    let (half_u, half_v) = (place.half_u, place.half_v);
    const FRAME: f64 = 0.075;
    const PLANK: f64 = 0.11;
    let from_side = half_u - u.abs();
    let from_end = half_v - v.abs();
    let brace = (u * half_v - v * half_u).abs() / (half_u * half_u + half_v * half_v).sqrt();
    let gap = |distance: f64, bits: u32, wood: Colour| {
        let tone = 0.82 + 0.3 * fraction(bits);
        scale(
            wood,
            tone * (0.25 + 0.75 * edge(0.004, distance, pixel + 0.004)),
        )
    };
    if from_end < FRAME {
        let bits = hash(i32::from(v > 0.0), 1, 7, seed);
        gap((FRAME - from_end).abs(), bits, wood(u, v, pixel, bits))
    } else if from_side < FRAME {
        let bits = hash(i32::from(u > 0.0), 2, 7, seed);
        gap((FRAME - from_side).abs(), bits, wood(v, u, pixel, bits))
    } else if brace < FRAME * 0.5 {
        let bits = hash(0, 3, 7, seed);
        let (along, across) = (u * 0.71 + v * 0.71, u * 0.71 - v * 0.71);
        gap(FRAME * 0.5 - brace, bits, wood(along, across, pixel, bits))
    } else {
        let (plank, rest) = split((u + half_u) / PLANK);
        let bits = hash(plank, 4, 7, seed);
        let colour = gap(rest.min(1.0 - rest) * PLANK, bits, wood(v, u, pixel, bits));
        scale(colour, 0.82)
    }
}

fn marble(place: &Place, seed: u32) -> Colour {
    let point = place.point;
    let cloud = fractal3(point * 5.0, place.pixel * 5.0, 6, seed ^ 12);
    let vein = fractal3(point * 7.0, place.pixel * 7.0, 5, seed ^ 13);
    let line = 1.0 - step(0.0, 0.16, vein.abs());
    let speckle = fractal3(point * 60.0, place.pixel * 60.0, 3, seed ^ 14);
    let base = blend(
        [0.36, 0.50, 0.50],
        [0.68, 0.76, 0.70],
        (0.5 + 0.7 * cloud).clamp(0.0, 1.0),
    );
    let veined = blend(base, [0.93, 0.92, 0.86], line * 0.75);
    scale(veined, 1.0 + 0.30 * speckle)
}

fn glaze(place: &Place, seed: u32) -> Colour {
    const PALETTE: [Colour; 4] = [
        [0.87, 0.49, 0.16],
        [0.95, 0.83, 0.56],
        [0.74, 0.25, 0.15],
        [0.20, 0.36, 0.46],
    ];
    let point = place.point;
    let wave = 0.022 * noise3(point * 14.0, seed ^ 15);
    let (band, _) = split((place.v + 0.35 * place.u + wave) / 0.055);
    let spots = fractal3(point * 38.0, place.pixel * 38.0, 4, seed ^ 16);
    let base = pick(&PALETTE, (band & 3).cast_unsigned() << 8);
    let spotted = blend(base, [0.30, 0.15, 0.10], step(0.35, 0.55, spots) * 0.7);
    scale(spotted, 1.0 + 0.18 * spots)
}

fn bark(place: &Place, seed: u32) -> Colour {
    let &Place { u, v, pixel, .. } = place;
    let twist = 0.03 * noise2(u * 6.0, v * 5.0, seed ^ 17);
    let ridges = fractal2((u + twist) * 22.0, v * 5.0, pixel * 20.0, 5, seed ^ 18);
    let fine = fractal2(u * 45.0, v * 45.0, pixel * 45.0, 3, seed ^ 19);
    let share = (0.45 + 0.8 * ridges + 0.25 * fine).clamp(0.0, 1.0);
    let lichen = step(
        0.25,
        0.5,
        fractal2(u * 6.0, v * 6.0, pixel * 6.0, 5, seed ^ 20),
    );
    let wood = blend([0.23, 0.17, 0.13], [0.60, 0.50, 0.40], share);
    blend(wood, [0.58, 0.62, 0.46], lichen * 0.5)
}

fn tin(place: &Place, seed: u32) -> Colour {
    let &Place { u, v, pixel, .. } = place;
    let height = 2.0 * place.half_v;
    let scuff = fractal2(u * 25.0, v * 25.0, pixel * 25.0, 5, seed ^ 21);
    let worn = 1.0 + 0.16 * scuff;
    if v > height {
        return scale([0.70, 0.71, 0.72], worn);
    }
    let from_end = v.min(height - v);
    if from_end < 0.018 {
        return scale([0.76, 0.76, 0.74], worn);
    }
    if from_end < 0.05 {
        return scale([0.90, 0.86, 0.72], worn);
    }
    let (rising, _) = split((u + v) / 0.06);
    let (falling, _) = split((u - v) / 0.06);
    let base = if (rising ^ falling) & 1 == 0 {
        [0.14, 0.34, 0.55]
    } else {
        [0.91, 0.76, 0.30]
    };
    scale(base, worn)
}

fn board(place: &Place, seed: u32) -> Colour {
    let (half_u, half_v) = (place.half_u, place.half_v);
    // Print runs from the upper left corner.
    let (x, y) = (half_u - place.u, half_v - place.v);
    let paper = scale(
        [0.90, 0.87, 0.78],
        1.0 + 0.07 * fractal2(x * 12.0, y * 12.0, place.pixel * 12.0, 6, seed ^ 22),
    );
    let ink = [0.13, 0.13, 0.17];
    let from_edge = (half_u - place.u.abs()).min(half_v - place.v.abs());
    if from_edge < 0.022 {
        return scale([0.33, 0.19, 0.12], 1.0 + 2.0 * (paper[0] - 0.9));
    }
    let (left, top) = (x - 0.055, y - 0.05);
    let (width, height) = (2.0 * half_u - 0.11, 2.0 * half_v - 0.10);
    if left < 0.0 || top < 0.0 || left > width || top > height {
        return paper;
    }
    // A checker patch in the lower right corner.
    let patch = 0.24;
    if left > width - patch && top > height - patch {
        let (column, _) = split((left - width + patch) / 0.04);
        let (row, _) = split((top - height + patch) / 0.04);
        return if (column ^ row) & 1 == 0 { ink } else { paper };
    }
    // Lines of made-up letters, three by five dots each; the headline is larger and red.
    let headline = 0.13;
    let (dot, origin, tone) = if top < headline {
        (0.022, 0.0, [0.66, 0.14, 0.12])
    } else {
        (0.0115, headline, ink)
    };
    let (letter, column) = split(left / (dot * 4.0));
    let (line, row) = split((top - origin) / (dot * 7.0));
    let (column, row) = ((column * 4.0) as u32, (row * 7.0) as u32);
    let bits = hash(letter, line, 8, seed ^ u32::from(top < headline));
    let space = bits >> 29 == 0;
    // No cut letters at the right, at the foot or before the patch.
    let end = f64::from(letter + 1) * dot * 4.0;
    let foot = origin + f64::from(line + 1) * dot * 7.0;
    let margin = if foot > height - patch { patch } else { 0.0 };
    let fits = end <= width - margin && foot <= height;
    let inked = fits && column < 3 && row < 5 && (bits >> (row * 3 + column)) & 1 == 1;
    if inked && !space { tone } else { paper }
}

fn bamboo(place: &Place, seed: u32) -> Colour {
    let &Place { u, v, pixel, .. } = place;
    let (joint, rest) = split(v / 0.17);
    let bits = hash(joint, 0, 9, seed);
    let grain = fractal2(u * 160.0, v * 14.0, pixel * 100.0, 3, bits);
    let blotch = fractal2(u * 25.0, v * 25.0, pixel * 25.0, 5, seed ^ 23);
    let node = 1.0 - step(0.0, 0.06, rest.min(1.0 - rest));
    let base = blend([0.80, 0.70, 0.40], [0.58, 0.58, 0.28], fraction(bits));
    scale(
        blend(base, [0.33, 0.25, 0.14], node * 0.8),
        1.0 + 0.20 * grain + 0.25 * blotch,
    )
}

fn leaf(place: &Place, seed: u32) -> Colour {
    let &Place { u, v, pixel, .. } = place;
    let hue = fraction(hash(0, 0, 10, seed));
    let base = blend([0.22, 0.42, 0.14], [0.52, 0.60, 0.22], hue);
    let blotch = fractal2(u * 60.0, v * 60.0, pixel * 60.0, 4, seed ^ 24);
    let rib = 1.0 - edge(0.0012, v.abs(), pixel + 0.001);
    let toned = scale(base, 1.0 + 0.35 * blotch);
    blend(toned, [0.72, 0.76, 0.46], rib * 0.6)
}

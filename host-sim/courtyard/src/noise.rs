//! Noise and soft steps, from which the textures are made.
//!
//! All are functions of a place and a seed alone, so that both views see equal textures.

use crate::vector::Vec3;

/// Returns 32 evenly distributed bits that depend on three whole coordinates and a seed.
pub(crate) fn hash(x: i32, y: i32, z: i32, seed: u32) -> u32 {
    let mut bits = seed
        ^ x.cast_unsigned().wrapping_mul(0x9E37_79B1)
        ^ y.cast_unsigned().wrapping_mul(0x85EB_CA77).rotate_left(11)
        ^ z.cast_unsigned().wrapping_mul(0xC2B2_AE3D).rotate_left(21);
    bits = (bits ^ (bits >> 16)).wrapping_mul(0x21F0_AAAD);
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x735A_2D97);
    bits ^ (bits >> 15)
}

/// Returns the bits of a hash as a number from 0 on and below 1.
pub(crate) fn fraction(bits: u32) -> f64 {
    f64::from(bits) / 4_294_967_296.0
}

/// Returns the largest whole number that is not above `value`, and the rest, 0 to 1.
pub(crate) fn split(value: f64) -> (i32, f64) {
    // The cast saturates far outside the scene.
    let whole = value as i32;
    let whole = whole.saturating_sub(i32::from(value < f64::from(whole)));
    (whole, value - f64::from(whole))
}

/// Returns `a` at `share` 0, `b` at `share` 1, and a mixture in proportion between.
pub(crate) fn mix(a: f64, b: f64, share: f64) -> f64 {
    a + (b - a) * share
}

/// Returns 0 below `low`, 1 above `high` and a smooth transition between.
pub(crate) fn step(low: f64, high: f64, value: f64) -> f64 {
    let share = ((value - low) / (high - low)).clamp(0.0, 1.0);
    ease(share)
}

/// Returns a smooth transition from 0 to 1 for a share from 0 to 1, with slope 0 at both ends.
fn ease(share: f64) -> f64 {
    share * share * (3.0 - 2.0 * share)
}

/// Returns 0 below a threshold, 1 above it and a smooth transition over a pixel about it.
pub(crate) fn edge(threshold: f64, value: f64, pixel: f64) -> f64 {
    step(threshold - pixel * 0.5, threshold + pixel * 0.5, value)
}

/// Returns value noise in the plane, -1 to 1, with features of size 1.
pub(crate) fn noise2(x: f64, y: f64, seed: u32) -> f64 {
    let ((column, fx), (row, fy)) = (split(x), split(y));
    let corner =
        |dx: i32, dy: i32| fraction(hash(column.wrapping_add(dx), row.wrapping_add(dy), 0, seed));
    let (fx, fy) = (ease(fx), ease(fy));
    let top = mix(corner(0, 0), corner(1, 0), fx);
    let bottom = mix(corner(0, 1), corner(1, 1), fx);
    mix(top, bottom, fy) * 2.0 - 1.0
}

/// Returns value noise in space, -1 to 1, with features of size 1.
pub(crate) fn noise3(point: Vec3, seed: u32) -> f64 {
    let ((x, fx), (y, fy), (z, fz)) = (split(point.x), split(point.y), split(point.z));
    let (fx, fy, fz) = (ease(fx), ease(fy), ease(fz));
    let layer = |dz: i32| {
        let corner = |dx: i32, dy: i32| {
            fraction(hash(
                x.wrapping_add(dx),
                y.wrapping_add(dy),
                z.wrapping_add(dz),
                seed,
            ))
        };
        mix(
            mix(corner(0, 0), corner(1, 0), fx),
            mix(corner(0, 1), corner(1, 1), fx),
            fy,
        )
    };
    mix(layer(0), layer(1), fz) * 2.0 - 1.0
}

/// Returns how much of a detail that is `pixels` pixels wide is drawn: 0 for nothing, 1 for all.
pub(crate) fn visible(pixels: f64) -> f64 {
    step(0.8, 2.2, pixels)
}

/// Returns the sum of up to `count` octaves of noise, down to details as small as a pixel.
/// `pixel` is the width of a pixel in the unit of the first octave's features.
fn octaves(pixel: f64, count: u32, noise: impl Fn(f64, u32) -> f64) -> f64 {
    let (mut frequency, mut weight, mut sum) = (1.0, 0.6, 0.0);
    for octave in 0..count {
        let share = visible(1.0 / (frequency * pixel));
        if share <= 0.0 {
            break;
        }
        sum += weight * share * noise(frequency, octave);
        frequency *= 2.07;
        weight *= 0.68;
    }
    sum
}

/// Returns octaves of noise in the plane; see [`octaves`].
pub(crate) fn fractal2(x: f64, y: f64, pixel: f64, count: u32, seed: u32) -> f64 {
    octaves(pixel, count, |frequency, octave| {
        noise2(x * frequency, y * frequency, seed.wrapping_add(octave))
    })
}

/// Returns octaves of noise in space; see [`octaves`].
pub(crate) fn fractal3(point: Vec3, pixel: f64, count: u32, seed: u32) -> f64 {
    octaves(pixel, count, |frequency, octave| {
        noise3(point * frequency, seed.wrapping_add(octave))
    })
}

/// Returns how far a place is inside its pebble, and the hash of that pebble. The plane is
/// covered with pebbles of size 1; at 0 the place is between two of them.
pub(crate) fn pebbles(x: f64, y: f64, seed: u32) -> (f64, u32) {
    let ((column, fx), (row, fy)) = (split(x), split(y));
    let (mut first, mut second, mut found) = (9.0, 9.0, 0);
    for dy in -1..=1 {
        for dx in -1..=1 {
            let bits = hash(column.wrapping_add(dx), row.wrapping_add(dy), 1, seed);
            let px = f64::from(dx) + f64::from(bits & 0xFFFF) / 65536.0 - fx;
            let py = f64::from(dy) + f64::from(bits >> 16) / 65536.0 - fy;
            let distance = px * px + py * py;
            if distance < first {
                (second, first, found) = (first, distance, bits);
            } else if distance < second {
                second = distance;
            }
        }
    }
    (second.sqrt() - first.sqrt(), hash(0, 0, 2, found ^ seed))
}

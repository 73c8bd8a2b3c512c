//! Offsets drawn from a seed, compared with those of `golden/offsets.py`, an independent program.

use rand_core::SeedableRng;
use rand_pcg::Pcg32;
use vgstereo_core::config::{MAX_SYNAPSES, Support};
use vgstereo_core::pattern::{OffsetLaw, Synapses};

struct Golden {
    seed: u64,
    sigma_px: f32,
    support: Support,
    cell_length_max_px: u8,
    first: [[i8; 2]; 8],
    crc32: u32,
}

#[test]
fn seeded_offsets_are_those_of_an_independent_program() {
    for golden in [
        // python3 offsets.py 1 4 12 12 0 1024
        Golden {
            seed: 1,
            sigma_px: 4.0,
            support: Support::square(12),
            cell_length_max_px: 0,
            first: [
                [-7, 0],
                [2, 1],
                [1, 1],
                [2, 1],
                [2, 1],
                [-2, 5],
                [3, 0],
                [3, -5],
            ],
            crc32: 0xc237_cd41,
        },
        // python3 offsets.py 7 10 30 30 0 1024
        Golden {
            seed: 7,
            sigma_px: 10.0,
            support: Support::square(30),
            cell_length_max_px: 0,
            first: [
                [9, 6],
                [4, -9],
                [-5, 10],
                [15, -13],
                [3, -20],
                [-3, 8],
                [2, -3],
                [10, 1],
            ],
            crc32: 0xf57b_5ca9,
        },
        // python3 offsets.py 3 1.5 5 3 0 1024
        Golden {
            seed: 3,
            sigma_px: 1.5,
            support: Support { x_px: 5, y_px: 3 },
            cell_length_max_px: 0,
            first: [
                [1, 2],
                [0, 0],
                [2, 3],
                [0, -1],
                [0, 2],
                [2, 1],
                [1, 1],
                [2, -1],
            ],
            crc32: 0x23b8_9d5a,
        },
        // python3 offsets.py 1 2.5 8 5 4 1024
        Golden {
            seed: 1,
            sigma_px: 2.5,
            support: Support { x_px: 8, y_px: 5 },
            cell_length_max_px: 4,
            first: [
                [-4, 0],
                [0, 0],
                [1, 1],
                [1, 0],
                [-1, 3],
                [0, 3],
                [-1, 0],
                [-1, -1],
            ],
            crc32: 0xc31f_0a1c,
        },
    ] {
        let mut stored = [[0; 2]; MAX_SYNAPSES];
        let mut generator = Pcg32::seed_from_u64(golden.seed);
        let law = OffsetLaw {
            sigma_px: golden.sigma_px,
            support: golden.support,
            cell_length_max_px: golden.cell_length_max_px,
        };
        Synapses::draw(&mut stored, law, &mut generator).unwrap();
        assert_eq!(stored[..8], golden.first, "seed {}", golden.seed);
        let bytes: Vec<u8> = stored
            .as_flattened()
            .iter()
            .map(|&v| v.cast_unsigned())
            .collect();
        assert_eq!(
            crc32fast::hash(&bytes),
            golden.crc32,
            "seed {}",
            golden.seed
        );
    }
}

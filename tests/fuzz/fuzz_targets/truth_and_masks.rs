//! Fuzz target `truth_and_masks`: see [`vgstereo_tests::fuzz::truth_and_masks`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::truth_and_masks::run(bytes));

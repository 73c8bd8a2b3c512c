//! Fuzz target `images`: see [`vgstereo_tests::fuzz::images`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::images::run(bytes));

//! Fuzz target `matcher`: see [`vgstereo_tests::fuzz::matcher`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::matcher::run(bytes));

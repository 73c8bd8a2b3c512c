//! Fuzz target `link_lines`: see [`vgstereo_tests::fuzz::link_lines`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::link_lines::run(bytes));

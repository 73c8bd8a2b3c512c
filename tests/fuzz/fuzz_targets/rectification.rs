//! Fuzz target `rectification`: see [`vgstereo_tests::fuzz::rectification`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::rectification::run(bytes));

//! Fuzz target `recording`: see [`vgstereo_tests::fuzz::recording`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::recording::run(bytes));

//! Fuzz target `meta`: see [`vgstereo_tests::fuzz::meta`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::meta::run(bytes));

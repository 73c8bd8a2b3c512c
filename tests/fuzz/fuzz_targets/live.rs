//! Fuzz target `live`: see [`vgstereo_tests::fuzz::live`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::live::run(bytes));

//! Fuzz target `calibration`: see [`vgstereo_tests::fuzz::calibration`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::calibration::run(bytes));

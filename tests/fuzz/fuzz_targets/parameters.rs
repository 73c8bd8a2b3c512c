//! Fuzz target `parameters`: see [`vgstereo_tests::fuzz::parameters`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::parameters::run(bytes));

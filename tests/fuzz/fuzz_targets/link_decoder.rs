//! Fuzz target `link_decoder`: see [`vgstereo_tests::fuzz::link_decoder`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::link_decoder::run(bytes));

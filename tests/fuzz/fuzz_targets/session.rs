//! Fuzz target `session`: see [`vgstereo_tests::fuzz::session`].

#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::session::run(bytes));

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| lgs_fuzz::run("waymo-v2", input));

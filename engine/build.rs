//! Says whether the repository has weights that ship: `cfg(lgs_shipped_weights)`.

use std::path::Path;

fn main() {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
    // The directory, not the file: cargo takes a file that is not there for one that changes all the time.
    cargo(&format!("rerun-if-changed={}", models.display()));
    cargo("rustc-check-cfg=cfg(lgs_shipped_weights)");
    if models.join("tiny.safetensors").is_file() {
        cargo("rustc-cfg=lgs_shipped_weights");
    }
}

fn cargo(instruction: &str) {
    println!("cargo::{instruction}");
}

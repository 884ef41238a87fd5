//! Writes the inputs that a fuzzer starts from: `cargo +nightly run --release --example seeds FOLDER` fills `FOLDER/TARGET`.

use std::fs;
use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        return Err(std::io::Error::other("expected a folder"));
    };
    for target in lgs_fuzz::targets() {
        let to = folder.join(target.name.replace('-', "_"));
        fs::create_dir_all(&to)?;
        for (k, seed) in lgs_fuzz::stage_of(target.name).seeds().iter().enumerate() {
            fs::write(to.join(format!("seed-{k:03}")), seed)?;
        }
    }
    Ok(())
}

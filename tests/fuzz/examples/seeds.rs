//! Writes the inputs that a fuzzer starts from, those that earlier ones have kept among them:
//! `cargo +nightly run --release --example seeds FOLDER` fills `FOLDER/TARGET`.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

fn main() -> std::io::Result<()> {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        return Err(std::io::Error::other("expected a folder"));
    };
    for target in lgs_fuzz::targets() {
        let name = target.name.replace('-', "_");
        let to = folder.join(&name);
        fs::create_dir_all(&to)?;
        let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(format!("{name}.zip"));
        let mut archive = zip::ZipArchive::new(File::open(kept)?)?;
        for k in 0..archive.len() {
            std::io::copy(&mut archive.by_index(k)?, &mut File::create(to.join(format!("kept-{k:03}")))?)?;
        }
        for (k, seed) in lgs_fuzz::stage_of(target.name).seeds().iter().enumerate() {
            fs::write(to.join(format!("seed-{k:03}")), seed)?;
        }
    }
    Ok(())
}

//! Times of the network's operations and parts at the sizes of the paper, beside a plain matrix product.
//!
//! `RAYON_NUM_THREADS` sets the number of threads. Rates count a multiplication and an addition as two operations.

#![expect(clippy::unwrap_used, reason = "a load that cannot be made leaves nothing to measure")]

mod convolution;
mod load;
mod models;
mod plain;
mod search;
mod street;

use std::io::Write as _;

fn main() -> std::io::Result<()> {
    lgs_engine::allocator::keep_pages();
    let mut out = std::io::stdout();
    writeln!(out, "Times to look at and to compare on one machine; no absolute time decides anything.")?;
    writeln!(out, "{} threads, {}", rayon::current_num_threads(), instructions())?;
    write!(out, "{}", load::described().map_err(std::io::Error::other)?)?;
    out.flush()?;
    divan::main();
    Ok(())
}

/// The instruction set that run-time detection finds.
fn instructions() -> String {
    let arch = format!("{:?}", pulp::Arch::new());
    arch.split('(').next().unwrap_or_default().to_owned()
}

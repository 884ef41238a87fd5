//! Times of the network's operations and parts at the sizes of the paper, beside a plain matrix product.
//!
//! `RAYON_NUM_THREADS` sets the number of threads. Rates count a multiplication and an addition as two operations.

mod convolution;
mod load;
mod models;
mod plain;
mod street;

use std::io::Write as _;

fn main() -> std::io::Result<()> {
    lgs_engine::allocator::keep_pages();
    let mut out = std::io::stdout();
    writeln!(out, "Times to look at and to compare on one machine; no absolute time decides anything.")?;
    writeln!(out, "{} threads, {:?}", rayon::current_num_threads(), pulp::Arch::new())?;
    out.flush()?;
    divan::main();
    Ok(())
}

//! Evaluation by a protocol: whole drives, cut into snippets, each reconstructed and measured on its held-out frames.
//!
//! Snippets are the items of a job ([`lgs_formats::jobs`]): the figures are the same bytes however often the job was interrupted and in how
//! many parts it ran. Times stand apart from them. Modules stand in the order in which data run through them.

pub mod protocol;

pub mod drives;

pub mod opened;

pub mod figures;

pub mod record;

pub mod times;

pub mod scene_page;

pub mod snippet;

pub mod averages;

pub mod paper;

pub mod findings;

pub mod table;

pub mod csv;

pub mod page;

pub mod log_page;

pub mod output;

pub mod job;

#[cfg(test)]
mod samples;

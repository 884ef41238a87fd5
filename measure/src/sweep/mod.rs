//! The trade of time against accuracy, measured: many configurations of a reconstruction on the same clips and machine.
//!
//! Modules stand in the order in which data run through them; a module uses those above it only.

pub mod setting;

pub mod grid;

pub mod case;

pub mod crop;

pub mod measure;

pub mod budget_run;

pub mod record;

pub mod budget;

pub mod front;

pub mod table;

pub mod csv;

pub mod report;

pub mod presets;

pub mod pages;

pub mod job;

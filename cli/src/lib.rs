//! What every program of the project does around its work: the command line, exit codes, progress, threads, signals. Programs alone use it.

mod message;
pub mod progress;
mod run;
pub mod signals;
pub mod threads;
mod words;

pub use message::SettingOf;
pub use run::{Outcome, Program, run};
pub use words::{WordParser, words};

//! What every program of the project does around its work: the command line, exit codes, progress, threads, signals. Programs alone use it.

mod definition;
mod message;
pub mod progress;
mod run;
pub mod signals;
mod table;
pub mod threads;
mod words;

pub use definition::flags_without_default;
pub use message::SettingOf;
pub use run::{Outcome, Program, run};
pub use table::{FlagRow, FlagTable, TableArgs};
pub use words::{WordParser, words};

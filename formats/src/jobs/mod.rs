//! Jobs of many items in one folder: done one by one, in parts, with failures listed, killed and resumed, merged; the end is the same bytes.
//!
//! An item is whatever a job has many of: a clip, a snippet of a drive. What is kept of it is for the job to say ([`ItemStore`]);
//! [`RecordJob`] keeps a JSON record and files.

mod merge;
mod part;
mod records;
mod run;
mod shares;
#[cfg(test)]
mod tests;

pub use merge::{PartFile, PartManifest, check_parts, is_merged, read_parts, remove_parts};
pub use part::{Part, choose_part, part_file};
pub use records::{Made, RECORDS_FORMAT, RecordJob, RecordManifest};
pub use run::{FailedItem, ItemEvent, ItemStore, Items, Tried, remove_unfinished, try_items};
pub use shares::{SHARES_FILE, Shares};

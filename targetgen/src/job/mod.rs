//! The batch job: clips in, shards out, whatever happens in between.
//!
//! Every clip becomes a shard of its own, `clips/<clip>.safetensors`, as soon as it is done; at the end the clips are packed, in their
//! order, into shards up to the size cap. What is packed depends on the clips alone, never on how often the job was interrupted or in
//! how many parts it ran.

mod clips;
mod merge;
mod pack;
mod retarget;
mod run;
mod store;

pub use clips::{JobClip, find_clips};
pub use merge::merge;
pub use retarget::retarget;
pub use run::{Event, Outcome, TargetJob, run};
pub use store::CLIP_FOLDER;

//! Bytes to validated host structs and back: clips, sweeps, images, splat clouds, targets. No tensors, no threads.

pub mod casts;
pub mod digest;
pub mod error;
pub mod frame_list;
pub mod pose;

pub mod camera;
pub mod camera_motion;
pub mod camera_path;
pub mod clip;
pub mod clip_dir;
mod clip_json;
pub mod cloud;
pub mod exports;
pub mod image;
pub mod importers;
pub mod jobs;
pub mod lidar_motion;
mod numpy;
pub mod ply;
mod read;
pub mod returns;
pub mod sweep;
pub mod targets;
mod unfinished;
pub mod viewer;
pub mod write;

//! Procedural streets: a seeded world, ray-cast cameras and a spinning LiDAR that drive through it, exact depth, velocity,
//! labels and boxes.
//!
//! Everything is drawn from the seed with counter-based generators, elementary functions are libm's, and parallel work
//! writes to its own slots: a configuration gives the same bytes everywhere.

mod check;
pub(crate) mod maths;
pub(crate) mod rng;
mod streams;
mod texture;

pub mod config;
pub mod presets;
pub mod rig;

mod primitive;
mod shapes;

mod bvh;

mod course;
mod footprint;
mod motion;
mod road;

mod surface;

mod car_texture;
mod facade;
mod material;
mod sign_texture;

mod object;

mod buildings;
mod cyclist;
mod furniture;
mod ground;
mod lorry;
mod side_street;
mod trees;
mod vehicles;

mod busy;
mod layout;
mod traffic;

mod sky;

mod world;

mod camera;
mod lidar;

pub mod depth_map;
pub mod export;
mod scene;

pub use camera::Capture;
pub use config::{SceneConfig, Split};
pub use lidar::Scan;
pub use scene::Scene;

#[cfg(test)]
mod tests;
#[cfg(test)]
mod traffic_tests;

//! The network: U-Net, query, policy, heads.

pub mod buffers;
pub mod layers;
pub mod levels;
pub mod unet;
pub mod weights;

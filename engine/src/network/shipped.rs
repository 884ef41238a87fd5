//! The weights that ship inside the programs: `models/tiny.safetensors`, where the repository has it.

/// What a user calls them.
pub const NAME: &str = "tiny";
/// The file in the repository.
pub const FILE: &str = "models/tiny.safetensors";
/// Where a program's weights come from when nobody says.
pub const DEFAULT: &str = if BYTES.is_some() { NAME } else { "none" };

/// The file as it was when the program was built; `None` where there was none.
#[cfg(lgs_shipped_weights)]
pub const BYTES: Option<&[u8]> = Some(include_bytes!("../../../models/tiny.safetensors"));
/// The file as it was when the program was built; `None` where there was none.
#[cfg(not(lgs_shipped_weights))]
pub const BYTES: Option<&[u8]> = None;

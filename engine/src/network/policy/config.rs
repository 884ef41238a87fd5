//! Size of the policy.

use serde::{Deserialize, Serialize};

use crate::ops::serialization::Curve;

/// Widest stage that a config may ask for.
const CHANNELS_MAX: usize = 4096;

/// Sizes and switches of a Point Transformer V3 and its heads.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyConfig {
    /// Encoder stages, finest first.
    pub encoder: Vec<StageConfig>,
    /// Decoder stages, finest first; one fewer than the encoder has.
    pub decoder: Vec<StageConfig>,
    /// Rows that attend to each other.
    pub patch: usize,
    /// Hidden channels of a block's layers per channel.
    pub mlp_ratio: usize,
    /// Curves in the order of their use.
    pub curves: Vec<Curve>,
    /// How blocks take their curves.
    pub cycle: Cycle,
    /// Hidden blocks of a head.
    pub head_blocks: usize,
    /// Channels of a head's hidden blocks.
    pub head_width: usize,
}

/// One stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageConfig {
    /// Channels.
    pub channels: usize,
    /// Attention heads; a divisor of the channels.
    pub heads: usize,
    /// Blocks.
    pub blocks: usize,
}

/// How blocks take their curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cycle {
    /// Every stage starts with the first curve, as the reference does where it does not shuffle.
    Restart,
    /// Every block takes the curve after that of the block before it, so that all curves are in use.
    Continue,
}

/// Which curve each block follows, as an index into [`PolicyConfig::curves`]: by stage, finest first, then by block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CurvePlan {
    pub(super) encoder: Vec<Vec<usize>>,
    pub(super) decoder: Vec<Vec<usize>>,
}

impl PolicyConfig {
    /// Field, what would be right and what is there, when the sizes do not fit each other.
    pub fn fault(&self) -> Option<(&'static str, String, String)> {
        let wrong = |field, expected: &str, found: String| Some((field, expected.to_owned(), found));
        if self.encoder.is_empty() || self.encoder.len() > 8 || self.decoder.len() + 1 != self.encoder.len() {
            let found = format!("{} and {}", self.encoder.len(), self.decoder.len());
            return wrong("policy.encoder and policy.decoder", "1 to 8 stages and one fewer", found);
        }
        for stage in self.encoder.iter().chain(&self.decoder) {
            let StageConfig { channels, heads, .. } = *stage;
            if !(1..=CHANNELS_MAX).contains(&channels) || heads == 0 || !channels.is_multiple_of(heads) {
                return wrong("policy stage", "1 to 4096 channels, heads that divide them", format!("{stage:?}"));
            }
            if stage.blocks > 64 {
                return wrong("policy stage", "at most 64 blocks", format!("{stage:?}"));
            }
        }
        if !(1..=4096).contains(&self.patch) {
            return wrong("policy.patch", "1 to 4096", self.patch.to_string());
        }
        if !(1..=16).contains(&self.mlp_ratio) {
            return wrong("policy.mlp_ratio", "1 to 16", self.mlp_ratio.to_string());
        }
        if self.curves.is_empty() || self.curves.len() > 16 {
            return wrong("policy.curves", "1 to 16 curves", self.curves.len().to_string());
        }
        if self.head_blocks > 64 || !(1..=CHANNELS_MAX).contains(&self.head_width) {
            let found = format!("{} of width {}", self.head_blocks, self.head_width);
            return wrong("policy heads", "at most 64 blocks of width 1 to 4096", found);
        }
        None
    }

    /// Channels of the finest decoder stage: what the heads read.
    pub(super) fn width(&self) -> usize {
        self.decoder.first().or(self.encoder.first()).map_or(0, |stage| stage.channels)
    }

    pub(super) fn curve_plan(&self) -> CurvePlan {
        let mut next = 0;
        let mut of_stage = |stage: &StageConfig| {
            if self.cycle == Cycle::Restart {
                next = 0;
            }
            let indices = (next..next + stage.blocks).map(|i| i % self.curves.len()).collect();
            next += stage.blocks;
            indices
        };
        let encoder = self.encoder.iter().map(&mut of_stage).collect();
        let mut decoder: Vec<Vec<usize>> = self.decoder.iter().rev().map(of_stage).collect();
        decoder.reverse();
        CurvePlan { encoder, decoder }
    }
}

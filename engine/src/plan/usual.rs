//! What runs where no preset and no budget is asked for.

use crate::network::source::ModelSource;
use crate::recipe::Recipe;

/// Options that say who refines, or in how many steps.
pub const REFINER: &[&str] = &["refine-with", "refine-steps"];

/// The recipe that flags change where nobody asks for a preset or a budget; `refiner` is whether one of [`REFINER`] is among them.
///
/// With the weights that ship, two learned steps and four passes of per-scene optimisation in place of the third:
/// `measure/NEEDS.md` has the figures. Of other weights nothing is known, and what a flag
/// asks for comes alone.
pub fn usual(weights: &ModelSource, refiner: bool) -> Recipe {
    match weights {
        ModelSource::Shipped if !refiner => Recipe { refine_steps: 2, adam_passes: 4, ..Recipe::default() },
        _ => Recipe::default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_optimisation_follow_the_weights_that_ship_unless_flags_say_who_refines() {
        let steps = |recipe: Recipe| [recipe.refine_steps, recipe.adam_passes];
        assert_eq!(steps(usual(&ModelSource::Shipped, false)), [2, 4]);
        let others = [(ModelSource::Shipped, true), (ModelSource::None, false), (ModelSource::File("w".into()), false)];
        for (weights, refiner) in others {
            assert_eq!(usual(&weights, refiner), Recipe::default(), "{weights:?}");
        }
        assert!(REFINER.iter().all(|name| crate::recipe::KNOBS.iter().any(|knob| knob.name == *name)));
    }
}

//! Flags of the recipe: one for each option of the engine's table.

use lgs_cli::{FlagRow, FlagTable, TableArgs};
use lgs_engine::recipe::{KNOBS, Knob, Recipe};

/// What of the recipe was asked for.
pub(crate) type RecipeArgs = TableArgs<RecipeFlags>;

/// The engine's table of options.
#[derive(Clone, Debug, Default)]
pub(crate) struct RecipeFlags;

impl FlagTable for RecipeFlags {
    type Target = Recipe;

    fn rows() -> Vec<FlagRow> {
        let row = |&Knob { name, value, help, words, aliases, .. }: &Knob| FlagRow {
            name,
            value,
            help,
            words,
            aliases,
            conflicts_with: None,
        };
        KNOBS.iter().map(row).collect()
    }

    fn set(recipe: &mut Recipe, name: &str, value: &str) -> Result<(), String> {
        recipe.set(name, value)
    }
}

//! The options of a recipe, in one table: what each is called, which values it takes, how these are read, told and recorded.

use std::{num::NonZeroUsize, str::FromStr};

use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::Recipe;
use crate::densify::Density;

/// Most steps of the learned refinement.
const MOST_LEARNED: usize = 1000;
/// Most passes of per-scene optimisation.
const MOST_ADAM: usize = 100_000;
/// Least memory that a GPU may be held to, 10^6 bytes: less does not hold a small view.
const LEAST_MEMORY_MB: usize = 16;

/// One option.
#[derive(Clone, Copy, Debug)]
pub struct Knob {
    /// Its name: that of its flag, without the dashes.
    pub name: &'static str,
    /// The value of the recipe that nobody asked to be otherwise; empty for none.
    pub usual: &'static str,
    /// What stands for its value in help texts.
    pub value: &'static str,
    /// What it is, for help texts, with units; then the default.
    pub help: &'static str,
    /// The words that it takes, with what each means; none for a number.
    pub words: &'static [(&'static str, &'static str)],
    /// Other words that are understood, each with the one that it stands for.
    pub aliases: &'static [(&'static str, &'static str)],
    /// Whether a time budget decides on it.
    pub by_budget: bool,
    /// Changes a recipe to a value, or says what was expected.
    pub set: fn(&mut Recipe, &str) -> Result<(), String>,
    /// The value of a recipe; `None` where it says nothing: without a network, of what is off.
    pub get: fn(&Recipe) -> Option<Value>,
    /// Whether commands name it even where it is as usual.
    pub always: bool,
}

/// All of them, in the order in which they are applied.
pub const KNOBS: [Knob; 15] = [
    Knob {
        name: "background",
        usual: "auto",
        value: "WORD",
        help: "What stands behind the Gaussians of the LiDAR [default: auto]",
        words: &[
            ("auto", "What the clip needs: its own depth maps where it has some, else depth"),
            ("off", "Nothing"),
            ("sky", "A hemisphere far away, above the horizon"),
            ("gaps", "Where the surfaces around a gap continue to: quicker than depth, and worse"),
            ("depth", "Where the images and sweeps agree that it is"),
            ("maps", "Where the clip's depth maps say it is; depth for images without one that fits"),
        ],
        aliases: &[("none", "off")],
        by_budget: true,
        set: |recipe, text| put_word(&mut recipe.background, if text == "none" { "off" } else { text }),
        get: |recipe| Some(json!(recipe.background)),
        always: true,
    },
    Knob {
        name: "coarseness",
        usual: "1",
        value: "F",
        help: "How different, times the usual, the pixels and returns may be that share a Gaussian, and above 1 how many they may be, 0 to 8: \
               more is coarser and quicker; 0: a Gaussian for every return and every pixel between them [default: 1]",
        words: &[],
        aliases: &[],
        by_budget: true,
        set: |recipe, text| put(&mut recipe.coarseness, text),
        get: |recipe| Some(json!(recipe.coarseness)),
        always: false,
    },
    Knob {
        name: "query",
        usual: "on",
        value: "WORD",
        help: "Whether primitives ask their nearest of other timestamps [default: on]",
        words: &[("on", "They do"), ("off", "They do not")],
        aliases: &[],
        by_budget: true,
        set: |recipe, text| {
            recipe.query = text == "on";
            if matches!(text, "on" | "off") { Ok(()) } else { Err(format!("expected on or off, found {text}")) }
        },
        get: |recipe| recipe.network.then(|| json!(recipe.query)),
        always: true,
    },
    Knob {
        name: "density",
        usual: "exact",
        value: "WORD",
        help: "Who prunes and adds Gaussians [default: exact]",
        words: &[
            (
                "exact",
                "What the input views show of each once the scene is refined a little: those go that cost least, measured in rounds",
            ),
            ("policy", "The learned policy, of the LiDAR's"),
            ("random", "Chance, as often as the policy would, of the LiDAR's: the ablation"),
            ("off", "Nobody: the set stays as it is"),
        ],
        aliases: &[],
        by_budget: true,
        set: |recipe, text| {
            put_word(&mut recipe.density, text)?;
            *recipe = recipe.with_density(recipe.density);
            Ok(())
        },
        get: |recipe| recipe.network.then(|| json!(recipe.density)),
        always: true,
    },
    Knob {
        name: "density-scope",
        usual: "all",
        value: "WORD",
        help: "Which Gaussians exact pruning may take, and the limit counts [default: all]",
        words: &[("all", "Those of the LiDAR and those behind them"), ("lidar", "Those of the LiDAR")],
        aliases: &[],
        by_budget: true,
        set: |recipe, text| put_word(&mut recipe.density_scope, text),
        get: |recipe| recipe.network.then(|| json!(recipe.density_scope)),
        always: false,
    },
    Knob {
        name: "theta-prune",
        usual: "0.7",
        value: "F",
        help: "Score above which a primitive is pruned, 0 to 1 [default: 0.7]",
        words: &[],
        aliases: &[],
        by_budget: false,
        set: |recipe, text| put_score(&mut recipe.thresholds.prune, text),
        get: |recipe| recipe.network.then(|| score(recipe.thresholds.prune)),
        always: false,
    },
    Knob {
        name: "theta-add",
        usual: "0.7",
        value: "F",
        help: "Score above which a primitive gets a copy beside it, 0 to 1 [default: 0.7]",
        words: &[],
        aliases: &[],
        by_budget: false,
        set: |recipe, text| put_score(&mut recipe.thresholds.add, text),
        get: |recipe| recipe.network.then(|| score(recipe.thresholds.add)),
        always: false,
    },
    Knob {
        name: "max-gaussians",
        usual: "70%",
        value: "N|P%|none",
        help: "Largest number of Gaussians after pruning and adding, such as 50000, or share of those before, such as 70%: of the whole scene \
               with exact effects, of the LiDAR's with a policy; none: as the effects or scores ask for [default: 70% with exact effects, \
               else none]",
        words: &[],
        aliases: &[],
        by_budget: false,
        set: |recipe, text| {
            recipe.max_gaussians = if text == "none" { None } else { Some(text.parse()?) };
            Ok(())
        },
        get: |recipe| match recipe.max_gaussians {
            _ if !recipe.network => None,
            Some(limit) => Some(json!(limit)),
            None => (recipe.density == Density::Exact).then(|| json!("none")),
        },
        always: true,
    },
    Knob {
        name: "refine-with",
        usual: "learned",
        value: "learned|adam:N",
        help: "Who refines: learned: the network, where there is one; adam:N: N passes of per-scene optimisation over the input views, with a step after each view, 0 to 100000, \
               with a network or without; learned steps before them only where they are asked for [default: adam:4 behind two learned steps with \
               the weights that ship, else learned]",
        words: &[],
        aliases: &[],
        by_budget: true,
        set: |recipe, text| match text.split_once(':') {
            None if text == "learned" => {
                recipe.adam_passes = 0;
                Ok(())
            }
            Some(("adam", count)) => {
                recipe.refine_steps = 0;
                put_count(&mut recipe.adam_passes, count, [0, MOST_ADAM])
            }
            _ => Err(format!("expected learned or adam:N, found {text}")),
        },
        get: |recipe| match recipe.adam_passes {
            0 => recipe.network.then(|| json!("learned")),
            passes => Some(json!(format!("adam:{passes}"))),
        },
        always: false,
    },
    Knob {
        name: "refine-steps",
        usual: "3",
        value: "N",
        help: "Steps of the learned refinement over the input views, 0 to 1000 [default: 3; 0 where adam:N refines; 2 where nobody says who refines, with the \
               weights that ship]",
        words: &[],
        aliases: &[],
        by_budget: true,
        set: |recipe, text| put_count(&mut recipe.refine_steps, text, [0, MOST_LEARNED]),
        get: |recipe| recipe.network.then(|| json!(recipe.refine_steps)),
        always: true,
    },
    Knob {
        name: "line-search",
        usual: "auto",
        value: "WORD",
        help: "Learned steps after which every Gaussian's length of the step is searched for, which draws each input view once more \
               [default: auto]",
        words: &[
            ("auto", "As the model's config asks (step_length): every, or off"),
            ("every", "Every one"),
            ("last", "The last alone: quicker, and worth it where adam:N follows"),
            ("off", "None: a step is as long as the network says"),
        ],
        aliases: &[],
        by_budget: true,
        set: |recipe, text| put_word(&mut recipe.line_search, text),
        get: |recipe| (recipe.network && recipe.refine_steps > 0).then(|| json!(recipe.line_search)),
        always: false,
    },
    Knob {
        name: "refine-views",
        usual: "",
        value: "N",
        help: "Most input views that a step of a refinement looks at, in random turns [default: all for a learned step, 1 for one of adam:N]",
        words: &[],
        aliases: &[],
        by_budget: true,
        set: |recipe, text| {
            let mut count = 0;
            put_count(&mut count, text, [1, usize::MAX])?;
            recipe.refine_views = NonZeroUsize::new(count);
            Ok(())
        },
        get: |recipe| recipe.refine_views.filter(|_| recipe.refines()).map(|count| json!(count)),
        always: false,
    },
    Knob {
        name: "pixel-stride",
        usual: "auto",
        value: "auto|N",
        help: "Steps of a refinement draw every Nth pixel of every Nth row, 1 to 64, in turns, and every fourth pass of adam:N all of them: quicker, \
               and hardly worse where images are fine; auto: 2 where the pixels in between follow from those that are drawn, to 30 dB, else 1 \
               [default: auto]",
        words: &[],
        aliases: &[],
        by_budget: true,
        set: |recipe, text| put(&mut recipe.pixel_stride, text),
        get: |recipe| recipe.draws_inputs().then(|| json!(recipe.pixel_stride)),
        always: false,
    },
    Knob {
        name: "device",
        usual: "auto",
        value: "auto|cpu|gpu[:N]",
        help: "Where views are drawn, in a refinement and at the end: auto: on a real GPU where there is one, else by the processor; cpu: by the \
               processor; gpu: on the first GPU, gpu:N: on that of number N [default: auto]",
        words: &[],
        aliases: &[],
        by_budget: false,
        set: |recipe, text| put(&mut recipe.device, text),
        get: |recipe| Some(json!(recipe.device)),
        always: false,
    },
    Knob {
        name: "device-memory",
        usual: "",
        value: "MB",
        help: "Memory that a GPU may take, 10^6 bytes, 16 or more: what does not fit is drawn by the processor [default: what the driver gives]",
        words: &[],
        aliases: &[],
        by_budget: false,
        set: |recipe, text| {
            let mut count = 0;
            put_count(&mut count, text, [LEAST_MEMORY_MB, usize::MAX])?;
            recipe.device_memory = NonZeroUsize::new(count);
            Ok(())
        },
        get: |recipe| recipe.device_memory.map(|count| json!(count)),
        always: false,
    },
];

impl Knob {
    /// Its key in JSON.
    pub fn key(&self) -> String {
        self.name.replace('-', "_")
    }

    /// The value that asks for what a recipe has; `None` where it says nothing, or what is usual anyway.
    pub(super) fn option(&self, recipe: &Recipe) -> Option<String> {
        let value = text(&(self.get)(recipe)?);
        (self.always || value != self.usual).then_some(value)
    }
}

/// A value as flags have it.
fn text(value: &Value) -> String {
    match value {
        Value::Bool(on) => if *on { "on" } else { "off" }.to_owned(),
        Value::String(word) => word.clone(),
        Value::Number(number) => match (number.as_u64(), number.as_f64()) {
            (Some(count), _) => count.to_string(),
            (None, float) => float.unwrap_or(f64::NAN).to_string(),
        },
        other => other.to_string(),
    }
}

/// A number of few digits, as people wrote it.
fn score(value: f32) -> Value {
    json!(value.to_string().parse::<f64>().unwrap_or(f64::from(value)))
}

fn put<T: FromStr<Err = String>>(place: &mut T, text: &str) -> Result<(), String> {
    *place = text.parse()?;
    Ok(())
}

fn put_word<T: DeserializeOwned>(place: &mut T, text: &str) -> Result<(), String> {
    *place = serde_json::from_value(json!(text)).map_err(|error| error.to_string())?;
    Ok(())
}

fn put_count(place: &mut usize, text: &str, [least, most]: [usize; 2]) -> Result<(), String> {
    let count = text.parse().ok().filter(|count| (least..=most).contains(count));
    *place = count.ok_or_else(|| match most {
        usize::MAX => format!("expected a number from {least} on, found {text}"),
        _ => format!("expected a number from {least} to {most}, found {text}"),
    })?;
    Ok(())
}

fn put_score(place: &mut f32, text: &str) -> Result<(), String> {
    let score = text.parse().ok().filter(|score: &f32| (0.0..=1.0).contains(score));
    *place = score.ok_or_else(|| format!("expected a score from 0 to 1, found {text}"))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_of_a_recipe_makes_it_again() {
        let usual = Recipe::default();
        for knob in &KNOBS {
            let told = (knob.get)(&usual).map_or(String::new(), |value| text(&value));
            assert_eq!(told, knob.usual, "{}", knob.name);
            let mut again = usual;
            assert!(knob.usual.is_empty() || (knob.set)(&mut again, knob.usual).is_ok(), "{}", knob.name);
            assert!(knob.help.contains("[default: "), "{}", knob.name);
            for (word, _) in knob.words {
                let mut other = usual;
                (knob.set)(&mut other, word).unwrap();
                assert_eq!((knob.get)(&other).map(|value| text(&value)).as_deref(), Some(*word));
            }
            assert!((knob.set)(&mut again, "no such value").is_err(), "{}", knob.name);
        }
        let mut other = usual;
        let values = [
            ("background", "none"),
            ("coarseness", "1.5"),
            ("query", "off"),
            ("density", "policy"),
            ("theta-prune", "0.9"),
            ("theta-add", "0.55"),
            ("max-gaussians", "60%"),
            ("refine-with", "adam:12"),
            ("refine-steps", "2"),
            ("line-search", "last"),
            ("refine-views", "4"),
            ("pixel-stride", "2"),
            ("device", "gpu:1"),
            ("device-memory", "4000"),
        ];
        for (name, value) in values {
            other.set(name, value).unwrap();
        }
        let mut again = usual;
        for (name, value) in other.options() {
            again.set(name, &value).unwrap();
        }
        assert_eq!(again, other);
        assert!(again.set("colour", "red").is_err_and(|said| said.contains("found colour")));
        let free = Recipe { max_gaussians: None, ..usual };
        let (name, value) = free.options().into_iter().find(|(name, _)| *name == "max-gaussians").unwrap();
        assert_eq!((name, value.as_str()), ("max-gaussians", "none"));
    }
}

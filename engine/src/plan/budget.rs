//! The best recipe for the time that there is.

use std::time::Duration;

use super::{ClipWork, MeasuredRecipe, Record};
use crate::recipe::Recipe;

/// A machine that is slower by less than this factor, or quicker, is taken for the one that measured: a short stage says no more, and its
/// time on another clip is foreseen no better. What turns out quicker leaves time for more steps.
const SAME_SPEED: f64 = 1.33;

/// What is known when a recipe is chosen: the clip's initial Gaussians are made.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// How much there is to do.
    pub work: ClipWork,
    /// Time that is left for what comes after the initial Gaussians.
    pub left: Duration,
    /// Seconds that they took.
    pub begin_s: f64,
    /// Whether there is a network.
    pub network: bool,
}

/// A recipe that was chosen for a budget.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Chosen {
    /// The recipe.
    pub recipe: Recipe,
    /// Passes of per-scene optimisation up to which it pays to go on while there is time.
    pub most_adam_passes: usize,
    /// Seconds that the recipe will probably take from here on.
    pub expected_s: f64,
    /// Seconds that one of its passes of per-scene optimisation will probably take; 0 where nothing recorded tells.
    pub adam_pass_s: f64,
    /// Whether that fits: otherwise it is the quickest of all.
    pub fits: bool,
    /// Decibels that it probably gives up against the best recipe.
    pub gives_up_db: f64,
    /// Seconds that the best recipe would probably take from here on.
    pub best_s: f64,
    /// How many times slower than the machine that measured this one is.
    pub slower: f64,
}

/// The recipe of `record` that is probably best among those that fit, with numbers of passes of per-scene optimisation between recorded
/// ones too; the quickest where none does; `None` where there is no recipe for what there is.
pub fn choose(record: &Record, budget: &Budget) -> Option<Chosen> {
    let Budget { work, left, begin_s, network } = *budget;
    let begin = record.begin_s(&work);
    let ratio = if begin > 0.0 { begin_s / begin } else { 1.0 };
    let slower = if ratio > SAME_SPEED { ratio } else { 1.0 };
    let offer = |row: &MeasuredRecipe| Offer {
        recipe: row.recipe,
        seconds: ((record.seconds(row, &work) - begin) * slower).max(0.0),
        behind: record.behind(row, &work),
    };
    let mut offers: Vec<Offer> =
        record.recipes.iter().filter(|row| network || !row.recipe.network).map(offer).collect();
    // Of equally good ones the quicker.
    offers.sort_by(|a, b| a.behind.total_cmp(&b.behind).then(a.seconds.total_cmp(&b.seconds)));
    let best = *offers.first()?;
    let left = left.as_secs_f64();
    // What takes no time to speak of does not fit either when the time is over.
    let fits = |offer: &Offer| left > 0.0 && offer.seconds <= left;
    let between = offers.iter().filter(|offer| fits(offer)).filter_map(|offer| offer.prolonged(&offers, left));
    let fitting = offers.iter().copied().filter(fits).chain(between);
    let fitting = fitting.min_by(|a, b| a.behind.total_cmp(&b.behind).then(a.seconds.total_cmp(&b.seconds)));
    let chosen = fitting.or_else(|| offers.iter().copied().min_by(|a, b| a.seconds.total_cmp(&b.seconds)))?;
    let better = offers.iter().filter(|offer| fitting.is_some() && offer.is_longer_and_better(&chosen));
    let most = better.map(|offer| offer.recipe.adam_passes).max();
    Some(Chosen {
        recipe: chosen.recipe,
        most_adam_passes: most.unwrap_or(chosen.recipe.adam_passes),
        expected_s: chosen.seconds,
        adam_pass_s: chosen.adam_pass_s(&offers),
        fits: fitting.is_some(),
        gives_up_db: chosen.behind - best.behind,
        best_s: best.seconds,
        slower,
    })
}

#[derive(Clone, Copy)]
struct Offer {
    recipe: Recipe,
    seconds: f64,
    behind: f64,
}

impl Offer {
    /// By the nearest of `offers` that differ only in the number of these steps.
    fn adam_pass_s(&self, offers: &[Self]) -> f64 {
        let adam_passes = self.recipe.adam_passes;
        let away = |other: &&Self| other.recipe.adam_passes.abs_diff(adam_passes);
        let alike =
            offers.iter().filter(|other| Recipe { adam_passes, ..other.recipe } == self.recipe && away(other) > 0);
        let nearest = alike.min_by_key(away);
        nearest.map_or(0.0, |other| (other.seconds - self.seconds).abs() / away(&other) as f64)
    }

    fn is_longer_and_better(&self, other: &Self) -> bool {
        let adam_passes = other.recipe.adam_passes;
        let alike = Recipe { adam_passes, ..self.recipe } == other.recipe;
        alike && self.recipe.adam_passes > adam_passes && self.behind < other.behind
    }

    /// It with as many more passes of per-scene optimisation as fit into `left`, on the line to the next of `offers` that has more and is
    /// better; `None` where there is none, or the next one fits, or nothing that helps does.
    fn prolonged(&self, offers: &[Self], left: f64) -> Option<Self> {
        let longer = offers.iter().filter(|offer| offer.is_longer_and_better(self));
        let next = longer.min_by_key(|offer| offer.recipe.adam_passes)?;
        let steps = next.recipe.adam_passes - self.recipe.adam_passes;
        let step_s = (next.seconds - self.seconds) / steps as f64;
        let more = (1..steps).take_while(|&more| self.seconds + step_s * more as f64 <= left).last()?;
        let share = more as f64 / steps as f64;
        (next.seconds > left).then(|| Self {
            recipe: Recipe { adam_passes: self.recipe.adam_passes + more, ..self.recipe },
            seconds: self.seconds + share * (next.seconds - self.seconds),
            behind: self.behind + share * (next.behind - self.behind),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{PRESETS_FORMAT, RecordedClip};

    fn record() -> Record {
        let clip = |name: &str, points, pixels, begin_s| RecordedClip {
            name: name.to_owned(),
            work: ClipWork { points, pixels, views: 4 },
            begin_s,
        };
        let row = |refine_steps, network, psnr: [f64; 2], seconds: [f64; 2]| MeasuredRecipe {
            recipe: Recipe { refine_steps, network, ..Recipe::default() },
            psnr: psnr.to_vec(),
            seconds: seconds.to_vec(),
        };
        Record {
            format: PRESETS_FORMAT.to_owned(),
            weights: String::new(),
            machine: String::new(),
            presets: Vec::new(),
            clips: vec![clip("small", 10_000, 1_000_000, 0.1), clip("large", 100_000, 10_000_000, 1.0)],
            recipes: vec![
                row(0, false, [20.0, 21.0], [0.2, 2.0]),
                row(1, true, [22.0, 23.0], [0.4, 4.0]),
                row(3, true, [24.0, 23.5], [1.0, 10.0]),
            ],
        }
    }

    fn budget(seconds: f64) -> Budget {
        let work = ClipWork { points: 10_000, pixels: 1_000_000, views: 4 };
        Budget { work, left: Duration::from_secs_f64(seconds), begin_s: 0.1, network: true }
    }

    #[test]
    fn the_best_that_fits_is_taken_and_what_it_gives_up_is_said() {
        let chosen = choose(&record(), &budget(0.5)).unwrap();
        assert_eq!((chosen.recipe.refine_steps, chosen.fits, chosen.slower), (1, true, 1.0));
        assert!((chosen.gives_up_db - 2.0).abs() < 0.01 && (chosen.best_s - 0.9).abs() < 0.02, "{chosen:?}");
        let all = choose(&record(), &budget(100.0)).unwrap();
        assert_eq!((all.recipe.refine_steps, all.gives_up_db), (3, 0.0));
    }

    #[test]
    fn where_nothing_fits_the_quickest_runs() {
        let chosen = choose(&record(), &budget(0.01)).unwrap();
        assert_eq!((chosen.recipe.refine_steps, chosen.fits), (0, false));
        assert!(choose(&Record { recipes: Vec::new(), ..record() }, &budget(1.0)).is_none());
    }

    #[test]
    fn time_between_two_recorded_numbers_of_steps_is_used() {
        let mut record = record();
        let adam = Recipe { refine_steps: 1, adam_passes: 10, ..Recipe::default() };
        record.recipes.push(MeasuredRecipe { recipe: adam, psnr: vec![28.0, 28.0], seconds: vec![2.4, 24.0] });
        let choice = |seconds| choose(&record, &budget(seconds)).unwrap();
        // 0.3 s for the first step, 0.2 s for each of the others.
        let chosen = choice(1.31);
        assert_eq!((chosen.recipe.refine_steps, chosen.recipe.adam_passes, chosen.most_adam_passes), (1, 5, 10));
        assert!((chosen.expected_s - 1.3).abs() < 0.01 && (chosen.gives_up_db - 3.0).abs() < 0.01, "{chosen:?}");
        assert!((chosen.adam_pass_s - 0.2).abs() < 0.01 && choice(0.55).adam_pass_s > 0.19, "{chosen:?}");
        // What was recorded is better where it fits, and nothing lies beyond the last.
        assert_eq!((choice(1.0).recipe.refine_steps, choice(1.0).most_adam_passes), (3, 0));
        assert_eq!((choice(9.0).recipe.adam_passes, choice(9.0).most_adam_passes), (10, 10));
        assert_eq!((choice(0.45).recipe.adam_passes, choice(0.55).recipe.adam_passes), (0, 1));
        assert_eq!((choice(0.01).fits, choice(0.01).most_adam_passes), (false, 0));
    }

    #[test]
    fn a_slower_machine_and_no_network_count() {
        let slow = choose(&record(), &Budget { begin_s: 0.3, ..budget(0.5) }).unwrap();
        assert_eq!((slow.recipe.refine_steps, slow.fits), (0, true));
        assert!((slow.slower - 3.0).abs() < 0.1 && (slow.expected_s - 0.3).abs() < 0.02, "{slow:?}");
        let without = choose(&record(), &Budget { network: false, ..budget(100.0) }).unwrap();
        assert!(!without.recipe.network);
    }
}

//! The best recipe for the time that there is.

use std::time::Duration;

use super::{ClipWork, Measured, Recipe, Record};

/// Speeds that differ by less than this factor are taken for those of the machine that measured: a short stage says no more.
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
    /// Seconds that it will probably take from here on.
    pub expected_s: f64,
    /// Whether that fits: otherwise it is the quickest of all.
    pub fits: bool,
    /// Decibels that it probably gives up against the best recipe.
    pub gives_up_db: f64,
    /// Seconds that the best recipe would probably take from here on.
    pub best_s: f64,
    /// How many times slower than the machine that measured this one is.
    pub slower: f64,
}

/// The recipe of `record` that is probably best among those that fit; the quickest where none does; `None` where there is no recipe for
/// what there is.
pub fn choose(record: &Record, budget: &Budget) -> Option<Chosen> {
    let Budget { work, left, begin_s, network } = *budget;
    let begin = record.begin_s(&work);
    let ratio = if begin > 0.0 { begin_s / begin } else { 1.0 };
    let slower = if (SAME_SPEED.recip()..=SAME_SPEED).contains(&ratio) { 1.0 } else { ratio };
    let mut offers: Vec<Offer<'_>> = record
        .recipes
        .iter()
        .filter(|row| network || !row.recipe.network)
        .map(|row| Offer {
            row,
            seconds: ((record.seconds(row, &work) - begin) * slower).max(0.0),
            behind: record.behind(row, &work),
        })
        .collect();
    // Of equally good ones the quicker.
    offers.sort_by(|a, b| a.behind.total_cmp(&b.behind).then(a.seconds.total_cmp(&b.seconds)));
    let best = offers.first()?;
    // What takes no time to speak of does not fit either when the time is over.
    let fits = |offer: &&Offer<'_>| !left.is_zero() && offer.seconds <= left.as_secs_f64();
    let fitting = offers.iter().find(fits);
    let chosen = fitting.or_else(|| offers.iter().min_by(|a, b| a.seconds.total_cmp(&b.seconds)))?;
    Some(Chosen {
        recipe: chosen.row.recipe,
        expected_s: chosen.seconds,
        fits: fitting.is_some(),
        gives_up_db: chosen.behind - best.behind,
        best_s: best.seconds,
        slower,
    })
}

struct Offer<'a> {
    row: &'a Measured,
    seconds: f64,
    behind: f64,
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
        let row = |refine_steps, network, psnr: [f64; 2], seconds: [f64; 2]| Measured {
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
    fn a_slower_machine_and_no_network_count() {
        let slow = choose(&record(), &Budget { begin_s: 0.3, ..budget(0.5) }).unwrap();
        assert_eq!((slow.recipe.refine_steps, slow.fits), (0, true));
        assert!((slow.slower - 3.0).abs() < 0.1 && (slow.expected_s - 0.3).abs() < 0.02, "{slow:?}");
        let without = choose(&record(), &Budget { network: false, ..budget(100.0) }).unwrap();
        assert!(!without.recipe.network);
    }
}

//! Which configurations are worth their time.

/// What something costs and what one gets for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offer {
    /// Less is better.
    pub cost: f64,
    /// More is better.
    pub quality: f64,
}

impl Offer {
    /// Whether it is nowhere worse than another, and better in something.
    fn beats(self, other: Self) -> bool {
        let nowhere_worse = self.cost <= other.cost && self.quality >= other.quality;
        nowhere_worse && (self.cost < other.cost || self.quality > other.quality)
    }
}

/// Whether each offer is on the front: there is no other that costs no more, is no worse, and is better in one of the two. What is not
/// known, or not a number, is not on it.
pub fn on_front(offers: &[Option<Offer>]) -> Vec<bool> {
    let known = |offer: &Offer| !offer.cost.is_nan() && !offer.quality.is_nan();
    let all: Vec<Offer> = offers.iter().flatten().copied().filter(known).collect();
    let is_on = |offer: Offer| !all.iter().any(|other| other.beats(offer));
    offers.iter().map(|offer| offer.filter(known).is_some_and(is_on)).collect()
}

/// The cost at which a curve of offers, in the order of their cost, first comes to a quality, in between linearly; `None` when it does
/// not.
pub fn cost_of(curve: &[Offer], quality: f64) -> Option<f64> {
    let first = curve.first()?;
    if first.quality >= quality {
        return Some(first.cost);
    }
    let (before, after) =
        curve.windows(2).map(|pair| (pair[0], pair[1])).find(|(_, after)| after.quality >= quality)?;
    let share = (quality - before.quality) / (after.quality - before.quality);
    Some(before.cost + share * (after.cost - before.cost))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offers(all: &[[f64; 2]]) -> Vec<Option<Offer>> {
        all.iter().map(|&[cost, quality]| Some(Offer { cost, quality })).collect()
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let all = offers(&[[1.0, 10.0], [2.0, 9.0], [2.0, 12.0], [3.0, 12.0], [4.0, 15.0], [4.0, 15.0], [5.0, 15.0]]);
        assert_eq!(on_front(&all), [true, false, true, false, true, true, false]);
    }

    #[test]
    fn the_front_does_not_depend_on_the_order() {
        let mut all = offers(&[[1.0, 10.0], [2.0, 9.0], [2.0, 12.0], [0.5, 8.0]]);
        let mut found = on_front(&all);
        all.reverse();
        found.reverse();
        assert_eq!(on_front(&all), found);
    }

    #[test]
    fn what_is_not_known_is_not_on_it_and_beats_nothing() {
        let mut all = offers(&[[f64::NAN, 99.0], [1.0, f64::NAN], [1.0, 1.0]]);
        all.push(None);
        assert_eq!(on_front(&all), [false, false, true, false]);
    }

    #[test]
    fn a_curve_is_followed_to_where_it_comes_to_a_quality() {
        let curve: Vec<Offer> =
            offers(&[[1.0, 10.0], [3.0, 20.0], [5.0, 15.0], [9.0, 30.0]]).into_iter().flatten().collect();
        assert_eq!(cost_of(&curve, 5.0), Some(1.0));
        assert_eq!(cost_of(&curve, 15.0), Some(2.0));
        assert_eq!(cost_of(&curve, 22.5), Some(7.0));
        assert_eq!(cost_of(&curve, 31.0), None);
        assert_eq!(cost_of(&[], 1.0), None);
    }
}

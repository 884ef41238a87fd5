//! Which colours are sky in a view.

/// Colour cells per channel.
const CELLS: usize = 8;
/// Fewest sky pixels that say anything.
const MIN_PIXELS: usize = 50;
/// Share of pixels below which a colour counts as unseen.
const RARE: f32 = 1e-4;

/// The probability of being sky for every colour, from pixels that surely are and pixels that surely are not.
#[derive(Clone, Debug)]
pub(super) struct SkyColours {
    /// `[CELLS, CELLS, CELLS]` in 0..=1.
    probability: Vec<f32>,
}

impl SkyColours {
    /// The colours of `sky` pixels against those of `solid` ones, which returns fall on; nothing is sky when there are too
    /// few sky pixels.
    ///
    /// # Formula
    /// `p = s / (s + o + 1e-4)`, s and o the smoothed shares of the pixels of either kind that have the colour.
    pub(super) fn new(sky: &[[u8; 3]], solid: &[[u8; 3]]) -> Self {
        if sky.len() < MIN_PIXELS {
            return Self { probability: vec![0.0; CELLS * CELLS * CELLS] };
        }
        let pairs = shares(sky).into_iter().zip(shares(solid));
        Self { probability: pairs.map(|(s, o)| s / (s + o + RARE)).collect() }
    }

    /// The probability that a pixel of this colour is sky.
    pub(super) fn probability(&self, colour: [u8; 3]) -> f32 {
        self.probability[cell(colour)]
    }
}

fn cell(colour: [u8; 3]) -> usize {
    colour.iter().fold(0, |index, &value| index * CELLS + usize::from(value) * CELLS / 256)
}

/// The share of pixels of every colour, each spread over the neighbouring colours.
fn shares(colours: &[[u8; 3]]) -> Vec<f32> {
    let mut counts = vec![0.0; CELLS * CELLS * CELLS];
    for &colour in colours {
        counts[cell(colour)] += 1.0;
    }
    let scale = 1.0 / colours.len().max(1) as f32;
    let axes = [CELLS * CELLS, CELLS, 1];
    let grey = axes.iter().sum::<usize>();
    let spread = |i: usize| {
        let places = axes.map(|axis| i / axis % CELLS);
        let can = |up: bool, place: usize| if up { place + 1 < CELLS } else { place > 0 };
        let value = |up: bool, offset: usize| counts[if up { i + offset } else { i - offset }];
        let mut sum = 2.0 * counts[i];
        for up in [true, false] {
            let inside = axes.into_iter().zip(places).filter(|&(_, place)| can(up, place));
            sum += inside.map(|(axis, _)| 0.5 * value(up, axis)).sum::<f32>();
            if places.iter().all(|&place| can(up, place)) {
                sum += value(up, grey);
            }
        }
        sum * scale
    };
    (0..counts.len()).map(spread).collect()
}

#[cfg(test)]
mod tests {
    use super::SkyColours;

    #[test]
    fn bright_is_sky_where_bright_pixels_are_and_solid_things_are_dark() {
        let colours = SkyColours::new(&[[250, 250, 255]; 80], &[[40, 60, 30]; 80]);
        assert!(colours.probability([240, 245, 250]) > 0.9);
        assert!(colours.probability([45, 50, 35]) < 0.1);
        assert!(colours.probability([150, 20, 150]) < 0.5, "never seen");
    }

    #[test]
    fn a_white_wall_leaves_white_undecided() {
        let colours = SkyColours::new(&[[250; 3]; 80], &[[250; 3]; 80]);
        assert!((0.4..0.6).contains(&colours.probability([250; 3])));
    }

    #[test]
    fn a_handful_of_pixels_says_nothing() {
        assert_eq!(SkyColours::new(&[[250; 3]; 9], &[]).probability([250; 3]), 0.0);
    }
}

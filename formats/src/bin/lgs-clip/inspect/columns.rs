//! Sweeps whose files have rows of another number of values than four.
//!
//! Read as four columns, rows of 3, 5 or 7 values put all their values into every column by turns, so that the columns have one
//! distribution; rows of 6 put them into every second one. Places and intensities of real rows never do: heights are not widths.

/// Fewest returns from which distributions are known well enough.
const MIN_RETURNS: usize = 500;
/// Largest distance of the distributions of two columns that are the same.
const SAME: f64 = 0.06;
/// Numbers of values in a row that are tried.
const WIDTHS: [usize; 4] = [3, 5, 6, 7];
/// Most values of a sweep that are looked at.
const MAX_VALUES: usize = 200_000;

/// The number of values in each row of the file that a sweep was read from, where it is plain that these are not four.
pub(super) fn row_width(points: &[[f32; 3]], intensities: &[f32]) -> Option<usize> {
    if points.len() < MIN_RETURNS {
        return None;
    }
    let values: Vec<f32> =
        points.iter().zip(intensities).flat_map(|([x, y, z], &i)| [*x, *y, *z, i]).take(MAX_VALUES).collect();
    let of_four = columns(&values, 4);
    if distance(&of_four[0], &of_four[2]) > SAME || distance(&of_four[1], &of_four[3]) > SAME {
        return None;
    }
    // Rows are told right by how much their columns differ.
    let apart = |width: usize| {
        let columns = columns(&values, width);
        let pairs = (0..3).flat_map(|a| (a + 1..width.min(4)).map(move |b| (a, b)));
        pairs.map(|(a, b)| distance(&columns[a], &columns[b])).sum::<f64>() / if width == 3 { 3.0 } else { 6.0 }
    };
    let best = WIDTHS.into_iter().map(|width| (width, apart(width))).max_by(|a, b| a.1.total_cmp(&b.1));
    let width = best.filter(|(_, apart)| *apart > 2.0 * SAME).map(|(width, _)| width)?;
    // Halves of rows of six may differ as much as rows of three do; but then they differ from one another, too.
    let of_six = columns(&values, 6);
    let halves_differ = (0..3).any(|column| distance(&of_six[column], &of_six[column + 3]) > SAME);
    Some(if width == 3 && halves_differ { 6 } else { width })
}

/// What to say of the widths of a clip's sweeps.
pub(super) fn warning(widths: &[Option<usize>]) -> Option<String> {
    let (frame, width) = widths.iter().enumerate().find_map(|(frame, width)| Some((frame, (*width)?)))?;
    let count = widths.iter().flatten().count();
    Some(format!(
        "{count} of {} sweeps, the first of frame {frame}: rows of {width} values read as 4 (x, y, z, intensity)?",
        widths.len()
    ))
}

/// `[width]` the values of each column, sorted.
fn columns(values: &[f32], width: usize) -> Vec<Vec<f32>> {
    let mut columns: Vec<Vec<f32>> =
        (0..width).map(|column| values.iter().skip(column).step_by(width).copied().collect()).collect();
    columns.iter_mut().for_each(|column| column.sort_by(f32::total_cmp));
    columns
}

/// The largest difference of two cumulated distributions of sorted values (Kolmogorov and Smirnov), 0 to 1.
#[expect(clippy::cast_precision_loss, reason = "counts of returns are below 2^53")]
fn distance(a: &[f32], b: &[f32]) -> f64 {
    let (mut i, mut j, mut largest) = (0, 0, 0.0_f64);
    while i < a.len() && j < b.len() {
        let value = a[i].min(b[j]);
        while i < a.len() && a[i] <= value {
            i += 1;
        }
        while j < b.len() && b[j] <= value {
            j += 1;
        }
        largest = largest.max((i as f64 / a.len() as f64 - j as f64 / b.len() as f64).abs());
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of a ring after the other on flat ground and a wall, `width` values each, read as four.
    #[expect(clippy::cast_possible_truncation, reason = "metres of a made sweep")]
    fn read_as_four(width: usize) -> Option<usize> {
        let row = |k: u32| {
            let (angle, ring) = (f64::from(k) * 0.007, k / 900);
            let range = (4.0 + 3.0 * f64::from(ring)).min(30.0 + 5.0 * angle.sin());
            let row = [
                range * angle.cos(),
                range * angle.sin(),
                -1.7 + 0.1 * range.max(24.0) - 2.4,
                0.3 + 0.2 * (angle * 9.0).sin(),
            ];
            let more = [f64::from(ring), f64::from(k) * 1e-6, 7.0];
            row.into_iter().chain(more).take(width).map(|v| v as f32).collect::<Vec<_>>()
        };
        let values: Vec<f32> = (0..9000).flat_map(row).collect();
        let rows = values.as_chunks::<4>().0;
        let points: Vec<[f32; 3]> = rows.iter().map(|r| [r[0], r[1], r[2]]).collect();
        row_width(&points, &rows.iter().map(|r| r[3]).collect::<Vec<_>>())
    }

    #[test]
    fn rows_of_other_widths_are_told() {
        assert_eq!([3, 4, 5, 6].map(read_as_four), [Some(3), None, Some(5), Some(6)]);
        assert_eq!(row_width(&[], &[]), None);
    }

    #[test]
    fn equal_values_are_at_no_distance() {
        assert_eq!(distance(&[1.0, 1.0, 2.0], &[1.0, 1.0, 2.0]), 0.0);
        assert_eq!(distance(&[1.0, 2.0], &[3.0, 4.0]), 1.0);
    }
}

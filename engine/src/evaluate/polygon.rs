//! Convex polygons in an image.

/// Convex hull of some finite points, counter-clockwise in a frame with y up; fewer than three when the points are in one
/// place or on one line.
pub(super) fn convex_hull(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    sorted.dedup();
    let mut hull = half_hull(sorted.iter().copied());
    hull.extend(half_hull(sorted.iter().rev().copied()));
    hull
}

/// One half of the hull of points in order, without its last point, which begins the other half.
fn half_hull(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut half: Vec<[f64; 2]> = Vec::new();
    for p in points {
        while let [.., a, b] = half[..]
            && (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) <= 0.0
        {
            half.pop();
        }
        half.push(p);
    }
    half.pop();
    half
}

/// Marks the pixels whose centre lies in a convex polygon.
///
/// # Shapes
/// `hull` in pixels, a pixel's centre at +0.5; `mask` `[H, W]`.
pub(super) fn mark_convex(hull: &[[f64; 2]], width: usize, mask: &mut [bool]) {
    let top = hull.iter().fold(f64::INFINITY, |m, p| m.min(p[1]));
    let bottom = hull.iter().fold(f64::NEG_INFINITY, |m, p| m.max(p[1]));
    let rows = centres_between(top, bottom, mask.len().checked_div(width).unwrap_or(0));
    for row in rows {
        let y = row as f64 + 0.5;
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for (k, p) in hull.iter().enumerate() {
            let q = hull[(k + 1) % hull.len()];
            if p[1].min(q[1]) <= y && y <= p[1].max(q[1]) {
                let share = if p[1] == q[1] { 0.0 } else { (y - p[1]) / (q[1] - p[1]) };
                let x = p[0] + share * (q[0] - p[0]);
                left = left.min(x);
                right = right.max(x);
            }
        }
        mask[row * width..][centres_between(left, right, width)].fill(true);
    }
}

/// Indices in `0..count` whose centre, index + 0.5, lies in `low..=high`.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=count before the cast")]
fn centres_between(low: f64, high: f64, count: usize) -> std::ops::Range<usize> {
    let clamp = |value: f64| value.clamp(0.0, count as f64) as usize;
    let start = clamp((low - 0.5).ceil());
    start..clamp((high - 0.5).floor() + 1.0).max(start)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn marked(points: &[[f64; 2]], width: usize, height: usize) -> Vec<bool> {
        let mut mask = vec![false; width * height];
        mark_convex(&convex_hull(points), width, &mut mask);
        mask
    }

    #[test]
    fn a_rectangle_covers_the_centres_within() {
        let mask = marked(&[[1.0, 1.0], [3.2, 1.0], [3.2, 2.6], [1.0, 2.6]], 5, 4);
        let want = [0, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0].map(|v| v == 1);
        assert_eq!(mask, want);
    }

    #[test]
    fn parts_beyond_the_image_are_cut_off() {
        assert_eq!(marked(&[[-1e7, -1e7], [1e7, -1e7], [1e7, 1e7], [-1e7, 1e7]], 3, 2), [true; 6]);
        assert_eq!(marked(&[[10.0, 10.0], [20.0, 10.0], [15.0, 20.0]], 3, 2), [false; 6]);
        assert_eq!(marked(&[[-20.0, -5.0], [-10.0, 9.0], [-15.0, 20.0]], 3, 2), [false; 6]);
    }

    #[test]
    fn few_or_equal_points_cover_nothing() {
        assert_eq!(marked(&[], 3, 2), [false; 6]);
        assert_eq!(marked(&[[1.2, 0.7]; 8], 3, 2), [false; 6]);
        assert_eq!(marked(&[[0.0, 0.25], [3.0, 1.25]], 3, 2), [false; 6]);
        assert!(marked(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], 0, 0).is_empty());
    }

    #[test]
    fn points_within_and_on_the_edge_leave_the_hull() {
        let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        let mut points = corners.to_vec();
        points.extend([[2.0, 0.0], [2.0, 2.0], [4.0, 1.0], [1.0, 3.0]]);
        assert_eq!(convex_hull(&points), corners);
    }

    proptest! {
        /// A centre is in the hull exactly if no line through two of the points has all points strictly on its other side.
        #[test]
        fn equals_the_half_plane_test(points in prop::collection::vec([-2.0_f64..12.0, -2.0_f64..9.0], 3..12)) {
            let mask = marked(&points, 10, 7);
            let side = |a: [f64; 2], b: [f64; 2], p: [f64; 2]| {
                (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
            };
            for (i, &got) in mask.iter().enumerate() {
                let centre = [(i % 10) as f64 + 0.5, (i / 10) as f64 + 0.5];
                let outside = points.iter().any(|&a| points.iter().any(|&b| {
                    a != b && points.iter().all(|&p| side(a, b, p) >= 0.0) && side(a, b, centre) < 0.0
                }));
                prop_assert_eq!(got, !outside, "pixel {}", i);
            }
        }
    }
}

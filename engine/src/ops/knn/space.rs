//! Nearest points in space alone, by the k-d tree of the `kiddo` crate.

use std::num::NonZeroUsize;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::{check_points, nearest_of, squared_distance};
use crate::error::Result;
use crate::parallel;

/// Points that can be asked which of them are nearest to a place.
#[derive(Debug)]
pub struct Space {
    /// `None` without points.
    tree: Option<ImmutableKdTree<f64, 3>>,
}

/// A point that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Near {
    /// Squared distance from the place.
    pub squared: f64,
    /// Index of the point.
    pub index: u32,
}

impl Space {
    /// The tree of points; distances are those of f64.
    ///
    /// # Errors
    /// When a coordinate is not finite, or there are 2^32 - 1 points or more.
    pub fn new(points: &[[f32; 3]]) -> Result<Self> {
        check_points(points)?;
        if points.is_empty() {
            return Ok(Self { tree: None });
        }
        let points: Vec<[f64; 3]> = points.iter().map(|point| point.map(f64::from)).collect();
        let tree = ImmutableKdTree::new_from_slice(&points)
            .map_err(|error| candle_core::Error::Msg(format!("k-d tree of {} points: {error:?}", points.len())))?;
        Ok(Self { tree: Some(tree) })
    }

    /// The `k` nearest points of a place, nearest first, a point at the place itself among them; as many as there are when fewer exist.
    pub fn nearest(&self, place: &[f32; 3], k: usize) -> Vec<Near> {
        let (Some(tree), Some(k)) = (&self.tree, NonZeroUsize::new(k)) else { return Vec::new() };
        let found = tree.query(&place.map(f64::from)).nearest_n::<SquaredEuclidean<f64>>(k).execute();
        found.iter().map(|found| Near { squared: found.distance, index: found.item }).collect()
    }

    /// The points nearer than `reach` to a place, in no order.
    pub fn within(&self, place: &[f32; 3], reach: f64) -> Vec<Near> {
        let Some(tree) = &self.tree else { return Vec::new() };
        let found =
            tree.query(&place.map(f64::from)).within::<SquaredEuclidean<f64>>(reach * reach).unsorted().execute();
        let near = found.iter().map(|found| Near { squared: found.distance, index: found.item });
        near.filter(|near| near.squared < reach * reach).collect()
    }
}

/// The `k` nearest other points of the points `queries`, nearest first, of each as many as there are when fewer exist: by the tree of our own, to
/// which a million points at one place are no trouble.
///
/// # Errors
/// Those of [`nearest_of`].
pub(crate) fn nearest_in_space(points: &[[f32; 3]], queries: &[u32], k: usize) -> Result<Vec<Vec<Near>>> {
    let found = nearest_of(points, queries, k)?;
    let near = |row: usize| -> Vec<Near> {
        let squared = |&index: &u32| squared_distance(&points[queries[row] as usize], &points[index as usize]);
        found.of(row).iter().map(|index| Near { squared: squared(index), index: *index }).collect()
    };
    Ok(parallel::map(queries.len(), 256, &near))
}

#[cfg(test)]
mod tests {
    use super::{Space, nearest_in_space};
    use crate::ops::knn::reference;

    fn points(count: usize, scale: f32) -> Vec<[f32; 3]> {
        let value = |k: usize| f32::from(u8::try_from(k * 37 % 61).unwrap()) * scale;
        (0..count).map(|i| [value(i), value(i * 3 + 1), value(i * 7 + 5)]).collect()
    }

    /// Distances, as ties go to nobody in particular; on a lattice, so that there are many.
    #[test]
    fn distances_are_those_of_the_twin() {
        for (count, k, scale) in [(1, 2, 1.0), (2, 5, 0.37), (40, 3, 1e-30), (400, 8, 1.0), (400, 1, 1e30)] {
            let points = points(count, scale);
            let own: Vec<u32> = (0..).take(count).collect();
            let want = reference::nearest_of_other_groups(&points, &own, k);
            let square = |i: usize, j: u32| super::super::squared_distance(&points[i], &points[j as usize]);
            for (i, found) in nearest_in_space(&points, &own, k).unwrap().into_iter().enumerate() {
                let want: Vec<f64> =
                    want[i * k..][..k].iter().filter(|&&j| j != u32::MAX).map(|&j| square(i, j)).collect();
                assert_eq!(found.len(), want.len());
                for (found, want) in found.iter().zip(want) {
                    assert!(found.index as usize != i && square(i, found.index) == want, "point {i} of {count}");
                    assert!((found.squared - want).abs() <= 1e-12 * want, "point {i} of {count}");
                }
            }
        }
    }

    #[test]
    fn one_place_none_and_what_is_not_finite() {
        let same = vec![[3.5, -1.0, 0.25]; 5000];
        let found = nearest_in_space(&same, &[7, 4999], 3).unwrap();
        assert!(found.iter().zip([7, 4999]).all(|(found, own)| {
            found.len() == 3 && found.iter().all(|near| near.squared == 0.0 && near.index != own)
        }));
        assert!(Space::new(&[]).unwrap().nearest(&[0.0; 3], 4).is_empty());
        assert!(Space::new(&[]).unwrap().within(&[0.0; 3], 4.0).is_empty());
        assert!(nearest_in_space(&[], &[], 3).unwrap().is_empty());
        assert!(nearest_in_space(&[[0.0; 3]; 2], &[2], 1).is_err());
        assert!(nearest_in_space(&[[0.0, f32::NAN, 0.0]], &[], 1).unwrap_err().to_string().contains("point 0, y"));
    }

    #[test]
    fn within_is_nearer_than() {
        let points = points(400, 1.0);
        let space = Space::new(&points).unwrap();
        let square = |i: u32, place: &[f32; 3]| super::super::squared_distance(&points[i as usize], place);
        for place in [[10.0, 20.0, 30.0], points[3]] {
            let mut found: Vec<u32> = space.within(&place, 9.0).iter().map(|near| near.index).collect();
            found.sort_unstable();
            let want: Vec<u32> = (0..400).filter(|&i| square(i, &place) < 81.0).collect();
            assert!(!want.is_empty() && found == want, "{found:?}, want {want:?}");
        }
    }
}

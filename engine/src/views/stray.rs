//! Returns of a single sweep that are no surface.
//!
//! Rain, snow and dust answer a beam alone: what the rays around theirs meet is farther. A surface that is hit once only, of all the rays
//! around, is rare: poles, wires and branches, thinner than the beams are apart, are hit again by the next ray or the next row.

use crate::{
    error::Result,
    ops::knn::{Near, nearest_in_space},
};

/// What is nearer carries the sensor, metres: automotive `LiDAR`s measure from 0.3 to 1 m on, and give the origin for no return.
const NEAREST: f32 = 0.5;
/// No automotive `LiDAR` reaches so far, metres: twice the range of those made for motorways.
const REACH: f32 = 1000.0;
/// Metres within which a drop or flake answers at all: it is smaller than the beam, so that its echo falls with the fourth power of the range.
const ALONE_WITHIN: f32 = 30.0;
/// So many rays next to a return's, all of which must go past it, and how many times farther what they meet is at least: steep surfaces change
/// their range by less from ray to ray.
const PAST: (usize, f32) = (4, 1.2);
/// Share of its range within which others are at the same place as a return: three degrees, wider than the rows of a sensor of 16 are apart, so
/// that what is hit once in each row has company.
const SAME_PLACE: f32 = 0.05;
/// So many others at the same place are a surface, out of reach as it is.
const SURFACE: usize = 32;

/// Why a return is no surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stray {
    /// At the sensor, or nearer than anything but what carries it.
    AtSensor,
    /// Farther than sensors reach, and nothing else there.
    OutOfReach,
    /// Before everything that the rays around meet.
    Alone,
}

/// The returns of a sweep that are no surface, ascending.
///
/// # Shapes
/// `points` `[N, 3]` and `origins` `[N, 3]`, where their rays start, metres.
///
/// # Formula
/// With the range `r`: at the sensor for `r < 0.5 m`; out of reach for `r > 1 km`, where most of the sweep is not, with fewer than 32 others
/// within `r / 20`; alone for
/// `r < 30 m` if the 4 returns whose rays are nearest in direction are all beyond `1.2 r`, and no other is within `r / 20`. What other sensors
/// measured from elsewhere may seem to lie before surfaces, but has company there.
///
/// # Errors
/// When a coordinate is not finite.
pub(crate) fn strays(points: &[[f32; 3]], origins: &[[f32; 3]]) -> Result<Vec<(u32, Stray)>> {
    let rays: Vec<([f32; 3], f32)> = points.iter().zip(origins).map(|(point, origin)| ray(point, origin)).collect();
    let indices = || (0..).zip(&rays).map(|(i, &(_, range))| (i, range));
    let mut found: Vec<(u32, Stray)> =
        indices().filter(|&(_, range)| range < NEAREST).map(|(i, _)| (i, Stray::AtSensor)).collect();
    let far: Vec<u32> = indices().filter(|&(_, range)| range > REACH).map(|(i, _)| i).collect();
    // A clip in other units than metres has most of its returns there.
    if !far.is_empty() && 2 * far.len() < points.len() {
        let others = nearest_in_space(points, &far, SURFACE)?;
        let lonely = |(near, &i): (&Vec<Near>, &u32)| {
            let last = near.get(SURFACE - 1);
            last.is_none_or(|last| last.squared.sqrt() > f64::from(SAME_PLACE * rays[i as usize].1))
                .then_some((i, Stray::OutOfReach))
        };
        found.extend(others.iter().zip(&far).filter_map(lonely));
    }
    found.sort_unstable_by_key(|&(i, _)| i);
    let is_found = |i: u32| found.binary_search_by_key(&i, |&(j, _)| j).is_ok();
    let others: Vec<u32> = indices().map(|(i, _)| i).filter(|&i| !is_found(i)).collect();
    let measured: Vec<([f32; 3], f32)> = others.iter().map(|&i| rays[i as usize]).collect();
    found.extend(alone(&measured)?.into_iter().map(|m| (others[m as usize], Stray::Alone)));
    found.sort_unstable_by_key(|&(i, _)| i);
    Ok(found)
}

/// Those of the returns, as rays and their ranges, that the nearest rays go past, and that have no company.
fn alone(rays: &[([f32; 3], f32)]) -> Result<Vec<u32>> {
    let directions: Vec<[f32; 3]> = rays.iter().map(|&(direction, _)| direction).collect();
    let range = |i: u32| rays[i as usize].1;
    let chosen: Vec<u32> = (0..).zip(rays).filter(|(_, (_, range))| *range < ALONE_WITHIN).map(|(i, _)| i).collect();
    let nearest = nearest_in_space(&directions, &chosen, PAST.0)?;
    let is_past = |(around, &i): (&Vec<Near>, &u32)| {
        (around.len() == PAST.0 && around.iter().all(|near| range(near.index) > PAST.1 * range(i))).then_some(i)
    };
    let chosen: Vec<u32> = nearest.iter().zip(&chosen).filter_map(is_past).collect();
    let places: Vec<[f32; 3]> = rays.iter().map(|&(direction, range)| direction.map(|v| v * range)).collect();
    let others = nearest_in_space(&places, &chosen, 1)?;
    let is_alone = |(near, &i): (&Vec<Near>, &u32)| {
        let limit = f64::from(SAME_PLACE * range(i)).powi(2);
        near.first().is_some_and(|near| near.squared > limit).then_some(i)
    };
    Ok(others.iter().zip(&chosen).filter_map(is_alone).collect())
}

/// The direction of a return from where its ray starts, and its range; no direction at the start itself.
fn ray(point: &[f32; 3], origin: &[f32; 3]) -> ([f32; 3], f32) {
    let way = [0, 1, 2].map(|k| point[k] - origin[k]);
    let range = way.iter().map(|v| v * v).sum::<f32>().sqrt();
    (way.map(|v| if range > 0.0 { v / range } else { 0.0 }), range)
}

#[cfg(test)]
mod tests {
    use super::{Stray, strays};

    /// What a sensor at the origin measures of a wall, 20 m ahead, in rows that are ten times as far apart as the steps along them, with a pole
    /// before it that is hit once in each row.
    fn wall() -> Vec<[f32; 3]> {
        let mut points = Vec::new();
        for row in -6..6_i16 {
            for step in -60..60_i16 {
                let (across, up) = (0.0035 * f32::from(step), 0.035 * f32::from(row));
                let range = if step == 20 { 8.0 } else { 20.0 };
                points.push([range, range * across, range * up]);
            }
        }
        points
    }

    fn found(points: &[[f32; 3]]) -> Vec<(u32, Stray)> {
        strays(points, &vec![[0.0; 3]; points.len()]).unwrap()
    }

    #[test]
    fn surfaces_and_what_is_thin_stay() {
        assert_eq!(found(&wall()), []);
        let far: Vec<[f32; 3]> = wall().into_iter().map(|p| p.map(|v| v * 1000.0)).collect();
        assert_eq!(found(&far), [], "a clip in millimetres");
        assert!(found(&[]).is_empty() && found(&[[5.0, 0.0, 0.0]]).is_empty());
    }

    #[test]
    fn each_kind_is_told() {
        let mut points = wall();
        let count = u32::try_from(points.len()).unwrap();
        points.extend([
            [0.0; 3],
            [0.2, -0.3, 0.1],
            [5000.0, 10.0, 3.0],
            [5000.0, 10.0, 3.0],
            [9.0, -0.6, 0.3],
            [29.0, 0.0, 0.0],
        ]);
        let want = [Stray::AtSensor, Stray::AtSensor, Stray::OutOfReach, Stray::OutOfReach, Stray::Alone];
        assert_eq!(found(&points), (count..).zip(want).collect::<Vec<_>>());
        // Two near each other have met something.
        points.push([9.1, -0.63, 0.3]);
        assert!(found(&points).iter().all(|(_, kind)| *kind != Stray::Alone));
    }

    #[test]
    fn nothing_else_is_needed() {
        assert_eq!(found(&[[0.0; 3]; 40]).len(), 40);
        assert!(strays(&[[f32::NAN; 3]], &[[0.0; 3]]).is_err());
    }
}

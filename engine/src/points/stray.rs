//! Returns of a cloud that are no surface, taken away and counted.

use serde::Serialize;

use super::PointCloud;
use crate::{
    error::Result,
    ops::knn::Space,
    views::{Stray, strays},
};

/// How near another sweep must have a return to one that is alone in its own for it to be a thing, metres: what a walker does from one sweep
/// to the next, and more than poses are wrong by. A drop falls that far, or the air takes it.
const THERE: f64 = 0.5;

/// How many returns were left out, by why.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Dropped {
    /// Rows without coordinates: a beam met nothing.
    pub missing: usize,
    /// At the sensor, or nearer than anything but what carries it.
    pub at_sensor: usize,
    /// Farther than sensors reach, and nothing else there.
    pub out_of_reach: usize,
    /// Before everything that the rays around meet, and nothing there in any other sweep: rain, snow, dust.
    pub alone: usize,
}

impl Dropped {
    /// How many there are, of all kinds.
    pub const fn total(&self) -> usize {
        self.missing + self.at_sensor + self.out_of_reach + self.alone
    }

    /// What was left out, for people; `None` where nothing was.
    pub fn in_words(&self) -> Option<String> {
        let kinds = [
            (self.missing, "without coordinates"),
            (self.at_sensor, "at the sensor"),
            (self.out_of_reach, "beyond the reach of sensors"),
            (self.alone, "alone in the air"),
        ];
        let words: Vec<String> =
            kinds.iter().filter(|(count, _)| *count > 0).map(|(count, kind)| format!("{count} {kind}")).collect();
        (!words.is_empty()).then(|| format!("{} that are no surface were left out: {}", self.total(), words.join(", ")))
    }
}

/// How many returns of the cloud were no surface; it has them no more.
///
/// # Errors
/// When a coordinate is not finite.
pub(crate) fn drop_strays(cloud: &mut PointCloud) -> Result<Dropped> {
    let mut dropped = Dropped { missing: cloud.num_missing, ..Dropped::default() };
    let mut found: Vec<(u32, Stray)> = Vec::new();
    let mut start = 0;
    for run in cloud.frames.chunk_by(|a, b| a == b) {
        let sweep = start..start + run.len();
        let first = u32::try_from(start).unwrap_or(u32::MAX);
        let of_sweep = strays(&cloud.positions[sweep.clone()], &cloud.origins[sweep.clone()])?;
        found.extend(of_sweep.into_iter().map(|(i, kind)| (first + i, kind)));
        start = sweep.end;
    }
    let alone: Vec<u32> = found.iter().filter(|(_, kind)| *kind == Stray::Alone).map(|(i, _)| *i).collect();
    let mut is_there = vec![false; alone.len()];
    if !alone.is_empty() {
        let space = Space::new(&cloud.positions)?;
        for (is_there, &i) in is_there.iter_mut().zip(&alone) {
            let around = space.within(&cloud.positions[i as usize], THERE);
            *is_there = around.iter().any(|near| cloud.frames[near.index as usize] != cloud.frames[i as usize]);
        }
    }
    let mut is_there = is_there.into_iter();
    let mut stays = vec![true; cloud.len()];
    for (i, kind) in found {
        match kind {
            Stray::AtSensor => dropped.at_sensor += 1,
            Stray::OutOfReach => dropped.out_of_reach += 1,
            Stray::Alone if is_there.next() == Some(true) => continue,
            Stray::Alone => dropped.alone += 1,
        }
        stays[i as usize] = false;
    }
    if stays.contains(&false) {
        keep(&mut cloud.positions, &stays);
        keep(&mut cloud.times, &stays);
        keep(&mut cloud.frames, &stays);
        keep(&mut cloud.origins, &stays);
    }
    Ok(dropped)
}

/// Removes what does not stay.
fn keep<T>(all: &mut Vec<T>, stays: &[bool]) {
    let mut stays = stays.iter();
    all.retain(|_| stays.next() == Some(&true));
}

#[cfg(test)]
mod tests {
    use super::{Dropped, drop_strays};
    use crate::points::PointCloud;

    /// Two sweeps of a wall 20 m ahead, each with its own returns besides.
    fn cloud(own: [&[[f32; 3]]; 2]) -> PointCloud {
        let mut cloud = PointCloud { num_missing: 7, ..PointCloud::default() };
        for (frame, own) in (0_u32..).zip(own) {
            let wall = (0..400_u16).map(|k| [20.0, 0.1 * f32::from(k % 20) - 1.0, 0.1 * f32::from(k / 20) - 1.0]);
            for position in own.iter().copied().chain(wall) {
                cloud.positions.push(position);
                cloud.times.push(0.1 * frame as f32);
                cloud.frames.push(frame);
                cloud.origins.push([0.0; 3]);
            }
        }
        cloud
    }

    #[test]
    fn what_is_alone_in_one_sweep_is_real_if_another_has_it() {
        let (drop, thing, later) = ([8.0, 0.2, 0.1], [9.0, -0.2, -0.1], [9.2, -0.1, -0.1]);
        let mut found = cloud([&[drop, [0.0; 3], thing], &[later, [9000.0, 1.0, 1.0]]]);
        let dropped = drop_strays(&mut found).unwrap();
        assert_eq!(dropped, Dropped { missing: 7, at_sensor: 1, out_of_reach: 1, alone: 1 });
        let words = "10 that are no surface were left out: 7 without coordinates, 1 at the sensor, 1 beyond the reach of sensors, 1 alone in the air";
        assert_eq!(dropped.in_words().as_deref(), Some(words));
        assert_eq!(found, cloud([&[thing], &[later]]));
    }

    #[test]
    fn nothing_and_nothing_but_strays() {
        let mut none = PointCloud::default();
        assert_eq!(drop_strays(&mut none).unwrap().in_words(), None);
        let mut zeros = PointCloud {
            positions: vec![[0.0; 3]; 3],
            times: vec![0.0; 3],
            frames: vec![0; 3],
            origins: vec![[0.0; 3]; 3],
            num_missing: 0,
        };
        assert_eq!(drop_strays(&mut zeros).unwrap().total(), 3);
        assert!(zeros.is_empty());
    }
}

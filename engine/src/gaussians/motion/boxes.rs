//! Motion of what is inside of tracked boxes.

use glam::{DMat3, DVec3};
use lgs_formats::pose::Pose;

use super::{Flow, Movement};
use lgs_formats::casts::to_f32;

use crate::{parallel, points::PointCloud};

/// How far outside of a box its returns may be, metres: labels are about so exact.
const MARGIN: f64 = 0.1;
/// Slower things stand still, metres a second: labels of what is parked move a little.
const SLOWEST: f64 = 0.3;

/// A tracked box of an input frame.
#[derive(Clone, Debug, PartialEq)]
pub struct MovingBox {
    /// Index of the frame in the clip.
    pub frame: u32,
    /// Timestamp of its sweep, seconds since the clip's time zero.
    pub time: f64,
    /// Identity of the object over the frames.
    pub track: String,
    /// Length, width, height, metres.
    pub size: [f64; 3],
    /// Its pose in the clip frame.
    pub clip_from_box: Pose,
}

/// What moves, as tracked boxes say: from the input frame before to the one after, or to the only one there is.
pub(crate) fn boxed(cloud: &PointCloud, boxes: &[MovingBox]) -> Movement {
    let mut movement = Movement::none(cloud.len());
    let flows: Vec<(&MovingBox, Flow)> = boxes.iter().filter_map(|own| Some((own, flow(own, boxes)?))).collect();
    let inside: Vec<Vec<usize>> = parallel::map(flows.len(), 1, &|k| {
        let own = flows[k].0;
        let start = cloud.frames.partition_point(|&frame| frame < own.frame);
        let end = cloud.frames.partition_point(|&frame| frame <= own.frame);
        let box_from_clip = own.clip_from_box.inverse();
        (start..end).filter(|&point| own.holds(&box_from_clip, cloud.positions[point])).collect()
    });
    for ((_, flow), inside) in flows.into_iter().zip(inside).filter(|(_, inside)| !inside.is_empty()) {
        movement.add(cloud, flow, inside.into_iter());
    }
    movement
}

impl MovingBox {
    fn holds(&self, box_from_clip: &Pose, point: [f32; 3]) -> bool {
        let at = box_from_clip.transform_point(DVec3::from(point.map(f64::from)));
        (0..3).all(|k| at[k].abs() <= 0.5 * self.size[k] + MARGIN)
    }
}

/// The motion of a box between the neighbours of its track; `None` for one that stands still, or that no other input frame has.
fn flow(own: &MovingBox, boxes: &[MovingBox]) -> Option<Flow> {
    let others = || boxes.iter().filter(|other| other.track == own.track);
    let before = others().filter(|other| other.time < own.time).max_by(|a, b| a.time.total_cmp(&b.time)).unwrap_or(own);
    let after = others().filter(|other| other.time > own.time).min_by(|a, b| a.time.total_cmp(&b.time)).unwrap_or(own);
    let seconds = after.time - before.time;
    let moved = after.clip_from_box.translation() - before.clip_from_box.translation();
    if seconds <= 0.0 || moved.length() < SLOWEST * seconds {
        return None;
    }
    let box_from_clip = own.clip_from_box.inverse();
    let [a, b] = [before, after].map(|other| other.clip_from_box * box_from_clip);
    let turn: DMat3 = (b.rotation() - a.rotation()) * (1.0 / seconds);
    let shift = (b.translation() - a.translation()) / seconds;
    let rows = [0, 1, 2].map(|k| [turn.x_axis[k], turn.y_axis[k], turn.z_axis[k], shift[k]].map(to_f32));
    Some(Flow { frame: own.frame, rows })
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use lgs_formats::pose::Pose;

    use super::{MovingBox, boxed};
    use crate::{gaussians::motion::STANDS, points::PointCloud};

    fn at(frame: u32, time: f64, angle: f64, place: [f64; 3]) -> MovingBox {
        let clip_from_box = Pose::new(DMat3::from_rotation_z(angle), DVec3::from(place));
        MovingBox { frame, time, track: "car".to_owned(), size: [4.0, 2.0, 1.5], clip_from_box }
    }

    #[test]
    fn what_is_inside_of_a_box_moves_and_turns_with_it_and_all_else_stands() {
        // Around the origin at half a radian a second, ten metres away from it.
        let on_circle = |frame: u32, time: f64| {
            let angle: f64 = 0.5 * time;
            at(frame, time, angle, [10.0 * angle.sin(), -10.0 * angle.cos(), 0.0])
        };
        let boxes = [on_circle(0, 0.0), on_circle(2, 0.2), on_circle(4, 0.4)];
        let front = boxes[1].clip_from_box.transform_point(DVec3::new(1.9, 0.5, 0.0));
        let [a, b] = [front, DVec3::new(30.0, 0.0, 0.0)].map(|p| p.to_array().map(lgs_formats::casts::to_f32));
        let cloud = PointCloud {
            positions: vec![a, a, b],
            times: vec![0.0, 0.2, 0.2],
            frames: vec![0, 2, 2],
            origins: vec![[0.0; 3]; 3],
            num_missing: 0,
        };
        let found = boxed(&cloud, &boxes);
        assert_eq!(found.things[2], STANDS);
        assert_eq!(found.velocities[2], [0.0; 3]);
        let want = DVec3::new(-front.y, front.x, 0.0) * 0.5;
        let got = DVec3::from(found.velocities[1].map(f64::from));
        assert!(got.distance(want) < 0.02, "{got} instead of {want}");
        assert_eq!(found.things[0], STANDS, "another frame's box does not hold it");
    }

    #[test]
    fn what_is_parked_or_seen_once_stands() {
        let cloud = PointCloud {
            positions: vec![[0.0; 3]; 2],
            times: vec![0.0, 0.2],
            frames: vec![0, 2],
            origins: vec![[0.0; 3]; 2],
            num_missing: 0,
        };
        for boxes in
            [vec![at(0, 0.0, 0.0, [0.0; 3])], vec![at(0, 0.0, 0.0, [0.0; 3]), at(2, 0.2, 0.0, [0.03, 0.0, 0.0])]]
        {
            assert!(boxed(&cloud, &boxes).things.iter().all(|&thing| thing == STANDS));
        }
    }
}

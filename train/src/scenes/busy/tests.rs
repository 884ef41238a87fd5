//! Streets with traffic, as they are filled.

use crate::scenes::{Scene, SceneConfig, Split, presets};

fn objects(seed: u64) -> (SceneConfig, Scene) {
    let config = presets::traffic(Split::Traffic.seed(seed));
    (config.clone(), Scene::new(config).unwrap())
}

#[test]
fn streets_hold_what_real_ones_have_and_nobody_meets_anybody() {
    let mut seen = std::collections::BTreeMap::new();
    for seed in 0..24 {
        let (config, scene) = objects(seed);
        let world = &scene.world;
        let end = config.frame_time(config.num_frames);
        for (k, a) in world.objects.iter().enumerate() {
            let kind = a.track.split('-').next().unwrap().to_owned();
            *seen.entry(kind).or_insert(0) += 1;
            assert!(world.objects[..k].iter().all(|b| b.track != a.track), "seed {seed}: track {}", a.track);
            let people = |category: &str| category == "pedestrian";
            for b in world.objects[..k].iter().filter(|b| !people(a.model.category) && !people(b.model.category)) {
                for time in [0.0, 0.3 * end, 0.7 * end, end] {
                    let [at, other] = [a, b].map(|object| object.footprint(&world.ground.road, time));
                    assert!(!at.meets(&other), "seed {seed}: {} meets {}", a.track, b.track);
                }
            }
        }
    }
    for kind in ["queue", "lorry", "crossing", "turning", "cyclist", "walker"] {
        assert!(seen.get(kind).is_some_and(|&number| number >= 8), "{kind}: {seen:?}");
    }
}

#[test]
fn what_turns_changes_its_heading() {
    let mut turned = 0;
    for seed in 0..16 {
        let (config, scene) = objects(seed);
        let [first, last] = [0, config.num_frames - 1].map(|frame| scene.boxes(frame));
        for a in first.iter().filter(|a| a.track.starts_with("turning")) {
            let Some(b) = last.iter().find(|b| b.track == a.track) else { continue };
            let cosine = a.world_from_box.rotation().x_axis.dot(b.world_from_box.rotation().x_axis);
            turned += usize::from(cosine < 0.97);
        }
    }
    assert!(turned >= 6, "{turned} boxes turn by more than 14 degrees");
}

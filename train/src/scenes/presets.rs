//! Ready-made configurations: one drawn from a seed, and the clip that ships.

use super::{
    config::{BusySpec, LightSpec, Origin, SceneConfig, StreetSpec, TrafficSpec},
    rig::{CAMERA_PLACES, CameraSpec, LidarSpec, Rig},
    rng::Rng,
    streams,
};

/// A configuration of which every aspect is drawn from the seed: street, textures, light, traffic, sensors, time.
/// Images have 256 x 512 pixels.
pub fn varied(seed: u64) -> SceneConfig {
    let mut rng = Rng::new(seed, streams::CONFIG);
    SceneConfig {
        seed,
        num_frames: rng.between(4, 8),
        frame_interval_s: if rng.chance(0.6) { 0.1 } else { rng.uniform(0.05, 0.25) },
        box_reach_m: 80.0,
        rig: rig(&mut rng),
        street: street(&mut rng),
        traffic: usual_traffic(&mut rng),
        light: light(&mut rng),
        origin: origin(&mut rng),
    }
}

fn rig(rng: &mut Rng) -> Rig {
    let num_cameras = rng.pick(&[1, 2, 3, 3, 3, 5]);
    let (fov, spread, pitch) = (rng.uniform(48.0, 78.0), rng.uniform(0.8, 1.3), rng.uniform(-3.0, 6.0));
    let height = rng.uniform(1.35, 2.1);
    let late = rng.uniform(-0.02, 0.02);
    let cameras = CAMERA_PLACES[..num_cameras]
        .iter()
        .map(|&(name, yaw)| {
            let mut camera = CameraSpec::at_place((name, yaw), 256, 512, fov);
            camera.yaw_deg = yaw * spread + rng.uniform(-2.0, 2.0);
            camera.pitch_deg = pitch + rng.uniform(-0.5, 0.5);
            camera.roll_deg = rng.uniform(-0.7, 0.7);
            camera.position[2] = height;
            camera.delay_s = late + rng.uniform(-0.01, 0.01);
            camera
        })
        .collect();
    let mut lidar = LidarSpec::spinning(rng.pick(&[16, 32, 40, 64, 64, 128]), rng.pick(&[600, 900, 1200, 1800]));
    lidar.position[2] = height + rng.uniform(0.1, 0.4);
    lidar.elevation_deg = [rng.uniform(-26.0, -17.0), rng.uniform(2.0, 12.0)];
    lidar.range_noise_m = rng.uniform(0.003, 0.035);
    lidar.dropout = rng.uniform(0.0, 0.1);
    lidar.range_m = [1.5, rng.uniform(60.0, 120.0)];
    Rig { cameras, lidar }
}

fn street(rng: &mut Rng) -> StreetSpec {
    let low = rng.between(0, 2);
    StreetSpec {
        curvature: if rng.chance(0.3) { 0.0 } else { rng.uniform(-0.0055, 0.0055) },
        lane_width_m: rng.uniform(3.0, 3.8),
        num_lanes: rng.pick(&[1, 1, 1, 2]),
        parking: rng.chance(0.75),
        pavement_m: rng.uniform(2.2, 4.5),
        floors: [low, low + rng.between(1, 3)],
        open_plots: rng.uniform(0.0, 0.5),
        tree_spacing_m: rng.uniform(8.0, 32.0),
        texture_scale: rng.uniform(0.7, 1.9),
    }
}

fn usual_traffic(rng: &mut Rng) -> TrafficSpec {
    TrafficSpec {
        ego_speed: if rng.chance(0.1) { 0.0 } else { rng.uniform(2.0, 14.0) },
        num_cars: rng.between(1, 7),
        speeds: [3.0, rng.uniform(8.0, 15.0)],
        num_people: rng.between(0, 5),
        parked: rng.uniform(0.2, 0.9),
        busy: None,
    }
}

/// A configuration as [`varied`] draws it, with traffic as real streets have it, seven or eight timestamps at 10 Hz, and cameras that
/// expose 20 to 100 ms before or after the sweep's timestamp.
pub fn traffic(seed: u64) -> SceneConfig {
    let mut config = varied(seed);
    let mut rng = Rng::new(seed, streams::BUSY_CONFIG);
    config.num_frames = rng.between(7, 8);
    config.frame_interval_s = 0.1;
    config.rig.lidar.num_beams = rng.pick(&[32, 40, 64, 64, 128]);
    config.rig.lidar.num_azimuths = rng.pick(&[900, 1200, 1800]);
    for camera in &mut config.rig.cameras {
        camera.delay_s = rng.uniform(0.02, 0.1) * if rng.chance(0.5) { 1.0 } else { -1.0 };
    }
    let ego_speed = if rng.chance(0.15) { 0.0 } else { rng.uniform(1.0, 10.0) };
    let driven = ego_speed * config.frame_time(config.num_frames);
    config.street.num_lanes = rng.pick(&[1, 1, 2]);
    config.traffic = TrafficSpec {
        ego_speed,
        num_cars: rng.between(1, 3),
        num_people: rng.between(1, 6),
        busy: Some(BusySpec {
            side_street: rng.chance(0.8).then(|| driven + rng.uniform(9.0, 20.0)),
            lorries: rng.between(0, 2),
            queue: if rng.chance(0.6) { rng.between(3, 6) } else { 0 },
            crossing: rng.between(1, 3),
            turning: rng.between(1, 3),
            cyclists: rng.between(0, 3),
            people_across: rng.between(0, 3),
        }),
        ..config.traffic
    };
    config
}

fn light(rng: &mut Rng) -> LightSpec {
    LightSpec {
        sun_azimuth_deg: rng.uniform(-180.0, 180.0),
        sun_elevation_deg: rng.uniform(18.0, 70.0),
        overcast: if rng.chance(0.3) { rng.uniform(0.6, 0.95) } else { rng.uniform(0.0, 0.4) },
        clouds: rng.uniform(0.1, 0.9),
        haze_m: rng.uniform(300.0, 2000.0),
    }
}

/// Small numbers, epoch seconds or UTM metres.
fn origin(rng: &mut Rng) -> Origin {
    let near = Origin { position: [0.0; 3], heading_deg: 0.0, time_s: 0.0 };
    if rng.chance(0.4) {
        return near;
    }
    let mut far = Origin { heading_deg: rng.uniform(-180.0, 180.0), ..near };
    if rng.chance(0.6) {
        far.time_s = 1.6e9 + rng.uniform(0.0, 1e8);
    }
    if rng.chance(0.6) {
        far.position = [rng.uniform(3e5, 7e5), rng.uniform(4e6, 6e6), rng.uniform(0.0, 600.0)];
    }
    far
}

/// The clip that ships: five timestamps at 10 Hz of a short street with two front cameras, small on disk.
pub fn street_clip(seed: u64) -> SceneConfig {
    let camera = |place: usize, yaw_deg: f64, delay_s: f64| CameraSpec {
        yaw_deg,
        delay_s,
        pitch_deg: 2.0,
        ..CameraSpec::at_place(CAMERA_PLACES[place], 192, 320, 62.0)
    };
    SceneConfig {
        seed,
        num_frames: 5,
        frame_interval_s: 0.1,
        box_reach_m: 32.0,
        rig: Rig {
            cameras: vec![camera(0, 0.0, 0.005), camera(1, 48.0, -0.005)],
            lidar: LidarSpec {
                elevation_deg: [-20.0, 14.0],
                azimuth_deg: [81.0, -33.0],
                range_m: [1.5, 80.0],
                ..LidarSpec::spinning(34, 150)
            },
        },
        street: StreetSpec {
            curvature: 0.0028,
            lane_width_m: 3.3,
            num_lanes: 1,
            parking: true,
            pavement_m: 2.8,
            floors: [1, 3],
            open_plots: 0.2,
            tree_spacing_m: 15.0,
            texture_scale: 1.5,
        },
        traffic: TrafficSpec {
            ego_speed: 7.0,
            num_cars: 3,
            speeds: [6.0, 10.0],
            num_people: 2,
            parked: 0.6,
            busy: None,
        },
        light: LightSpec {
            sun_azimuth_deg: -152.0,
            sun_elevation_deg: 46.0,
            overcast: 0.05,
            clouds: 0.55,
            haze_m: 1500.0,
        },
        origin: Origin { position: [0.0; 3], heading_deg: 0.0, time_s: 0.0 },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_valid_and_seeds_differ() {
        for seed in 0..200 {
            varied(seed).validate().unwrap();
            traffic(seed).validate().unwrap();
        }
        street_clip(3).validate().unwrap();
        assert_eq!(varied(5), varied(5));
        assert_ne!(varied(5).street, varied(6).street);
    }
}

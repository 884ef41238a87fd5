use lgs_formats::targets::*;
use lgs_targetgen::*;
use std::time::Instant;
fn main() {
    lgs_engine::allocator::keep_pages();
    lgs_engine::threads::set_num_threads(None).unwrap();
    let a: Vec<String> = std::env::args().collect();
    let cams = if a[2] == "all" { None } else { Some(a[2].split(',').map(str::to_owned).collect()) };
    let size = if a[3] == "own" {
        None
    } else {
        let (h, w) = a[3].split_once('x').unwrap();
        Some([h.parse().unwrap(), w.parse().unwrap()])
    };
    for signal in [Signal::Response, Signal::Footprint, Signal::Magnitude] {
        let config = TargetsConfig {
            signal,
            normalise: Normalise::Branch,
            rounds: 3,
            rho: 0.2,
            neighbours: 8,
            noise_m: 0.01,
            log_scale: 1.0,
            zscore: ZScore::Joint,
            with_features: false,
            cameras: cams.clone(),
            image_size: size,
            seed: 0,
            weights: None,
        };
        let t = Instant::now();
        let scene = scene::load_scene(a[1].as_ref(), &config, None).unwrap();
        let mut s = generate::Seconds::default();
        s.scene = t.elapsed().as_secs_f64();
        let c = generate::generate(scene, &config, 0, &mut s).unwrap();
        let v = c.prune.mask.iter().filter(|m| **m).count() as f64;
        let w = c.add.mask.iter().filter(|m| **m).count() as f64;
        println!("{signal:?} {s:?} M {} valid {v} {w} moments {:?}", c.index.len(), c.moments);
        for th in [0.5, 0.6, 0.7, 0.8] {
            println!(
                "  y>{th}: prune {:.2} add {:.2}",
                100.0 * c.prune.y.iter().zip(&c.prune.mask).filter(|(y, m)| **m && **y > th).count() as f64 / v,
                100.0 * c.add.y.iter().zip(&c.add.mask).filter(|(y, m)| **m && **y > th).count() as f64 / w
            );
        }
    }
}

//! Times of the renderer on 100,000 Gaussians at 640 x 360.

use std::io::Write as _;

use divan::Bencher;
use lgs_engine::gaussians::physical::Splat;
use lgs_engine::render::reference::Camera;
use lgs_engine::render::{ImageGradient, backward, gpu, render, render_for_gradient};
use lgs_engine::views::PinholeView;
use lgs_tests::golden::render::{camera, scene};
use lgs_tests::golden::tensors::TensorFile;
use lgs_tests::places;
use lgs_tests::random::Random;
use lgs_tests::scenes::{Scene, from_pixels, pinhole, splats};

const WIDTH: usize = 640;
const HEIGHT: usize = 360;
const NUM: usize = 100_000;
/// Drawings over which the times of a GPU are a mean.
const GPU_DRAWINGS: u32 = 10;
const INPUTS: &str = "render/bench_inputs_100k_640x360.safetensors";
const BLACK: [f32; 3] = [0.0; 3];

fn main() -> std::io::Result<()> {
    writeln!(std::io::stdout(), "Times to look at and to compare on one machine; no absolute time decides anything.")?;
    gpu_times()?;
    divan::main();
    Ok(())
}

/// Prints what every GPU takes, once the scene is there and its kernels are built.
fn gpu_times() -> std::io::Result<()> {
    let (splats, view) = load();
    for adapter in gpu::adapters() {
        let times = gpu::open(adapter.index).and_then(|gpu| {
            let forward = gpu::times(gpu, &splats, &view, None, GPU_DRAWINGS)?;
            let both = gpu::times(gpu, &splats, &view, Some(&gradient()), GPU_DRAWINGS)?;
            let kernels = both.kernels.iter().map(|(name, seconds)| format!("\n    {name} {:.4} ms", 1e3 * seconds));
            let [forward, both] = [forward.mean, both.mean].map(|seconds| 1e3 * seconds);
            Ok(format!("forward {forward:.3} ms, forward and backward {both:.3} ms") + &kernels.collect::<String>())
        });
        let told = times.unwrap_or_else(|error| error.to_string());
        writeln!(std::io::stdout(), "gpu:{} {}: {told}", adapter.index, adapter.name)?;
    }
    Ok(())
}

/// The load that the goldens bring, or a made-up one of the same statistics.
fn load() -> (Vec<Splat>, PinholeView) {
    let given = places::given_goldens(INPUTS).unwrap_or_else(|| places::shared().join("golden").join(INPUTS));
    let scene = read(&given).unwrap_or_else(|_| made_up());
    (splats(&scene.gaussians), pinhole(&scene.camera))
}

fn read(path: &std::path::Path) -> Result<Scene, String> {
    let file = TensorFile::open(path)?;
    Ok(Scene { gaussians: scene(&file)?, camera: camera(&file, WIDTH, HEIGHT)? })
}

/// Depths log-uniform in 2..50 m, sizes of two pixels in the median.
fn made_up() -> Scene {
    let (width, height) = (WIDTH as f64, HEIGHT as f64);
    let camera = Camera {
        width: WIDTH,
        height: HEIGHT,
        fx: 500.0,
        fy: 500.0,
        cx: 0.5 * width,
        cy: 0.5 * height,
        camera_from_world: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        time: 0.0,
    };
    let mut random = Random::new(640);
    let gaussians = (0..NUM).map(|_| {
        let z = 2.0 * 25.0_f64.powf(random.uniform(0.0, 1.0));
        let pixel = [random.uniform(0.0, width), random.uniform(0.0, height)];
        let sizes_px = [0; 3].map(|_| 2.0 * (0.5 * random.normal()).exp());
        from_pixels(&camera, pixel, z, sizes_px, &mut random)
    });
    Scene { gaussians: gaussians.collect(), camera }
}

fn gradient() -> ImageGradient {
    let pixels = WIDTH * HEIGHT;
    ImageGradient {
        rgb: vec![1.0; 3 * pixels],
        alpha: vec![0.5; pixels],
        depth: vec![0.01; pixels],
        expected_depth: vec![0.01; pixels],
    }
}

#[divan::bench(sample_count = 20)]
fn forward(bencher: Bencher) {
    let (splats, view) = load();
    bencher.bench(|| render(&splats, &view, BLACK));
}

#[divan::bench(sample_count = 20)]
fn forward_and_backward(bencher: Bencher) {
    let (splats, view) = load();
    let gradient = gradient();
    bencher.bench(|| {
        let state = render_for_gradient(&splats, &view, BLACK);
        backward(&splats, &view, &state, &gradient)
    });
}

//! The page that shows a scene: it draws what we draw, and what moves moves with the slider.

use std::fs;
use std::path::Path;

use base64::{Engine, engine::general_purpose::STANDARD};
use image::RgbImage;
use lgs_formats::cloud::{SH_DC, SplatCloud};
use lgs_formats::viewer::{Stop, html};
use lgs_tests::browser::{self, Page};
use lgs_tests::process::{binary, run};
use lgs_tests::{Outcome, case, case_if, clips};
use libtest_mimic::Trial;

/// A page of the shipped clip differs from our own pictures by less than this, decibels.
const CLOSE_DB: f64 = 45.0;

pub(crate) fn cases() -> Vec<Trial> {
    let browser = browser::needed();
    vec![
        case("viewer::written_on_demand_only", written_on_demand_only),
        case_if(&browser, "viewer::draws_what_we_draw", draws_what_we_draw),
        case_if(&browser, "viewer::the_slider_moves_what_moves", the_slider_moves_what_moves),
    ]
}

fn infer(out: &Path, more: &[&str]) -> Outcome {
    let (clip, place) = (clips::street(), out.parent().unwrap_or(out));
    let mut arguments =
        vec![clip.as_os_str(), "--out".as_ref(), out.as_os_str(), "--weights".as_ref(), "none".as_ref()];
    arguments.extend(more.iter().map(|word| word.as_ref() as &std::ffi::OsStr));
    run(&binary("lgs-infer")?, &arguments, place)?.expect_success()
}

fn written_on_demand_only() -> Outcome {
    let place = tempfile::tempdir()?;
    let (with, without) = (place.path().join("with"), place.path().join("without"));
    infer(&with, &["--viewer", "--frames", "0", "--cameras", "front", "--views", "none"])?;
    infer(&without, &["--frames", "0", "--cameras", "front", "--views", "none"])?;
    let page = fs::read_to_string(with.join("viewer.html"))?;
    if without.join("viewer.html").exists() || !page.contains("frame 0 front") {
        return Err("a page without --viewer, or one without its camera".into());
    }
    if fs::read(with.join("scene.ply"))? == fs::read(without.join("scene.ply"))? {
        Ok(())
    } else {
        Err("the page changed the scene".into())
    }
}

/// What the canvas of a page shows.
fn canvas(page: &mut Page) -> Result<RgbImage, String> {
    let url = page.value("lgsPage.then((page) => page.draw().then(() => page.canvas.toDataURL('image/png')))")?;
    let text = url.as_str().and_then(|url| url.split_once(',')).ok_or_else(|| format!("no picture: {url}"))?.1;
    let bytes = STANDARD.decode(text).map_err(|e| e.to_string())?;
    Ok(image::load_from_memory(&bytes).map_err(|e| e.to_string())?.to_rgb8())
}

fn psnr(a: &RgbImage, b: &RgbImage) -> f64 {
    let squares = a.as_raw().iter().zip(b.as_raw()).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2) / 65025.0);
    -10.0 * (squares.sum::<f64>() / a.as_raw().len() as f64).log10()
}

fn draws_what_we_draw() -> Outcome {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    infer(&out, &["--viewer", "--hold-out", "odd"])?;
    let mut page = Page::open(&out.join("viewer.html"), "bare")?;
    let stops = page.value("lgsPage.then((page) => page.stops.length)")?.as_u64().unwrap_or(0);
    if stops == 0 {
        return Err("a page without stops".into());
    }
    for index in [0, stops - 1] {
        let show = format!("lgsPage.then((page) => page.show({index}).then(() => page.stops[{index}].name))");
        let name = page.value(&show)?.as_str().unwrap_or_default().to_owned();
        let [_, frame, camera] = name.splitn(3, ' ').collect::<Vec<_>>()[..] else {
            return Err(format!("a stop called {name}").into());
        };
        let own = image::open(out.join(format!("views/f{frame}_{camera}_render.png")))?.to_rgb8();
        let shown = canvas(&mut page)?;
        if shown.dimensions() != own.dimensions() {
            return Err(format!("{name}: {:?}, want {:?}", shown.dimensions(), own.dimensions()).into());
        }
        let psnr = psnr(&shown, &own);
        if psnr < CLOSE_DB {
            return Err(format!("{name}: {psnr:.1} dB, want {CLOSE_DB}").into());
        }
    }
    Ok(())
}

fn the_slider_moves_what_moves() -> Outcome {
    // a red ball that moves to the right at 2 m/s before a green one that stands, 10 m ahead
    let colour = |rgb: [f32; 3]| rgb.map(|c| (c - 0.5) / SH_DC);
    let cloud = SplatCloud {
        means: vec![[-1.0, 0.0, 10.0], [0.0, 2.0, 10.0]],
        log_scales: vec![[-1.5; 3]; 2],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        logit_opacities: vec![6.0; 2],
        sh_dc: vec![colour([1.0, 0.0, 0.0]), colour([0.0, 1.0, 0.0])],
        velocities: vec![[2.0, 0.0, 0.0], [0.0; 3]],
        times: vec![0.0; 2],
        frames: None,
        extra: Vec::new(),
    };
    let mut scene_from_camera = [0.0; 16];
    for k in 0..4 {
        scene_from_camera[5 * k] = 1.0;
    }
    let stop = |time: f64| Stop {
        name: format!("at {time}"),
        time,
        width: 200,
        height: 100,
        fx: 100.0,
        fy: 100.0,
        cx: 100.0,
        cy: 50.0,
        scene_from_camera,
    };
    let place = tempfile::tempdir()?;
    let file = place.path().join("scene.html");
    fs::write(&file, html(&cloud, &[stop(0.0), stop(1.0)], "two balls"))?;
    let mut page = Page::open(&file, "bare")?;
    for (time, red_at) in [(0.0, 90.0), (0.5, 100.0), (1.0, 110.0)] {
        let slide = format!(
            "(() => {{ const slider = document.getElementById('time'); slider.value = {time}; \
             slider.dispatchEvent(new Event('input')); }})()"
        );
        page.value(&slide)?;
        let shown = canvas(&mut page)?;
        let (red, green) = (centre(&shown, 0), centre(&shown, 1));
        let near = |got: [f64; 2], want: [f64; 2]| (0..2).all(|k| (got[k] - want[k]).abs() < 0.3);
        if !near(red, [red_at, 50.0]) || !near(green, [100.0, 70.0]) {
            return Err(format!("at {time} s: red at {red:?}, green at {green:?}").into());
        }
    }
    Ok(())
}

/// Column and row of the middle of a colour, pixels.
fn centre(image: &RgbImage, channel: usize) -> [f64; 2] {
    let mut sums = [0.0; 3];
    for (column, row, pixel) in image.enumerate_pixels() {
        let weight = f64::from(pixel.0[channel]);
        sums[0] += weight * (f64::from(column) + 0.5);
        sums[1] += weight * (f64::from(row) + 0.5);
        sums[2] += weight;
    }
    [sums[0] / sums[2], sums[1] / sums[2]]
}

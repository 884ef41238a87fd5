//! The page, as a browser would take it.

use super::*;
use crate::{
    calibration::{Lenses, Mounts, Shutters},
    evaluate::ViewFigures,
    gaussians::{background::Mode, motion::Motion},
    photometry::Colours,
    pipeline::{GaussianCounts, StageTimes},
    recipe::Recipe,
    render::DrawnOn,
    report::{Config, METRICS_FORMAT, MovingShares, RoleMeans, ViewRecord},
};

fn view(frame: usize, role: Role, psnr: Option<f64>) -> ViewRecord {
    let camera = "<front> & \"rear\"".to_owned();
    ViewRecord { frame, camera, role, figures: ViewFigures { psnr, ..ViewFigures::default() } }
}

fn metrics(views: Vec<ViewRecord>) -> Metrics {
    Metrics {
        format: METRICS_FORMAT,
        clip: "</title><script>alert(1)</script>".to_owned(),
        config: Config {
            cameras: vec!["<front> & \"rear\"".to_owned()],
            image_size: Some([60, 100]),
            frames: vec![0, 1, 2],
            hold_out: vec![1],
            motion: Motion::Registered,
            lenses: Lenses::Auto,
            mounts: Mounts::Auto,
            shutters: Shutters::Auto,
            colours: Colours::Auto,
            reference_camera: None,
            recipe: Recipe::initial(Mode::Auto.into()),
            views: "all".to_owned(),
            at_time: None,
            lpips_weights: None,
        },
        weights: None,
        threads: 2,
        drawn_on: DrawnOn { device: "CPU".to_owned(), refused: Vec::new() },
        seed: 0,
        budget: None,
        gaussians: GaussianCounts { initial: 1200, last: 1200, background: 34, ..GaussianCounts::default() },
        moving: MovingShares { lidar: Some(0.0375), background: None },
        network: None,
        optimisation: None,
        depth_maps: Vec::new(),
        lidar_turn: None,
        lidar_stamp: None,
        lenses: None,
        calibration: None,
        mounts: None,
        photometry: None,
        dropped_returns: None,
        stages_s: StageTimes::default(),
        reconstruction_s: 0.5,
        peak_rss_mb: None,
        mean: RoleMeans::of(&views),
        views,
    }
}

fn page(metrics: &Metrics) -> String {
    let kinds = [PictureKind::Truth, PictureKind::Render];
    let pictures = PageView { size: [100, 60], pictures: kinds.map(|kind| (kind, vec![1, 2, 3])).to_vec() };
    let views = vec![pictures; metrics.views.len()];
    let notes = ["calibration: <front>: turned".to_owned()];
    let page = Page {
        metrics,
        views: &views,
        source: "a 'lab'",
        licence: "<CC>",
        command: "lgs-infer '<clip>'",
        notes: &notes,
    };
    html(&page)
}

#[test]
fn names_from_the_clip_stay_text_and_nothing_is_loaded_from_elsewhere() {
    let page = page(&metrics(vec![view(1, Role::HeldOut, Some(17.0))]));
    for markup in ["<script", "<front>", "\"rear\"", "<CC>", "<clip>"] {
        assert!(!page.contains(markup), "{markup}");
    }
    for outside in ["http:", "https:", "href=", "url(", "@import"] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert_eq!(page.matches("<title>").count(), 1);
    assert!(page.contains("<li><b>calibration</b>: &lt;front&gt;: turned</li>"));
    assert!(
        page.contains("&lt;front&gt; &amp; &quot;rear&quot;") && page.contains("src=\"data:image/jpeg;base64,AQID\"")
    );
}

#[test]
fn held_out_views_come_first_and_inputs_are_folded_behind_them() {
    let (held_out, input) = (view(1, Role::HeldOut, Some(17.0)), view(0, Role::Input, Some(f64::INFINITY)));
    let both = page(&metrics(vec![input.clone(), held_out.clone()]));
    assert!(both.find("Held-out views").unwrap() < both.find("<details>").unwrap());
    assert!(both.find("<details>").unwrap() < both.find("Input views").unwrap());
    assert!(both.contains("<td>17.00</td>") && both.contains("<td>∞</td>"));
    let alone = page(&metrics(vec![input]));
    assert!(alone.contains("Input views") && !alone.contains("<details>") && !alone.contains("Held-out views"));
}

#[test]
fn what_was_not_measured_takes_no_place() {
    let measured = page(&metrics(vec![view(1, Role::HeldOut, Some(17.0))]));
    assert!(measured.contains("PSNR (dB)") && !measured.contains("LPIPS ↓"));
    let unmeasured = page(&metrics(vec![view(1, Role::HeldOut, None)]));
    assert!(!unmeasured.contains("<table>") && unmeasured.contains("<img "));
    assert!(!page(&metrics(Vec::new())).contains("class=\"legend\""));
}

#[test]
fn copying_stands_beside_psnr_where_it_is_known() {
    let known = page(&metrics(vec![copied(view(1, Role::HeldOut, Some(17.0)), 12.5)]));
    assert!(known.contains("<th>PSNR (dB) ↑</th><th>copying (dB)</th>"));
    assert!(
        known.contains("<td>17.00</td><td>12.50</td>") && known.contains("Copying: PSNR of the nearest input image")
    );
    let unknown = page(&metrics(vec![view(1, Role::HeldOut, Some(17.0))]));
    assert!(!unknown.to_lowercase().contains("copying"));
}

#[test]
fn the_share_that_moves_is_told() {
    let page = page(&metrics(vec![view(1, Role::HeldOut, Some(17.0))]));
    assert!(page.contains("3.75 % of those from LiDAR, – of the background: faster than 0.5 m/s"));
}

fn copied(view: ViewRecord, psnr_copying: f64) -> ViewRecord {
    ViewRecord { figures: ViewFigures { psnr_copying: Some(psnr_copying), ..view.figures }, ..view }
}

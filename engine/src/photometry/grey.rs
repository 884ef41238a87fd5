//! Grey cameras beside colour ones: they say where, not which colour.

use crate::views::{Response, View};

/// Largest difference of the channels of a pixel of a grey image: lossy compression.
const TINT: f32 = 6.0 / 255.0;
/// Pixels that are looked at: every so many.
const STRIDE: usize = 7;
/// Share of its pixels that may be more colourful.
const COLOURED: f64 = 0.001;
/// Share of the returns before a grey camera that colour cameras must see, so that nothing is lost without it.
const SEEN: f64 = 0.8;

/// The grey cameras' views, taken out of `views`, where colour cameras see what they see; they show common colours as brightness. None are
/// taken where all are grey.
pub(crate) fn put_aside(views: &mut Vec<View>) -> Vec<View> {
    let mut cameras: Vec<(String, bool)> = Vec::new();
    for view in views.iter() {
        match cameras.iter_mut().find(|(name, _)| *name == view.camera) {
            Some((_, grey)) => *grey &= is_grey(view),
            None => cameras.push((view.camera.clone(), is_grey(view))),
        }
    }
    if cameras.iter().all(|(_, grey)| *grey) || !cameras.iter().any(|(_, grey)| *grey) {
        return Vec::new();
    }
    let is_of_grey = |view: &View| cameras.iter().any(|(name, grey)| *grey && *name == view.camera);
    let colour: Vec<&View> = views.iter().filter(|view| !is_of_grey(view)).collect();
    let is_spare = |name: &str| seen(views.iter().filter(|view| view.camera == name), &colour) >= SEEN;
    let spare: Vec<&str> =
        cameras.iter().filter(|(name, grey)| *grey && is_spare(name)).map(|(name, _)| name.as_str()).collect();
    let (mut aside, kept): (Vec<View>, Vec<View>) =
        std::mem::take(views).into_iter().partition(|view| spare.contains(&view.camera.as_str()));
    *views = kept;
    aside.iter_mut().for_each(|view| view.response = Some(Response::GREY));
    aside
}

fn is_grey(view: &View) -> bool {
    let pixels = view.image.data.as_chunks::<3>().0.iter().step_by(STRIDE);
    let count = pixels.len() as f64;
    let tinted = |pixel: &&[f32; 3]| {
        pixel.iter().copied().fold(0.0, f32::max) - pixel.iter().copied().fold(1.0, f32::min) > TINT
    };
    pixels.filter(tinted).count() as f64 <= COLOURED * count
}

/// The share of the returns in some views that others of the same frame show.
fn seen<'a>(of: impl Iterator<Item = &'a View>, by: &[&View]) -> f64 {
    let (mut count, mut shown) = (0_usize, 0_usize);
    for view in of {
        for place in view.returns() {
            count += 1;
            let shows = |other: &&&View| other.frame == view.frame && other.pinhole.project(place).is_some();
            shown += usize::from(by.iter().any(|other| shows(&other)));
        }
    }
    if count == 0 { 0.0 } else { shown as f64 / count as f64 }
}

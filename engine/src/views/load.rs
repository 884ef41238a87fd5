//! Views from a clip directory.

use lgs_formats::{camera_motion::CameraMotion, clip_dir::ClipDir, sweep::Sweep};

use super::{ClipFrame, DepthSample, PinholeView, Role, Selection, Shutter, View, selection::SelectedImage, strays};
use crate::error::{EngineError, Result};
use crate::parallel;

/// Returns that a thread projects at once.
const GRAIN: usize = 1024;

/// The selected views of one role: frame by frame, cameras in the clip's order; `progress` is called once per view. No
/// file of a frame of the other role is opened.
///
/// # Errors
/// Those of [`Selection::frames`], a camera that the clip does not have, and whatever is wrong with a file.
pub(crate) fn load_views(
    dir: &ClipDir,
    selection: &Selection,
    role: Role,
    frame: &ClipFrame,
    progress: &(dyn Fn() + Sync),
) -> Result<Vec<View>> {
    let images = selection.images(dir.clip())?;
    let images: Vec<&SelectedImage> = images.iter().filter(|image| image.role == role).collect();
    let load = |i: usize| {
        let view = load_view(dir, images[i], selection, frame);
        progress();
        view
    };
    parallel::map(images.len(), 1, &load).into_iter().collect()
}

fn load_view(dir: &ClipDir, image: &SelectedImage, selection: &Selection, frame: &ClipFrame) -> Result<View> {
    let loaded = dir.load_image(image.frame, image.camera, selection.image_size)?;
    let shutter = loaded.moments.map(|moments| {
        let motion = CameraMotion::of(dir.clip(), image.frame, image.camera);
        let size = [loaded.rgb.width, loaded.rgb.height];
        Shutter::new(moments, size, &motion, &loaded.camera.world_from_camera)
    });
    let pinhole = PinholeView { shutter, ..frame.pinhole(&loaded.camera) };
    let depth_map = match image.role {
        Role::Input => dir.load_depth(image.frame, image.camera, selection.image_size)?,
        Role::HeldOut => None,
    };
    let sweep = dir.load_sweep(image.frame)?;
    let points = frame.points(&dir.clip().frames[image.frame].lidar.world_from_lidar, &sweep.points);
    let points = surfaces(&pinhole, &points, &sweep)?;
    Ok(View {
        frame: image.frame,
        camera: loaded.camera.name,
        role: image.role,
        pinhole,
        image: loaded.rgb,
        response: None,
        labels: loaded.labels,
        depth_map,
        depth_samples: depth_samples(&pinhole, &points)?,
    })
}

/// The returns of a sweep that project into a view and are surfaces, as far as the others that do tell: metres, clip frame, as `points` are.
///
/// # Errors
/// When a coordinate is not finite.
fn surfaces(view: &PinholeView, points: &[[f32; 3]], sweep: &Sweep) -> Result<Vec<[f32; 3]>> {
    let seen = parallel::filter_map(points.len(), GRAIN, &|i| view.project(points[i]).map(|_| i));
    let origin = |&i: &usize| sweep.origins.as_ref().map_or([0.0; 3], |origins| origins[i]);
    let own: Vec<[f32; 3]> = seen.iter().map(|&i| sweep.points[i]).collect();
    let strays = strays(&own, &seen.iter().map(origin).collect::<Vec<_>>())?;
    let is_surface = |m: u32| strays.binary_search_by_key(&m, |&(stray, _)| stray).is_err();
    Ok((0..).zip(seen).filter(|&(m, _)| is_surface(m)).map(|(_, i)| points[i]).collect())
}

/// The nearest of `points` (metres, clip frame) in every pixel that one projects to, ascending by pixel.
///
/// # Errors
/// [`EngineError::Setting`] for an image with more pixels than a u32 can count.
pub(crate) fn depth_samples(view: &PinholeView, points: &[[f32; 3]]) -> Result<Vec<DepthSample>> {
    if u32::try_from(view.num_pixels()).is_err() {
        let found = format!("{}x{}", view.height, view.width);
        return Err(EngineError::Setting {
            setting: "image-size",
            expected: "fewer than 2^32 pixels".to_owned(),
            found,
        });
    }
    let mut nearest = vec![f32::INFINITY; view.num_pixels()]; // [H, W]
    for at in parallel::filter_map(points.len(), GRAIN, &|i| view.project(points[i])) {
        let cell = &mut nearest[at.pixel(view.width)];
        *cell = cell.min(at.depth);
    }
    let hits = (0..).zip(nearest).filter(|(_, depth)| depth.is_finite());
    Ok(hits.map(|(pixel, depth)| DepthSample { pixel, depth }).collect())
}

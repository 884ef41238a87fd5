//! The Gaussians on the GPU, and their projection to the image: footprints, which are visible, and how many tiles each touches.
//!
//! What is in f64 on the CPU is in f32 here; `projection.wgsl` says how it stays exact enough.

use bytemuck::{Pod, Zeroable};
use glam::{DVec2, DVec3};
use lgs_formats::casts::{to_f32, to_u32};
use wgpu::Buffer;

use super::super::project::Projector;
use super::super::tiles::TileGrid;
use super::error::GpuError;
use super::kernels::{Kernel, ROW};
use super::work::{Work, groups_over};
use crate::gaussians::physical::Splat;
use crate::parallel;
use crate::views::PinholeView;

pub(super) const PROJECTION: &str = include_str!("projection.wgsl");
pub(super) const REACH: &str = include_str!("reach.wgsl");
const PROJECT: Kernel = Kernel::new("project_all", &[PROJECTION, REACH, include_str!("project.wgsl")]);

/// Vectors of four that hold a Gaussian's mean and time, quaternion, scale and opacity.
const SHAPE: usize = 3;
/// Vectors of four that hold its colour and its velocity.
const LOOK: usize = 2;
/// Vectors of four of a footprint.
const FOOTPRINT: usize = 4;

/// A scene on the GPU, with the rows that its gradients are summed in.
#[derive(Clone, Debug)]
pub(crate) struct SceneBuffers {
    /// `[N, 3, 4]`: mean and time, quaternion, scale and opacity.
    pub(crate) shapes: Buffer,
    /// `[N, 2, 4]`: colour, velocity.
    pub(crate) looks: Buffer,
    /// `[N, ROW]`.
    pub(crate) gradients: Buffer,
    /// Gaussians.
    pub(crate) len: usize,
}

/// A camera as the kernels read it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Camera {
    rows: [[f32; 4]; 3],
    centre: [f32; 4],
    centre_rest: [f32; 4],
    lens: [f32; 4],
    limits: [f32; 4],
    moments: [f32; 4],
    moment_limits: [f32; 4],
    turn: [f32; 4],
    drift: [f32; 4],
    /// Width, height, columns and rows of tiles.
    pub(super) size: [u32; 4],
    /// Gaussians; visible ones.
    pub(super) count: [u32; 4],
}

/// What projection made: footprints, places of the visible, counts of tiles.
#[derive(Debug)]
pub(super) struct Projection {
    pub(super) camera: Camera,
    pub(super) footprints: Buffer,
    /// `[2, N + 1]` sums over the Gaussians before each: of the visible, then of the tiles that each touches.
    pub(super) places: Buffer,
    pub(super) num_visible: u32,
    pub(super) num_intersections: u32,
}

impl Camera {
    fn of(view: &PinholeView, num_splats: u32) -> Self {
        let projector = Projector::new(view);
        let centre = -(projector.rotation.inverse() * projector.translation);
        let high = centre.to_array().map(to_f32);
        let rest = centre - DVec3::from_array(high.map(f64::from));
        let four = |[x, y, z]: [f32; 3], w: f32| [x, y, z, w];
        let pairs = |a: DVec2, b: DVec2| [a.x, a.y, b.x, b.y].map(to_f32);
        let grid = TileGrid::of(view);
        let mut camera = Self {
            rows: view.camera_from_clip.map(|[x, y, z, _]| [x, y, z, 0.0]),
            centre: four(high, view.time),
            centre_rest: four(rest.to_array().map(to_f32), to_f32(projector.blur)),
            lens: pairs(projector.focal, projector.centre),
            limits: pairs(projector.limits_min, projector.limits_max),
            moments: [0.0; 4],
            moment_limits: [0.0; 4],
            turn: [0.0; 4],
            drift: [0.0; 4],
            size: [view.width, view.height, grid.columns, grid.rows].map(to_u32),
            count: [num_splats, 0, 0, 0],
        };
        if let Some(shutter) = &view.shutter {
            camera.moments = [shutter.first, shutter.by_pixel.x, shutter.by_pixel.y, 1.0].map(to_f32);
            camera.moment_limits = [shutter.limits[0], shutter.limits[1], 0.0, 0.0].map(to_f32);
            camera.turn = four(shutter.turn.to_array().map(to_f32), 0.0);
            camera.drift = four(shutter.drift.to_array().map(to_f32), 0.0);
        }
        camera
    }
}

impl Work<'_> {
    /// The Gaussians on the GPU, their rows of gradients zero.
    ///
    /// # Errors
    /// As [`Work::buffer`].
    pub(crate) fn load(&mut self, splats: &[Splat]) -> Result<SceneBuffers, GpuError> {
        let shapes: Vec<[[f32; 4]; SHAPE]> = parallel::map(splats.len(), 1, &|i| {
            let s = &splats[i];
            let ([x, y, z], [a, b, c]) = (s.mean, s.scale);
            [[x, y, z, s.time], s.quat, [a, b, c, s.opacity]]
        });
        let looks: Vec<[[f32; 4]; LOOK]> = parallel::map(splats.len(), 1, &|i| {
            let ([r, g, b], [x, y, z]) = (splats[i].colour, splats[i].velocity);
            [[r, g, b, 0.0], [x, y, z, 0.0]]
        });
        let (shapes, looks) = (self.upload("shapes", &shapes)?, self.upload("looks", &looks)?);
        let gradients = self.rows("gradients", splats.len())?;
        Ok(SceneBuffers { shapes, looks, gradients, len: splats.len() })
    }

    /// Room for a scene whose Gaussians a kernel makes, their rows of gradients zero.
    ///
    /// # Errors
    /// As [`Work::buffer`].
    pub(crate) fn scene(&mut self, len: usize) -> Result<SceneBuffers, GpuError> {
        Ok(SceneBuffers {
            shapes: self.buffer::<[[f32; 4]; SHAPE]>("shapes", len)?,
            looks: self.buffer::<[[f32; 4]; LOOK]>("looks", len)?,
            gradients: self.rows("gradients", len)?,
            len,
        })
    }

    /// Rows of gradients of `len` Gaussians, zero.
    ///
    /// # Errors
    /// As [`Work::buffer`].
    pub(crate) fn rows(&mut self, name: &'static str, len: usize) -> Result<Buffer, GpuError> {
        let rows = self.buffer::<[f32; ROW]>(name, len)?;
        self.clear::<[f32; ROW]>(&rows, len);
        Ok(rows)
    }

    /// Projects a scene; waits for the counts.
    pub(super) fn project(&mut self, scene: &SceneBuffers, view: &PinholeView) -> Result<Projection, GpuError> {
        let len = to_u32(scene.len);
        let mut camera = Camera::of(view, len);
        let footprints = self.buffer::<[[f32; 4]; FOOTPRINT]>("footprints", scene.len)?;
        let places = self.buffer::<[u32; 2]>("places of the visible", scene.len + 1)?;
        let told = self.tell(&camera);
        let bindings = [(1, &scene.shapes), (2, &scene.looks), (3, &footprints), (4, &places)];
        self.run(&PROJECT, &[&told], &bindings, groups_over(len + 1));
        // One list, so that its sums are taken at once.
        super::sort::scan(self, &places, 2 * (len + 1))?;
        let sums = self.read_pieces::<u32>(&[(&places, scene.len), (&places, 2 * scene.len + 1)], 1)?;
        let (num_visible, num_intersections) = (sums[0], sums[1] - sums[0]);
        camera.count[1] = num_visible;
        Ok(Projection { camera, footprints, places, num_visible, num_intersections })
    }
}

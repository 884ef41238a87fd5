//! Steps on a GPU: parameters, moments and gradients stay there, and a step brings back its sums alone.

use std::time::Instant;

use bytemuck::{Pod, Zeroable};
use lgs_formats::casts::{to_f32, to_u32};

use super::pace::{BETA_2, EPSILON, Pace};
use super::{Adam, AdamSettings, Memory, VARIABLES};
use crate::gaussians::physical::{MAX_SCALE, MIN_SCALE, most_behind};
use crate::gaussians::{GaussianSet, NUM_ATTRIBUTES};
use crate::loss::{Kept, LossWeights};
use crate::objective::{ObjectiveSeconds, gpu, mean_over};
use crate::render::gpu::{Gpu, GpuError, Kernel, Owned, Work, count, groups_over, single};
use crate::views::View;

const SOURCES: &[&str] = &[include_str!("adam.wgsl")];
const SHOW_RAW: Kernel = Kernel::with("show_raw", SOURCES, constants);
const DESCEND_RAW: Kernel = Kernel::with("descend_raw", SOURCES, constants);

/// Bytes of a Gaussian's parameters, time, moments and count of steps.
const BYTES_OF_SPLAT: u64 = ((3 * VARIABLES + 2) * size_of::<f32>()) as u64;

/// What a step is told.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Step {
    size: [u32; 4],
    decays: [f32; 4],
    more: [f32; 4],
    rates: [f32; 20],
}

/// A scene and its moments on a GPU.
#[derive(Debug)]
pub(super) struct There {
    gpu: &'static Gpu,
    raw: Owned,
    times: Owned,
    /// First and second ones.
    moments: [Owned; 2],
    counts: Owned,
    num_lidar: usize,
    len: usize,
    /// Spoiled gradients when the scene was last the same here; `None` where it still is.
    before: Option<usize>,
}

impl<'v> Adam<'v> {
    /// The loss over the `chosen` of the views before a step on the GPU; `None` where it is not made there, and `set` is then what the step begins
    /// with.
    pub(super) fn step_there(&mut self, set: &mut GaussianSet, views: &[&'v View], chosen: &[&'v View]) -> Option<f64> {
        self.know_paces();
        let step = self.settings.device.try_gpu(|gpu| {
            let mut work = gpu.work()?;
            let there = match self.there.take() {
                Some(there) => there,
                None => There::begin(gpu, &mut work, set, &self.memory, views)?,
            };
            let there = self.there.insert(there);
            there.step(&mut work, &self.settings, &self.paces, chosen, &mut self.kept)
        });
        let Some((loss, spoiled, seconds)) = step else {
            self.settle_there(set);
            self.there = None;
            return None;
        };
        if let Some(there) = &mut self.there {
            there.before.get_or_insert(self.summary.non_finite_gradients);
        }
        self.ahead.push(chosen.to_vec());
        self.summary.seconds.add(seconds);
        self.summary.non_finite_gradients += spoiled;
        Some(loss)
    }

    /// Reads scene and moments; where that fails, makes the steps here that were made there since they were last read.
    pub(super) fn settle_there(&mut self, set: &mut GaussianSet) {
        let ahead = std::mem::take(&mut self.ahead);
        let Some(there) = &mut self.there else { return };
        let Some(spoiled) = there.before.take() else { return };
        let memory = &mut self.memory;
        if self.settings.device.try_gpu(|_| there.read(set, memory)).is_some() {
            return;
        }
        self.there = None;
        self.summary.non_finite_gradients = spoiled;
        for chosen in ahead {
            self.step_here(set, &chosen);
        }
    }
}

impl There {
    /// Brings a scene there.
    fn begin(
        gpu: &'static Gpu,
        work: &mut Work<'_>,
        set: &GaussianSet,
        memory: &Memory,
        views: &[&View],
    ) -> Result<Self, GpuError> {
        gpu::expect(work, set.len(), views, BYTES_OF_SPLAT)?;
        let rows = set.attributes.iter().zip(&set.velocities);
        let raw: Vec<f32> = rows.flat_map(|(row, velocity)| row.iter().chain(velocity)).copied().collect();
        let moment =
            |which: usize| -> Vec<f32> { memory.moments.as_flattened().iter().map(|pair| pair[which]).collect() };
        Ok(Self {
            gpu,
            raw: work.own("raw parameters", &raw)?,
            times: work.own("times", &set.times)?,
            moments: [work.own("first moments", &moment(0))?, work.own("second moments", &moment(1))?],
            counts: work.own("counts of steps", &memory.counts)?,
            num_lidar: set.num_lidar,
            len: set.len(),
            before: None,
        })
    }

    /// The loss before a step, how many gradients were spoiled, and what it took.
    fn step<'v>(
        &self,
        work: &mut Work<'_>,
        settings: &AdamSettings,
        paces: &[Pace],
        views: &[&'v View],
        kept: &mut Kept<'v>,
    ) -> Result<(f64, usize, ObjectiveSeconds), GpuError> {
        let start = Instant::now();
        let weights = LossWeights::default();
        let scene = work.scene(self.len)?;
        let slope = f64::from(weights.velocity) / self.num_lidar.max(1) as f64;
        let told = work.tell(&told([self.len, self.num_lidar], settings, paces, slope));
        let num_groups = groups_over(to_u32(self.len));
        let bindings = [(1, self.raw.buffer()), (2, self.times.buffer()), (3, &scene.shapes), (4, &scene.looks)];
        work.run(&SHOW_RAW, &[&told], &bindings, num_groups);
        let losses = gpu::descend(work, &scene, views, &weights, kept)?;
        // The last that can fail comes before the step: what fails leaves the scene as it was.
        let sums = work.buffer::<[f32; 2]>("sums of steps", num_groups as usize)?;
        let terms = losses.terms(work)?;
        let paces: Vec<[f32; 2]> = paces.iter().map(of_pace).collect();
        let paces = work.upload("paces of steps", &paces)?;
        let bindings = [
            (1, self.raw.buffer()),
            (5, &scene.gradients),
            (6, self.moments[0].buffer()),
            (7, self.moments[1].buffer()),
            (8, &sums),
            (9, self.counts.buffer()),
            (10, &paces),
        ];
        work.run(&DESCEND_RAW, &[&told], &bindings, num_groups);
        let sums = work.read::<[f32; 2]>(&sums, 0, num_groups as usize)?;
        let speed: f64 = sums.iter().map(|sum| f64::from(sum[0])).sum();
        let spoiled: u32 = sums.iter().map(|sum| whole(sum[1])).sum();
        let loss = mean_over(&terms).0 + slope * speed;
        Ok((loss, spoiled as usize, ObjectiveSeconds { render: start.elapsed().as_secs_f64(), loss: None }))
    }

    /// Reads scene and moments: all of them or none.
    fn read(&self, set: &mut GaussianSet, memory: &mut Memory) -> Result<(), GpuError> {
        let mut work = self.gpu.work()?;
        let all = self.len * VARIABLES;
        let raw = work.read::<f32>(self.raw.buffer(), 0, all)?;
        let first = work.read::<f32>(self.moments[0].buffer(), 0, all)?;
        let second = work.read::<f32>(self.moments[1].buffer(), 0, all)?;
        memory.counts = work.read::<u32>(self.counts.buffer(), 0, self.len)?;
        let rows = set.attributes.iter_mut().zip(&mut set.velocities);
        for ((attributes, velocity), row) in rows.zip(raw.as_chunks::<VARIABLES>().0) {
            attributes.copy_from_slice(&row[..NUM_ATTRIBUTES]);
            velocity.copy_from_slice(&row[NUM_ATTRIBUTES..]);
        }
        let pairs = first.iter().zip(&second).map(|(&first, &second)| [first, second]);
        memory.moments.as_flattened_mut().iter_mut().zip(pairs).for_each(|(moment, pair)| *moment = pair);
        Ok(())
    }
}

fn told([len, num_lidar]: [usize; 2], settings: &AdamSettings, paces: &[Pace], slope: f64) -> Step {
    let beta_1 = paces.last().map_or(0.0, |pace| pace.beta_1);
    let mut rates = [0.0; 20];
    rates.iter_mut().zip(settings.rates.by_variable()).for_each(|(rate, usual)| *rate = to_f32(usual));
    Step {
        size: [to_u32(len), to_u32(num_lidar), 0, 0],
        decays: [to_f32(beta_1), to_f32(1.0 - beta_1), to_f32(BETA_2), to_f32(1.0 - BETA_2)],
        more: [to_f32(EPSILON), to_f32(slope), 0.0, 0.0],
        rates,
    }
}

/// What the first moment is multiplied by for a usual rate of 1, and the second.
fn of_pace(pace: &Pace) -> [f32; 2] {
    let [first, second] = pace.unbiased;
    [to_f32(pace.rate / first), to_f32(1.0 / second)]
}

/// A count of at most 256.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number from 0 to 256")]
fn whole(count: f32) -> u32 {
    count as u32
}

fn constants() -> String {
    single("SMALLEST_SCALE", MIN_SCALE)
        + &single("LARGEST_SCALE", MAX_SCALE)
        + &single("LARGEST_BEHIND", most_behind())
        + &count("VARIABLES", VARIABLES)
}

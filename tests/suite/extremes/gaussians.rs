//! Parameters of Gaussians at the ends of what f32 holds.

use lgs_engine::export::{Shown, to_cloud};
use lgs_engine::gaussians::physical::{Splat, to_physical};
use lgs_engine::gaussians::{GaussianSet, LOG_SCALE, LOGIT_COLOUR, LOGIT_OPACITY, MEAN, NUM_ATTRIBUTES, QUAT};
use lgs_engine::refine::refine;
use lgs_engine::render::reference::{self, Camera, Gaussian, fragile_pixels};
use lgs_tests::Outcome;
use lgs_tests::compare::{absolute, close_where, same_bits, widened};
use lgs_tests::weights::{Heads, SMALL, Weights};

use super::tiny::{AHEAD, drawn, drawn_splats, noise, set_of, sphere};
use super::{Extreme, ensure};

pub(super) const CASES: &[Extreme] = &[
    Extreme::new("log_scale_plus_80", "log-scales of 80 in the LiDAR branch", "the image of scale 1 m, the upper clamp; no gradient by the scale", || {
        clamped(80.0, 0.0)
    }),
    Extreme::new("log_scale_minus_80", "log-scales of -80", "the image of scale 1e-4 m, the lower clamp", || clamped(-80.0, 1e-4_f32.ln())),
    Extreme::new("background_log_scale_plus_80", "a background Gaussian, which has no upper clamp, of log-scale 80", "a finite image, covered evenly: squares may not overflow", covers_the_image),
    Extreme::new("anisotropy_1e8", "scales of 1e-4, 1e-4 and 1e4 m", "the image of the f64 twin (1e-4 off its thresholds): the determinant is a sum of squares, not a difference", anisotropy),
    Extreme::new("quaternion_zero", "a quaternion of zeros", "the image of the identity; no gradient by it", || quaternion([0.0; 4], [1.0, 0.0, 0.0, 0.0])),
    Extreme::new("quaternion_1e_30", "a quaternion of length 1e-30", "the image of its direction: f64 squares hold it", || {
        quaternion([1e-30, 1e-30, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0])
    }),
    Extreme::new("quaternion_1e30", "a quaternion of length 1e30", "the image of its direction", || {
        quaternion([1e30, 1e30, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0])
    }),
    Extreme::new("opacity_logit_plus_200", "an opacity logit of 200", "alpha is cut at 0.999; finite gradients", || {
        opacity(200.0, 0.999)
    }),
    Extreme::new("opacity_logit_minus_200", "an opacity logit of -200", "nothing is drawn", || opacity(-200.0, 0.0)),
    Extreme::new("colour_logit_200", "colour logits of 200 and -200", "colours 1 and 0 exactly, finite gradients", colours),
    Extreme::new("twenty_thousand_opaque_on_one_pixel", "20,000 opaque Gaussians on one line of sight", "the image of the first few: the pixel ends, sums stay finite", many_opaque),
    Extreme::new("far_below_a_pixel", "a Gaussian of 1e-4 m at 1e5 m", "the 0.3 px^2 of blur alone, as the twin draws it", far_below_a_pixel),
    Extreme::new("at_the_near_plane", "Gaussians at 0.0101 m, of 1 m size", "finite image and gradients", near_plane),
    Extreme::new("at_the_largest_float", "means, velocities and times of 3e38", "not drawn where they lead out of the image, finite where straight ahead; nothing spoilt", largest_float),
    Extreme::new("not_finite_in_each_attribute_is_not_drawn", "NaN and both infinities in each of the 18 values in turn", "not drawn; all others keep their bits", not_drawn),
    Extreme::new("not_finite_in_each_attribute_is_not_written", "the same on the way to a file", "an error that names the Gaussian and the attribute", not_written),
    Extreme::new("not_finite_in_each_attribute_is_not_refined", "the same on the way into the refinement", "an error that names the Gaussian and the attribute, the scene untouched", not_refined)
        .mended("a NaN velocity made the loss NaN, and every step of all others was taken back without a word: now the refinement checks what it is given"),
];

fn clamped(log_scale: f32, same_as: f32) -> Outcome {
    let with = |s: f32| {
        let mut row = sphere();
        row[LOG_SCALE].fill(s);
        drawn(&set_of(vec![row], 1))
    };
    same_bits("rgb", &with(log_scale)?.rgb, &with(same_as)?.rgb)
}

fn covers_the_image() -> Outcome {
    let mut row = sphere();
    row[LOG_SCALE].fill(80.0);
    let image = drawn(&set_of(vec![row], 0))?;
    ensure(image.alpha.iter().all(|a| (a - 0.5).abs() < 1e-3), || format!("alpha {:?}", &image.alpha[..5]))
}

/// The camera of these cases for the twin.
fn camera() -> Camera {
    Camera {
        width: AHEAD.width,
        height: AHEAD.height,
        fx: f64::from(AHEAD.fx),
        fy: f64::from(AHEAD.fy),
        cx: f64::from(AHEAD.cx),
        cy: f64::from(AHEAD.cy),
        camera_from_world: AHEAD.camera_from_clip.map(|row| row.map(f64::from)),
        time: 0.0,
    }
}

/// Fails unless the twin draws the same.
fn as_the_twin(splats: &[Splat], tolerance: f64) -> Outcome {
    let gaussian = |s: &Splat| Gaussian {
        mean: s.mean.map(f64::from),
        quat: s.quat.map(f64::from),
        scale: s.scale.map(f64::from),
        opacity: f64::from(s.opacity),
        colour: s.colour.map(f64::from),
        velocity: s.velocity.map(f64::from),
        time: f64::from(s.time),
    };
    let gaussians: Vec<Gaussian> = splats.iter().map(gaussian).collect();
    let want = reference::render(&gaussians, &camera(), [0.25, 0.5, 0.125]);
    let skip = fragile_pixels(&gaussians, &camera(), 1e-3);
    let (image, _) = drawn_splats(splats)?;
    ensure(image.alpha.iter().any(|&a| a > 0.0), || "nothing is drawn".to_owned())?;
    close_where("rgb", &widened(&image.rgb), &want.rgb, absolute(tolerance), |i| !skip[i / 3])
}

fn anisotropy() -> Outcome {
    let mut row = sphere();
    row[QUAT].copy_from_slice(&[0.9, 0.1, 0.3, 0.2]);
    row[LOG_SCALE].copy_from_slice(&[1e-4_f32.ln(), 1e4_f32.ln(), 1e-4_f32.ln()]);
    as_the_twin(&to_physical(&set_of(vec![row], 0)), 1e-4)
}

fn quaternion(quat: [f32; 4], same_as: [f32; 4]) -> Outcome {
    let with = |q: [f32; 4]| {
        let mut splat = to_physical(&set_of(vec![sphere()], 1))[0];
        (splat.quat, splat.scale) = (q, [0.5, 0.1, 0.02]);
        drawn_splats(&[splat])
    };
    let ((got, gradients), (want, _)) = (with(quat)?, with(same_as)?);
    ensure(quat != [0.0; 4] || gradients[0].quat == [0.0; 4], || format!("{:?}", gradients[0].quat))?;
    close_where("rgb", &widened(&got.rgb), &widened(&want.rgb), absolute(1e-6), |_| true)
}

fn opacity(logit: f32, most: f32) -> Outcome {
    let mut row = sphere();
    row[LOGIT_OPACITY] = logit;
    let image = drawn(&set_of(vec![row], 1))?;
    let largest = image.alpha.iter().copied().fold(0.0, f32::max);
    ensure((largest - most).abs() < 1e-3, || format!("alpha {largest}"))
}

fn colours() -> Outcome {
    let mut row = sphere();
    row[LOGIT_OPACITY] = 200.0;
    row[LOGIT_COLOUR].copy_from_slice(&[200.0, -200.0, 0.0]);
    let set = set_of(vec![row], 1);
    drawn(&set)?;
    let colour = to_physical(&set)[0].colour;
    ensure(colour == [1.0, 0.0, 0.5], || format!("{colour:?}"))
}

fn many_opaque() -> Outcome {
    let row = |k: u16| {
        let mut row = sphere();
        row[MEAN.end - 1] += 1e-4 * f32::from(k);
        row[LOGIT_OPACITY] = 200.0;
        row
    };
    let image_of = |count: u16| drawn(&set_of((0..count).map(row).collect(), usize::from(count)));
    let (all, few) = (image_of(20_000)?, image_of(200)?);
    let middle = (8 * AHEAD.width + 16) * 3;
    same_bits("the pixel", &all.rgb[middle..middle + 3], &few.rgb[middle..middle + 3])
}

fn far_below_a_pixel() -> Outcome {
    let mut row = sphere();
    row[MEAN.end - 1] = 1e5;
    row[LOG_SCALE].fill(1e-4_f32.ln());
    as_the_twin(&to_physical(&set_of(vec![row], 1)), 1e-5)
}

fn near_plane() -> Outcome {
    let row = |k: u16| {
        let mut row = sphere();
        row[MEAN].copy_from_slice(&[1e-3 * f32::from(k), 0.0, 0.0101]);
        row[LOG_SCALE].fill(0.0);
        row
    };
    drawn(&set_of((0..20).map(row).collect(), 20)).map(drop)
}

/// The value `column` of the 18 of a Gaussian: attributes, velocity, time.
fn set_value(set: &mut GaussianSet, i: usize, column: usize, value: f32) {
    match column {
        0..NUM_ATTRIBUTES => set.attributes[i][column] = value,
        14..17 => set.velocities[i][column - NUM_ATTRIBUTES] = value,
        _ => set.times[i] = value,
    }
}

fn largest_float() -> Outcome {
    let want = drawn(&set_of(vec![sphere()], 1))?;
    let with = |column: usize| {
        let mut set = set_of(vec![sphere(), sphere()], 2);
        (set.velocities[1], set.times[1]) = ([1.0; 3], -0.5);
        set_value(&mut set, 1, column, 3e38);
        drawn(&set)
    };
    for column in [0, 1, 14, 17] {
        same_bits(&format!("rgb with value {column} at 3e38"), &with(column)?.rgb, &want.rgb)?;
    }
    // Straight ahead it is a dot, however far.
    [2, 16].into_iter().try_for_each(|column| with(column).map(drop))
}

const SPOILT: [f32; 3] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];

/// Names of the 18 values in errors.
fn name_of(column: usize) -> &'static str {
    let names = ["mean", "quaternion", "log scale", "opacity logit", "colour logit", "velocity", "time"];
    names[[3, 7, 10, 11, 14, 17].iter().filter(|&&end| column >= end).count()]
}

fn not_drawn() -> Outcome {
    let (set, _) = noise(40, 3);
    let mut others = set.clone();
    others.attributes.remove(7);
    others.times.remove(7);
    others.frames.remove(7);
    others.velocities.remove(7);
    others.num_lidar -= 1;
    let want = drawn(&others)?;
    for (column, value) in (0..18).flat_map(|c| SPOILT.map(|v| (c, v))) {
        // An infinite log-scale is the clamp, infinite logits are 0 and 1: they have a physical value.
        if value.is_infinite() && (7..14).contains(&column) {
            continue;
        }
        let mut spoilt = set.clone();
        set_value(&mut spoilt, 7, column, value);
        same_bits(&format!("rgb with {value} in {} ({column})", name_of(column)), &drawn(&spoilt)?.rgb, &want.rgb)?;
    }
    Ok(())
}

fn not_written() -> Outcome {
    each_is_named(|set| to_cloud(set, None, Shown::AS_IT_IS).map(drop).map_err(|e| e.to_string()))
}

fn not_refined() -> Outcome {
    let model = Weights::seeded(SMALL, 5, Heads { residuals: 1e-3, scores: 0.0 })?.model()?;
    let (_, view) = noise(20, 4);
    each_is_named(|set| {
        let before = format!("{set:?}");
        let said = refine(set, &[&view], &model, 1, || ()).map(drop).map_err(|e| e.to_string());
        if format!("{set:?}") == before { said } else { Err("the scene was changed".to_owned()) }
    })
}

fn each_is_named(act: impl Fn(&mut GaussianSet) -> Result<(), String>) -> Outcome {
    for (column, value) in (0..18).flat_map(|c| SPOILT.map(|v| (c, v))) {
        let (mut set, _) = noise(20, 4);
        set_value(&mut set, 7, column, value);
        let want = format!("Gaussian 7, {}: expected a finite value, found {value}", name_of(column));
        let said = act(&mut set).err().unwrap_or_default();
        ensure(said == want, || format!("it said {said:?}, want {want:?}"))?;
    }
    Ok(())
}

//! `README.md`, the table of the cases, compared with the cases.

use std::fs;

use lgs_tests::sources::{project_files, rust_files};
use lgs_tests::{Outcome, places};

use super::{GROUPS, ensure};

/// Cases and unit tests elsewhere that hold a part of what this suite is for, and what they hold.
const ELSEWHERE: &[[&str; 2]] = &[
    ["cli::infer::epochs_and_map_coordinates_do_not_matter", "figures of a clip in map coordinates and epoch seconds"],
    [
        "render::fast::survives_any_floats",
        "any floats in any value of a Gaussian: images and gradients of the others keep their bits",
    ],
    ["render::fast::equal_depths_keep_their_order", "exact ties of depth"],
    ["render::fast::behind_the_camera_is_background", "Gaussians behind the camera and at the near plane"],
    ["render::fast::rigid_motion_does_not_matter", "rigid motion of Gaussians and camera"],
    ["render::fast::order_does_not_matter", "permutation of Gaussians"],
    ["network::policy::folded_is_trained::one_point::restart", "a cloud of one voxel, patches of one point"],
    ["network::policy::order_of_the_points_does_not_matter", "permutation of a cloud before the policy"],
    ["cli::densify::thresholds_at_their_ends", "theta 0 and 1 in a whole run"],
    ["cli::densify::budget_is_met", "budgets of 0, 1 and above N in a whole run"],
    ["targetgen::edges::one_primitive", "targets of a scene of one primitive"],
    ["targetgen::edges::spoilt_gaussian", "targets beside a Gaussian that is not finite"],
    ["targetgen::loss_scale::response_branch", "responses under the loss times 1e-6 and 1e6"],
    ["targetgen::interruptions::disk_full", "a full disk under a job of targets"],
    ["targetgen::interruptions::killed_at_30_moments", "a job of targets that is killed"],
    ["large_scores_do_not_overflow", "attention logits, forward and backward against the twin"],
    ["an_image_below_the_window_has_a_psnr_only", "figures of images below the window"],
    ["identical_images_are_infinitely_good", "PSNR of identical images"],
    ["a_view_that_is_ignored_everywhere_costs_nothing", "the loss of a view without a pixel"],
    ["a_count_is_compared_with_the_length_before_anything_is_allocated", "a PLY header that asks for a memory"],
];

/// The lines that the page's tables must hold.
fn lines() -> Vec<String> {
    let mut lines = Vec::new();
    for group in GROUPS {
        for case in group.cases {
            let verdict =
                case.mended.map_or_else(|| "holds".to_owned(), |how| format!("holds since it was mended: {how}"));
            lines.push(format!(
                "| `extremes::{}::{}` | {} | {} | {verdict} |",
                group.name, case.name, case.input, case.must
            ));
        }
    }
    lines.extend(ELSEWHERE.iter().map(|[name, what]| format!("| `{name}` | {what} |")));
    lines
}

/// Fails with the tables as they ought to be unless `README.md` holds them, names in them are those of cases, and there are enough.
pub(super) fn check(others: &[String]) -> Outcome {
    let root = places::repository();
    let page = fs::read_to_string(root.join("tests/suite/extremes/README.md"))?;
    let got: Vec<&str> = page.lines().filter(|line| line.starts_with("| `")).collect();
    let want = lines();
    ensure(got == want, || format!("the tables of README.md must be:\n{}", want.join("\n")))?;
    let count = want.len() - ELSEWHERE.len();
    ensure(count >= 80, || format!("{count} cases"))?;
    let mut sources = String::new();
    for path in rust_files(&project_files(root)?) {
        if !path.starts_with("tests") {
            sources.push_str(&fs::read_to_string(root.join(path))?);
        }
    }
    let there = |name: &str| others.iter().any(|other| other == name) || sources.contains(&format!("fn {name}("));
    match ELSEWHERE.iter().find(|[name, _]| !there(name)) {
        None => Ok(()),
        Some([name, _]) => Err(format!("README.md names {name}, which is no case and no test").into()),
    }
}

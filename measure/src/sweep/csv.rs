//! `points.csv`: one line for every configuration of every clip.

use lgs_engine::recipe::word;
use lgs_pages::csv;

use super::table::PointRow;

const HEAD: [&str; 30] = [
    "clip",
    "name",
    "weights",
    "weights_sha256",
    "background",
    "coarseness",
    "refine_steps",
    "adam_passes",
    "refine_views",
    "pixel_stride",
    "line_search",
    "query",
    "density",
    "theta",
    "max_gaussians",
    "repeats",
    "seconds_median",
    "seconds_q1",
    "seconds_q3",
    "psnr",
    "ssim",
    "lpips",
    "dmae",
    "psnr_dynamic",
    "psnr_static",
    "gaussians",
    "peak_rss_mb",
    "on_front",
    "adam_seconds_for_psnr",
    "command",
];

/// A clip's rows, and the commands that run them.
#[derive(Clone, Debug)]
pub struct Table<'a> {
    /// Name of the clip.
    pub clip: &'a str,
    /// The rows.
    pub rows: &'a [PointRow],
    /// Of each row, the command.
    pub commands: &'a [String],
}

/// The page. What is not known is empty.
pub fn points(tables: &[Table<'_>]) -> String {
    let lines = tables.iter().flat_map(|table| {
        table.rows.iter().zip(table.commands).map(|(row, command)| fields(table.clip, row, command).to_vec())
    });
    csv(&HEAD, lines)
}

fn fields(clip: &str, row: &PointRow, command: &str) -> [String; HEAD.len()] {
    let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    let (weights, recipe) = (row.setting.weights.as_ref(), &row.setting.recipe);
    let of_network = |text: String| if recipe.network { text } else { String::new() };
    [
        clip.to_owned(),
        row.name.clone(),
        weights.map_or(String::new(), |weights| weights.name.clone()),
        weights.map_or(String::new(), |weights| weights.sha256.clone()),
        word(&recipe.background),
        recipe.coarseness.to_string(),
        of_network(recipe.refine_steps.to_string()),
        recipe.adam_passes.to_string(),
        recipe.refine_views.map_or(String::new(), |views| views.to_string()),
        recipe.pixel_stride.to_string(),
        of_network(word(&recipe.line_search)),
        of_network(if recipe.query { "on" } else { "off" }.to_owned()),
        of_network(word(&recipe.density)),
        of_network(recipe.thresholds.prune.to_string()),
        of_network(recipe.max_gaussians.map_or(String::new(), |most| most.to_string())),
        row.repeats.to_string(),
        row.seconds.median.to_string(),
        row.seconds.q1.to_string(),
        row.seconds.q3.to_string(),
        number(row.figures.psnr),
        number(row.figures.ssim),
        number(row.figures.lpips),
        number(row.figures.dmae),
        number(row.figures.psnr_dynamic),
        number(row.figures.psnr_static),
        row.gaussians.to_string(),
        number(row.peak_rss_mb),
        row.on_front.to_string(),
        number(row.reference_s),
        command.to_owned(),
    ]
}

//! Views on the page: pictures with their figures, and the scales of the pictures.

use base64::{Engine as _, engine::general_purpose::STANDARD};

use lgs_pages::escape;

use super::{Page, PageView};
use crate::{
    densify::Thresholds,
    report::{
        colour_maps::{INFERNO, VIRIDIS},
        metrics::{FIGURES, FigureKind, ViewRecord},
        pictures::{DEPTH_SCALE_M, ERROR_FULL_SCALE, PictureKind, SCORE_COLOURS},
    },
    views::Role,
};

/// The views of one role, each with its figures and pictures.
pub(super) fn views_of(page: &Page<'_>, role: Role) -> String {
    let pairs = page.metrics.views.iter().zip(page.views).filter(|(record, _)| record.role == role);
    pairs.map(|(record, pictures)| view(record, pictures)).collect()
}

fn view(record: &ViewRecord, view: &PageView) -> String {
    let defined = FIGURES.iter().filter(|kind| (kind.get)(&record.figures).is_some());
    let chip = |kind: &FigureKind| format!("<li><span>{}</span> {}</li>", kind.label, kind.text(&record.figures));
    let chips: String = defined.map(chip).collect();
    let [width, height] = view.size;
    let columns = if width > 2 * height { "pictures panoramas" } else { "pictures" };
    let name = format!("Frame {} · {}", record.frame, escape(&record.camera));
    let picture = |(kind, jpeg): &(PictureKind, Vec<u8>)| {
        let kind = kind.name();
        format!(
            "<figure tabindex=\"0\"><img alt=\"{kind}, {name}\" width=\"{width}\" height=\"{height}\" \
             src=\"data:image/jpeg;base64,{}\"><figcaption>{kind}</figcaption></figure>\n",
            STANDARD.encode(jpeg)
        )
    };
    let pictures: String = view.pictures.iter().map(picture).collect();
    format!(
        "<article>\n<h3>{name}</h3>\n<ul class=\"chips\">{chips}</ul>\n<div class=\"{columns}\">\n{pictures}</div>\n\
         </article>\n"
    )
}

/// What the colours of the pictures mean.
pub(super) fn legend(page: &Page<'_>) -> String {
    let [near, far] = DEPTH_SCALE_M;
    let ramp = |left: String, gradient: String, right: String| {
        format!("<span class=\"ramp\">{left}<i style=\"background:{gradient}\"></i>{right}</span>")
    };
    let error = format!(
        "<li><b>error</b> mean absolute difference of the colour channels (0 to 1) {} grey: not counted</li>\n",
        ramp("0".into(), INFERNO.css_gradient("right"), format!("{ERROR_FULL_SCALE} and more"))
    );
    let depth = format!(
        "<li><b>depth</b> expected depth, logarithmic {} black: nothing drawn</li>\n",
        ramp(format!("{near} m and less"), VIRIDIS.css_gradient("left"), format!("{far} m and more"))
    );
    let shown = |kind: PictureKind| page.views.iter().any(|view| view.pictures.iter().any(|(of, _)| *of == kind));
    let Thresholds { prune, add } = page.metrics.config.recipe.thresholds;
    let scores = format!(
        "<li><b>prune, add</b> the policy's scores of the primitives before the set update, seen over the drawn view {} grey: \
         no score; thresholds {prune} and {add}</li>\n",
        ramp("0".into(), SCORE_COLOURS.css_gradient("right"), "1".into())
    );
    let parts = [(PictureKind::Error, error), (PictureKind::Depth, depth), (PictureKind::Prune, scores)];
    let parts: String = parts.into_iter().filter(|(kind, _)| shown(*kind)).map(|(_, text)| text).collect();
    let hint = "<li>Click or tap a picture to enlarge it.</li>\n";
    format!("<ul class=\"legend\">\n{parts}{hint}</ul>\n")
}

//! The page for people: the table beside the paper's, the means, the worst and the best snippets to look at, every snippet.

use std::collections::BTreeSet;

use base64::{Engine, engine::general_purpose::STANDARD};
use lgs_engine::report::PictureKind;
use lgs_formats::jobs::FailedItem;
use lgs_pages::{count, document, escape, or_dash, section, table};

use super::{
    figures::kinds,
    findings::{Findings, Found},
    log_page::log_file,
    paper::{SECONDS, columns, paper_table},
    table::{Row, cells, counts, heading, own_rows, paper_rows, papers_data},
};

const STYLE: &str = include_str!("page.css");
/// Snippets of the lowest and of the highest PSNR that are shown.
const SHOWN: usize = 3;

/// The pictures of a snippet: what each shows, and the bytes of a JPEG file.
pub type Pictures = Vec<(PictureKind, Vec<u8>)>;

/// Snippets to look at: those of the lowest PSNR by the last recipe, and, of the others, those of the highest.
pub fn worst_and_best(findings: &Findings) -> [Vec<&Found>; 2] {
    let psnr = |found: &Found| found.record.runs.last().and_then(|run| run.mean().get("psnr"));
    let mut known: Vec<(f64, &Found)> =
        findings.snippets.iter().filter_map(|found| Some((psnr(found)?, found))).collect();
    known.sort_by(|a, b| a.0.total_cmp(&b.0));
    let each = SHOWN.min(known.len().div_ceil(2));
    let worst = known.iter().take(each).map(|(_, found)| *found).collect();
    let best = known.iter().skip(each).rev().take(each).map(|(_, found)| *found).collect();
    [worst, best]
}

/// The page; `pictures` gives those of a snippet.
///
/// # Errors
/// Those of `pictures`.
pub fn html<E>(findings: &Findings, pictures: &dyn Fn(&Found) -> Result<Pictures, E>) -> Result<String, E> {
    let title = format!("LGS evaluation, {} protocol", findings.protocol().word());
    let mut body = header(findings);
    body += &section("Figures", &beside_the_paper(findings));
    body += &section("Means over images, snippets and logs", &means(findings));
    let [worst, best] = worst_and_best(findings);
    for (title, note, found) in [
        ("Worst snippets", "Of each the view of the lowest PSNR.", worst),
        ("Best snippets", "Of each the view of the lowest PSNR, too.", best),
    ] {
        if found.is_empty() {
            continue;
        }
        let views = found.into_iter().map(|found| Ok(view(found, &pictures(found)?))).collect::<Result<String, E>>()?;
        body += &section(title, &format!("<p>{note}</p>\n{views}"));
    }
    if findings.key.viewer {
        let link = |log: &&str| format!("<li><a href=\"{}\">{}</a></li>\n", log_file(log), escape(log));
        let links: String = findings.logs().iter().map(link).collect();
        body += &section("Logs to play", &format!("<ul class=\"links\">\n{links}</ul>\n"));
    }
    body += &section("Snippets", &snippets(findings));
    if !findings.failed.is_empty() {
        body += &section("Could not be evaluated", &failures(&findings.failed));
    }
    body += &section("Settings", &settings(findings));
    Ok(document(&title, STYLE, &body, ""))
}

fn header(findings: &Findings) -> String {
    format!(
        "<header>\n<p class=\"brand\">LGS evaluation</p>\n<h1>{} protocol</h1>\n<p>{}</p>\n<p>{}</p>\n</header>\n",
        findings.protocol().word(),
        counts(findings),
        escape(findings.cutting())
    )
}

fn line(row: &Row, class: &str) -> String {
    let cells: String = row.cells.iter().map(|cell| format!("<td>{cell}</td>")).collect();
    format!("<tr{class}><th>{}</th>{cells}</tr>\n", escape(&row.name))
}

fn group(name: &str, width: usize) -> String {
    format!("<tr class=\"group\"><th colspan=\"{}\">{}</th></tr>\n", width + 1, escape(name))
}

fn beside_the_paper(findings: &Findings) -> String {
    let columns = columns(findings.protocol());
    let headings: Vec<String> = columns.iter().map(|column| heading(column)).collect();
    let head: Vec<&str> = std::iter::once("").chain(headings.iter().map(String::as_str)).collect();
    let mut rows = String::new();
    if let Some(paper) = paper_table(findings.protocol()) {
        rows += &group(&format!("Paper, {}", papers_data(findings, paper)), columns.len());
        rows.extend(paper_rows(paper, &columns).iter().map(|row| line(row, "")));
    }
    rows += &group(&format!("Here, {}; means over images", counts(findings)), columns.len());
    rows.extend(own_rows(findings, &columns).iter().map(|row| line(row, " class=\"own\"")));
    let lpips = if findings.key.lpips_weights.is_none() && columns.contains(&"lpips") {
        "<p>LPIPS is not measured: its weights were not given.</p>\n"
    } else {
        ""
    };
    table(&head, &rows) + lpips
}

fn means(findings: &Findings) -> String {
    let head: Vec<String> = std::iter::once(String::new()).chain(kinds().map(|kind| heading(kind.key))).collect();
    let mut rows = String::new();
    for (index, recipe) in findings.key.recipes.iter().enumerate() {
        let found = findings.averages(index, None);
        rows += &group(&recipe.name, kinds().len());
        for (name, figures) in [("images", &found.image), ("snippets", &found.snippet), ("logs", &found.log)] {
            let cells = kinds().map(|kind| figures.text(&kind)).to_vec();
            rows += &line(&Row { name: format!("every one of the {name} weighs alike"), cells }, "");
        }
        let cells = kinds().map(|kind| found.images[kind.key].to_string()).to_vec();
        rows += &line(&Row { name: "images in which it is defined".to_owned(), cells }, "");
    }
    table(&head.iter().map(String::as_str).collect::<Vec<_>>(), &rows)
}

fn view(found: &Found, pictures: &Pictures) -> String {
    let record = &found.record;
    let mean = record.runs.last().map(|run| run.mean()).unwrap_or_default();
    let chip = |kind: &super::figures::Kind| {
        mean.get(kind.key).map(|_| format!("<li><span>{}</span> {}</li>", kind.label, mean.text(kind)))
    };
    let chips: String = kinds().iter().filter_map(chip).collect();
    let (caption, [width, height]) = record.shown.as_ref().map_or((String::new(), [0, 0]), |shown| {
        (format!("frame {} · {}", shown.frame, escape(&shown.camera)), shown.size)
    });
    let figure = |(kind, jpeg): &(PictureKind, Vec<u8>)| {
        format!(
            "<figure><img alt=\"{}, {}, {caption}\" width=\"{width}\" height=\"{height}\" \
             src=\"data:image/jpeg;base64,{}\"><figcaption>{}</figcaption></figure>\n",
            kind.name(),
            escape(&found.item),
            STANDARD.encode(jpeg),
            kind.name()
        )
    };
    let pictures: String = pictures.iter().map(figure).collect();
    format!(
        "<article>\n<h3>{} <small>{caption}; means of the snippet:</small></h3>\n<ul class=\"chips\">{chips}</ul>\n\
         <div class=\"pictures\">\n{pictures}</div>\n</article>\n",
        escape(&found.item)
    )
}

fn snippets(findings: &Findings) -> String {
    let columns: Vec<&str> = columns(findings.protocol());
    let headings: Vec<String> = columns.iter().map(|column| heading(column)).collect();
    let head: Vec<&str> = ["", "recipe"].into_iter().chain(headings.iter().map(String::as_str)).collect();
    let mut rows = String::new();
    for found in &findings.snippets {
        for (index, run) in found.record.runs.iter().enumerate() {
            let seconds = found.times.as_ref().and_then(|times| times.reconstruction_s.get(index).copied());
            let cells = cells(&run.mean(), &or_dash(seconds, 2), &columns);
            let cells = std::iter::once(escape(&run.recipe)).chain(cells).collect();
            rows += &line(&Row { name: found.item.clone(), cells }, "");
        }
    }
    table(&head, &rows)
}

fn failures(failed: &[FailedItem]) -> String {
    let line = |failed: &FailedItem| {
        format!("<tr><th>{}</th><td class=\"reason\">{}</td></tr>\n", escape(&failed.item), escape(&failed.reason))
    };
    table(&["snippet", "why"], &failed.iter().map(line).collect::<String>())
}

/// A value of JSON as people read it.
fn words(value: &serde_json::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

fn settings(findings: &Findings) -> String {
    let key = &findings.key;
    let size = key.protocol["image_size"].as_array().map(|size| size.iter().map(words).collect::<Vec<_>>().join(" x "));
    let cameras = key.protocol["cameras"].as_array();
    let cameras = cameras.map(|names| names.iter().map(words).collect::<Vec<_>>().join(", "));
    let mut lines: Vec<[String; 2]> = vec![
        ["cameras".to_owned(), cameras.unwrap_or_else(|| "all".to_owned())],
        ["image size".to_owned(), size.unwrap_or_else(|| "that of each image".to_owned())],
        ["weights (SHA-256)".to_owned(), key.weights.clone().unwrap_or_else(|| "none".to_owned())],
        ["weights of LPIPS (SHA-256)".to_owned(), key.lpips_weights.clone().unwrap_or_else(|| "none".to_owned())],
        ["seed".to_owned(), key.seed.to_string()],
        [
            "averages".to_owned(),
            format!("over images unless said otherwise; {SECONDS}: from loaded inputs to the scene"),
        ],
    ];
    for recipe in &key.recipes {
        let options: Vec<String> =
            recipe.options.iter().map(|(name, value)| format!("{name} {}", words(value))).collect();
        lines.push([recipe.name.clone(), options.join(", ")]);
    }
    let memory = findings.snippets.iter().filter_map(|found| found.times.as_ref()?.peak_rss_mb);
    lines.extend(memory.reduce(f64::max).map(|mb| ["peak memory".to_owned(), format!("{mb:.0} MB")]));
    let threads = findings.snippets.iter().find_map(|found| found.times.as_ref().map(|times| times.threads));
    lines.extend(threads.map(|threads| ["work".to_owned(), count(threads, "thread")]));
    let drawn_on = findings.snippets.iter().filter_map(|found| found.times.as_ref()).flat_map(|times| &times.drawn_on);
    let devices: BTreeSet<&str> = drawn_on.clone().map(|drawn_on| drawn_on.device.as_str()).collect();
    lines.extend(devices.iter().map(|device| ["drawn on".to_owned(), (*device).to_owned()]));
    let refused: BTreeSet<&String> = drawn_on.flat_map(|drawn_on| &drawn_on.refused).collect();
    lines.extend(refused.into_iter().map(|reason| ["drawn by the CPU since".to_owned(), reason.clone()]));
    let row = |[name, value]: &[String; 2]| {
        format!("<tr><th>{}</th><td class=\"reason\">{}</td></tr>\n", escape(name), escape(value))
    };
    table(&["setting", ""], &lines.iter().map(row).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::{
        protocol::Protocol,
        samples::{findings, snippet},
    };

    #[test]
    fn no_snippet_is_among_the_worst_and_the_best() {
        let items = |psnr: &[f64]| {
            let found = findings(&Protocol::waymo(), psnr.iter().map(|&psnr| snippet("a", &[psnr], &[])).collect());
            worst_and_best(&found).map(|shown| shown.into_iter().map(|f| f.item.clone()).collect::<Vec<_>>())
        };
        assert_eq!(items(&[20.0]), [vec!["a-00000"], vec![]]);
        assert_eq!(items(&[20.0, 10.0, 30.0]), [vec!["a-00001", "a-00000"], vec!["a-00002"]]);
        let many: Vec<f64> = (0..9).map(f64::from).collect();
        assert_eq!(items(&many)[0], ["a-00000", "a-00001", "a-00002"]);
        assert_eq!(items(&many)[1], ["a-00008", "a-00007", "a-00006"]);
    }

    #[test]
    fn names_and_reasons_cannot_become_markup() {
        let mut found = findings(&Protocol::waymo(), vec![snippet("a", &[20.0], &[])]);
        found.failed.push(FailedItem { item: "b".to_owned(), reason: "<script>".to_owned() });
        let page = html::<()>(&found, &|_| Ok(Vec::new())).unwrap();
        assert!(page.contains("&lt;script&gt;") && page.contains("&lt;own&gt;") && !page.contains("<script>"));
        assert!(page.contains("28.04") && page.contains("other data than here"));
        assert!(html(&found, &|_| Err("unreadable")).is_err());
    }
}

//! The table behind the plots, and what it says in a sentence.

use lgs_pages::{escape, or_dash, table};

use crate::sweep::table::PointRow;

/// The rows as a table; under each name the command where there is one.
pub(super) fn row_table(rows: &[PointRow], commands: &[String]) -> String {
    let head = [
        "#",
        "configuration",
        "seconds",
        "quartiles",
        "PSNR (dB)",
        "SSIM",
        "LPIPS",
        "DMAE (m)",
        "Gaussians",
        "memory (MB)",
        "Adam needs (s)",
        "faster by",
    ];
    let mut body = String::new();
    for (number, row) in (1..).zip(rows) {
        let class = match (row.setting.is_reference(), row.on_front) {
            (true, true) => "reference best",
            (true, false) => "reference",
            (false, true) => "best",
            (false, false) => "beaten",
        };
        let command = commands.get(number - 1).map(|text| format!(" title=\"{}\"", escape(text))).unwrap_or_default();
        body += &format!(
            "<tr class=\"{class}\" data-row=\"{number}\"{command}><td>{number}</td><th>{}</th>",
            escape(&row.name)
        );
        body += &values(row).map(|value| format!("<td>{value}</td>")).concat();
        body += "</tr>\n";
    }
    table(&head, &body)
}

fn values(row: &PointRow) -> [String; 10] {
    let figures = &row.figures;
    let reference = row.speed_up();
    [
        or_dash(Some(row.seconds.median), 3),
        format!("{:.3} – {:.3}", row.seconds.q1, row.seconds.q3),
        or_dash(figures.psnr, 2),
        or_dash(figures.ssim, 4),
        or_dash(figures.lpips, 4),
        or_dash(figures.dmae, 2),
        or_dash(Some(row.gaussians), 0),
        or_dash(row.peak_rss_mb, 0),
        or_dash(row.reference_s.filter(|_| reference.is_some()), 2),
        reference.map_or("–".to_owned(), |times| format!("{times:.1} ×")),
    ]
}

/// What comes out best, as a sentence: the best learned PSNR, and what per-scene optimisation comes to and needs.
pub(super) fn best(rows: &[PointRow]) -> String {
    let best_of = |reference: bool| {
        let known = rows.iter().zip(1..).filter(|(row, _)| row.setting.is_reference() == reference);
        let scored = known.filter_map(|(row, number)| row.figures.psnr.map(|psnr| (row, number, psnr)));
        scored.max_by(|a, b| a.2.total_cmp(&b.2).then(b.0.seconds.median.total_cmp(&a.0.seconds.median)))
    };
    let (learned, reference) = (best_of(false), best_of(true));
    let mut said = Vec::new();
    if let Some((row, number, psnr)) = learned {
        let seconds = row.seconds.median;
        said.push(format!("Best learned: #{number}, {psnr:.2} dB in {seconds:.2} s."));
        said.extend(match (row.speed_up(), reference) {
            (Some(times), _) if times >= 1.0 => Some(format!(
                "Per-scene optimisation comes to as much after {:.2} s: {times:.1} times as long.",
                times * seconds
            )),
            (Some(times), _) => Some(format!(
                "Per-scene optimisation comes to as much after {:.2} s and is faster here.",
                times * seconds
            )),
            (None, Some(_)) => Some("Per-scene optimisation does not come to as much within its steps.".to_owned()),
            (None, None) => None,
        });
    }
    if let Some((row, number, psnr)) = reference {
        said.push(format!("Best of per-scene optimisation: #{number}, {psnr:.2} dB in {:.2} s.", row.seconds.median));
    }
    format!("<p class=\"said\">{}</p>\n", escape(&said.join(" ")))
}

//! What came of time budgets.

use lgs_pages::{escape, or_dash};

use crate::sweep::budget::BudgetRow;

/// The rows as a table; nothing without any.
pub(super) fn budget_table(rows: &[BudgetRow]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let head = ["budget (s)", "what ran", "finished (s)", "quartiles", "of the budget", "PSNR (dB)"];
    let head = head.iter().chain(&["best point that fits", "finished (s)", "PSNR (dB)", "better by (dB)"]);
    let cells: String = head.map(|name| format!("<th>{name}</th>")).collect();
    let body: String = rows.iter().map(|row| format!("<tr>{}</tr>\n", values(row))).collect();
    format!(
        "<p class=\"said\">Runs of <code>lgs-infer</code> with a time budget, from the start of the program to the finished scene, beside \
         the best point above that would have been finished in time.</p>\n<div class=\"wide\"><table class=\"budgets\">\n\
         <thead><tr>{cells}</tr></thead>\n<tbody>\n{body}</tbody>\n</table></div>\n"
    )
}

fn values(row: &BudgetRow) -> String {
    let best = row.best.as_ref();
    let name = best.map_or("none", |rival| &rival.name);
    let share = 100.0 * row.finished_s.median / row.budget_s;
    let share = if row.kept { format!("{share:.0} %") } else { format!("<strong>{share:.0} %</strong>") };
    let what = if row.fits { String::new() } else { "nothing fits: ".to_owned() } + &row.flags;
    let better = best.and_then(|rival| Some(rival.psnr - row.psnr?));
    format!(
        "<td>{}</td><th>{}</th><td>{:.2}</td><td>{:.2} – {:.2}</td><td>{share}</td><td>{}</td><th>{}</th><td>{}</td><td>{}</td><td>{}</td>",
        row.budget_s,
        escape(&what),
        row.finished_s.median,
        row.finished_s.q1,
        row.finished_s.q3,
        or_dash(row.psnr, 2),
        escape(name),
        or_dash(best.map(|rival| rival.finished_s), 2),
        or_dash(best.map(|rival| rival.psnr), 2),
        or_dash(better, 2),
    )
}

//! The pages in a browser.

use lgs_tests::browser::{self, Page};
use lgs_tests::{Outcome, case_if, clips};
use libtest_mimic::Trial;
use serde_json::Value;

use super::{SMALL, eval};

pub(crate) fn cases() -> Vec<Trial> {
    vec![case_if(&browser::needed(), "eval::pages::in_a_browser", in_a_browser)]
}

fn in_a_browser() -> Outcome {
    let place = tempfile::tempdir()?;
    let street = clips::street().display().to_string();
    let flags = [&[street.as_str()], SMALL.as_slice(), &["--viewer", "--out", "out"]].concat();
    eval(place.path(), &flags)?.expect_success()?;
    let mut report = Page::open(&place.path().join("out/report.html"), "")?;
    // Three snippets: the two worst and the best, three pictures each; every one drawn, nothing from elsewhere.
    let counts = "[document.images.length, [...document.images].filter(i => i.naturalWidth > 0).length, \
                  document.querySelectorAll('article').length, document.querySelectorAll('[src^=http], link').length]";
    let found = report.value(counts)?;
    if found != serde_json::json!([9, 9, 3, 0]) {
        return Err(format!("pictures, those that are drawn, snippets, things from elsewhere: {found}").into());
    }
    let mut log = Page::open(&place.path().join("out/play-street.html"), "")?;
    let shown = "new Promise((done) => { const seen = new Set(); const look = () => { \
                 const at = [...document.querySelectorAll('nav button[data-page]')].findIndex(b => b.className === 'shown'); \
                 seen.add(at); if (seen.size === 3) done([...seen]); else setTimeout(look, 20); }; \
                 setTimeout(() => done([...seen]), 60000); document.getElementById('all').click(); look(); })";
    match log.value(shown)? {
        Value::Array(seen) if seen.len() == 3 => Ok(()),
        other => Err(format!("snippets that were played, of three: {other}").into()),
    }
}

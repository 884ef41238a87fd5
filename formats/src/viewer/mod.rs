//! A scene as one HTML page that shows it in a browser: no server, no network, nothing beside the file.
//!
//! The page holds the scene ([`pack()`]), the clip's cameras as stops, and a viewer: `viewer/main.js` bundled with the libraries
//! of `viewer/package-lock.json`, whose licences stand in `viewer/LICENSES.md` and in the page.

mod pack;
mod stop;

use std::io::Write;

use base64::{Engine, engine::general_purpose::STANDARD};
use flate2::{Compression, write::GzEncoder};
use lgs_pages::escape;

use crate::cloud::SplatCloud;

pub use pack::pack;
pub use stop::Stop;

const PAGE: &str = include_str!("../../viewer/page.html");
const LICENSES: &str = include_str!("../../viewer/LICENSES.md");
const CODE: &[u8] = include_bytes!("../../viewer/viewer.js.gz");

/// The page that shows `cloud`, with `stops` to stand at; without any, one at the origin that looks forward and one above the scene.
pub fn html(cloud: &SplatCloud, stops: &[Stop], title: &str) -> String {
    let own = [Stop::forward(cloud), Stop::overview(cloud)];
    let times: Vec<f64> = match stops {
        [] => cloud.times.iter().copied().filter(|time| time.is_finite()).map(f64::from).chain([own[0].time]).collect(),
        _ => stops.iter().map(|stop| stop.time).collect(),
    };
    let stops = if stops.is_empty() { &own } else { stops };
    let first = times.iter().copied().fold(f64::INFINITY, f64::min);
    let last = times.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let cameras = serde_json::json!({ "title": title, "stops": stops, "span": [first, last] });
    let fills = [
        ("{{TITLE}}", escape(title)),
        ("{{LICENSES}}", LICENSES.replace("--", "- -")),
        // inside a script element only "</" could end it
        ("{{CAMERAS}}", cameras.to_string().replace('<', "\\u003c")),
        ("{{SCENE}}", STANDARD.encode(gzip(&pack(cloud)))),
        ("{{CODE}}", STANDARD.encode(CODE)),
    ];
    let mut page = String::with_capacity(PAGE.len() + fills.iter().map(|(_, text)| text.len()).sum::<usize>());
    let mut rest = PAGE;
    for (mark, text) in &fills {
        let (before, after) = rest.split_once(mark).unwrap_or((rest, ""));
        page += before;
        page += text;
        rest = after;
    }
    page + rest
}

/// The bytes packed; the same bytes for the same input.
fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    // writing to memory cannot fail; a page without its scene would say so itself
    if encoder.write_all(bytes).is_err() {
        return Vec::new();
    }
    encoder.finish().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_holds_everything_and_no_name_breaks_out() {
        let page = html(&SplatCloud::default(), &[], "a</title><script>alert(1)</script>");
        for mark in ["{{TITLE}}", "{{LICENSES}}", "{{CAMERAS}}", "{{SCENE}}", "{{CODE}}", "<script>alert"] {
            assert!(!page.contains(mark), "{mark}");
        }
        assert!(page.contains("MIT"));
        assert!(page.contains(&STANDARD.encode(&CODE[..30])));
        for outside in [" src=", " href=", "url(", "@import"] {
            assert!(!PAGE.contains(outside), "{outside}");
        }
    }
}

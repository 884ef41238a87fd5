//! The page of a snippet's scene, made to be played by the page of its log.

/// The file of a snippet's page.
pub const VIEWER: &str = "viewer.html";
/// What the page does for that of its log: it plays when it is told to, and tells when it is at its end.
const IN_A_LOG: &str = include_str!("in_a_log.js");

/// The page of a scene, with what the page of its log talks to.
pub fn in_a_log(page: &str) -> String {
    let script = format!("<script>\n{IN_A_LOG}</script>\n</body>");
    match page.rsplit_once("</body>") {
        Some((before, after)) => [before, &script, after].concat(),
        None => page.to_owned(),
    }
}

//! What every page of the programs is: one file, without anything from elsewhere.

/// The style that all pages share.
const BASE: &str = include_str!("base.css");

/// A page. The title is text of HTML already; a script runs when the page is there, where it is not empty.
pub fn document(title: &str, style: &str, body: &str, script: &str) -> String {
    let script = if script.is_empty() { String::new() } else { format!("<script>\n{script}</script>\n") };
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n<style>\n{BASE}{style}</style>\n</head>\n\
         <body>\n<main>\n{body}</main>\n{script}</body>\n</html>\n"
    )
}

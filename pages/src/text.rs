//! Numbers as people read them.

/// Ascending numbers with runs of three and more drawn together: `0, 2, 5 to 8`.
pub fn ranges(numbers: &[usize]) -> String {
    let runs = numbers.chunk_by(|a, b| a + 1 == *b).flat_map(|run| match run {
        [first, _, .., last] => vec![format!("{first} to {last}")],
        short => short.iter().map(usize::to_string).collect(),
    });
    runs.collect::<Vec<String>>().join(", ")
}

/// A number with its noun.
pub fn count(n: usize, what: &str) -> String {
    format!("{} {what}{}", thousands(n), if n == 1 { "" } else { "s" })
}

/// The number with a thin space between its thousands.
pub fn thousands(n: usize) -> String {
    let digits = n.to_string();
    let groups: Vec<&str> = digits.as_bytes().rchunks(3).rev().filter_map(|group| str::from_utf8(group).ok()).collect();
    groups.join("\u{202f}")
}

/// A number in a few characters.
pub fn number(value: f64) -> String {
    if value == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e5).contains(&value.abs()) {
        let text = format!("{value:.4}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        format!("{value:.1e}")
    }
}

/// A number with so many decimals; a dash where it is not known.
pub fn or_dash(value: Option<f64>, decimals: usize) -> String {
    value.map_or("–".to_owned(), |value| format!("{value:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::{count, number, or_dash, ranges, thousands};

    #[test]
    fn numbers_are_readable() {
        assert_eq!(thousands(0), "0");
        assert_eq!(thousands(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!((count(1, "frame").as_str(), count(2, "frame").as_str()), ("1 frame", "2 frames"));
        assert_eq!(ranges(&[0, 1, 3, 5, 6, 7, 8]), "0, 1, 3, 5 to 8");
        assert_eq!(ranges(&[]), "");
        assert_eq!([0.0, 0.25, 1e-7, 123_456.0].map(number), ["0", "0.25", "1.0e-7", "1.2e5"]);
        assert_eq!((or_dash(Some(1.256), 2).as_str(), or_dash(None, 2).as_str()), ("1.26", "–"));
    }
}

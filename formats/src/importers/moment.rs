//! Moments that foreign tables write as texts.

const MICROS: i64 = 1_000_000;

/// The microseconds since 1970 that `YYYY-MM-DD`, `separator` and `hh:mm:ss` with or without a fraction say, in UTC; `None` for another text.
pub(super) fn micros(text: &str, separator: char) -> Option<i64> {
    let (date, time) = text.split_once(separator)?;
    let (time, fraction) = time.split_once('.').map_or((time, "0"), |(time, fraction)| (time, fraction));
    let [year, month, day] = numbers(date, '-', [4, 2, 2])?;
    let [hour, minute, second] = numbers(time, ':', [2, 2, 2])?;
    let is_time = hour < 24 && minute < 60 && second <= 60; // a leap second is the 61st
    let (is_day, is_fraction) = ((1..=month_days(year, month)?).contains(&day), all_digits(fraction));
    if !is_day || !is_time || !is_fraction {
        return None;
    }
    let fraction: i64 = format!("{fraction:0<6}")[..6].parse().ok()?;
    Some(((days(year, month, day) * 24 + hour) * 60 + minute) * 60 * MICROS + second * MICROS + fraction)
}

/// The numbers between the separators, each of as many digits as `widths` says.
fn numbers(text: &str, separator: char, widths: [usize; 3]) -> Option<[i64; 3]> {
    let parts: Vec<&str> = text.split(separator).collect();
    let [a, b, c] = parts.as_slice() else { return None };
    let fits = [a, b, c].into_iter().zip(widths).all(|(part, width)| part.len() == width && all_digits(part));
    if fits { Some([a.parse().ok()?, b.parse().ok()?, c.parse().ok()?]) } else { None }
}

fn all_digits(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())
}

fn month_days(year: i64, month: i64) -> Option<i64> {
    let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    match month {
        2 => Some(if is_leap { 29 } else { 28 }),
        4 | 6 | 9 | 11 => Some(30),
        1..=12 => Some(31),
        _ => None,
    }
}

/// The days from 1970-01-01 to a date of the years 0 to 9999.
///
/// # Formula
/// In years that begin in March, month `m` (0 to 11) begins on day `(153 m + 2) / 5`, and the leap day is the last one.
fn days(year: i64, month: i64, day: i64) -> i64 {
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let leap_days = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    365 * year + leap_days + (153 * month + 2) / 5 + day - 1 - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_follow_one_another() {
        assert_eq!(days(1970, 1, 1), 0);
        let mut expected = days(0, 1, 1);
        for year in 0..=9999 {
            for month in 1..=12 {
                for day in 1..=month_days(year, month).unwrap() {
                    assert_eq!(days(year, month, day), expected, "{year}-{month}-{day}");
                    expected += 1;
                }
            }
        }
    }

    #[test]
    fn texts_of_the_layouts_are_read() {
        // `date -u -d @SECONDS` says these dates.
        assert_eq!(micros("2011-09-26 13:02:25.594360375", ' '), Some(1_317_042_145_594_360));
        assert_eq!(micros("2018-12-31T23:59:60", 'T'), Some(1_546_300_800_000_000));
        assert_eq!(micros("1969-12-31T23:59:59.5", 'T'), Some(-500_000));
        assert_eq!(micros("2000-02-29T00:00:00.0000019", 'T'), Some(951_782_400_000_001));
    }

    #[test]
    fn other_texts_are_none() {
        for text in [
            "",
            "T",
            "2018-12-31",
            "2018-12-31 00:00:00",
            "18-12-31T00:00:00",
            "2018-13-31T00:00:00",
            "2018-00-31T00:00:00",
            "2018-12-00T00:00:00",
            "2018-12-32T00:00:00",
            "2019-02-29T00:00:00",
            "1900-02-29T00:00:00",
            "2018-12-31T24:00:00",
            "2018-12-31T00:60:00",
            "2018-12-31T00:00:61",
            "2018-12-31T00:00:00.",
            "2018-12-31T00:00:00.x",
            "2018-12-31T00:00:00Z",
            "2018-12-31T00:00:00.é",
            "+018-12-31T00:00:00",
            "2018-12-31-01T00:00:00",
            "2018-12-31T00:00",
        ] {
            assert_eq!(micros(text, 'T'), None, "{text}");
        }
    }
}

//! A model as a table: its modules, their parameters, the total.

use std::fmt::Write as _;

use super::config::ModelConfig;
use super::model::Model;
use crate::error::Result;

/// Parts of a tensor's name that make a module of the table.
const MODULE_DEPTH: usize = 3;

/// The model of a config as lines of text: module, tensors, parameters with thousands separators, total.
///
/// # Errors
/// Never for a config that was parsed.
pub fn describe(config: &ModelConfig) -> Result<String> {
    let tensors = Model::tensors(config)?;
    let mut modules: Vec<(String, usize, usize)> = Vec::new();
    for tensor in tensors.iter().filter(|tensor| tensor.is_parameter()) {
        let module: Vec<&str> = tensor.name.split('.').take(MODULE_DEPTH).collect();
        let module = module.join(".");
        match modules.last_mut() {
            Some((last, count, parameters)) if *last == module => {
                *count += 1;
                *parameters += tensor.len();
            }
            _ => modules.push((module, 1, tensor.len())),
        }
    }
    let total: usize = modules.iter().map(|(_, _, parameters)| parameters).sum();
    let width = modules.iter().map(|(name, ..)| name.len()).max().unwrap_or(0).max(6);
    let mut text = format!("model {}\n{:width$}  {:>7}  {:>13}\n", config.name, "module", "tensors", "parameters");
    for (name, count, parameters) in &modules {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name:width$}  {count:>7}  {:>13}", thousands(*parameters));
    }
    let _ = writeln!(text, "{:width$}  {:>7}  {:>13}", "total", "", thousands(total));
    Ok(text)
}

/// The number in groups of three digits.
pub fn thousands(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::thousands;

    #[test]
    fn digits_stand_in_threes() {
        assert_eq!([0, 999, 1_000, 86_959_294].map(thousands), ["0", "999", "1,000", "86,959,294"]);
    }
}

//! Which share of a job this process does.

use std::path::Path;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::shares::{Shares, Task};
use crate::error::{FormatError, Result};

const SLURM_ID: &str = "SLURM_ARRAY_TASK_ID";
const INDEX: &str = "JOB_COMPLETION_INDEX";

/// One share of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// Which share, from 1.
    pub index: usize,
    /// How many shares there are.
    pub count: usize,
}

impl FromStr for Part {
    type Err = String;

    /// `I/N`, I from 1 to N.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
        let part = numbers.map(|(index, count)| Self { index, count });
        part.filter(|part| (1..=part.count).contains(&part.index))
            .ok_or_else(|| format!("expected I/N with I from 1 to N, found {text:?}"))
    }
}

/// File name of a part's manifest.
pub fn part_file(part: Part) -> String {
    format!("part-{}-of-{}.json", part.index, part.count)
}

/// The share that was asked for, else by the environment of a Slurm array task or of a Kubernetes indexed job, of the job in the folder `out`, and
/// how that job is divided, for [`Shares::write`]; `None` for the whole job.
///
/// `SLURM_ARRAY_TASK_ID` with `_MIN` and `_COUNT` (and `_STEP`, 1 when it is missing), or `JOB_COMPLETION_INDEX`, from 0, with
/// `JOB_COMPLETIONS`, which the job's file sets to its `completions`. Slurm counts the tasks that were submitted together alone: where the
/// folder knows how its job was divided at first, tasks that are submitted again keep their shares.
///
/// # Errors
/// An environment that is not complete or does not fit together, or not with the folder's job.
pub fn choose_part(
    out: &Path,
    asked: Option<Part>,
    variable: &dyn Fn(&str) -> Option<String>,
) -> Result<Option<(Part, Shares)>> {
    let Some(task) = task(out, asked, variable)? else { return Ok(None) };
    task.part(out, Shares::read(out)?).map(Some)
}

fn task(out: &Path, asked: Option<Part>, variable: &dyn Fn(&str) -> Option<String>) -> Result<Option<Task>> {
    let whole =
        |name, number, first, count| Task { name, number, shares: Shares { first, step: 1, count }, is_whole: true };
    if let Some(Part { index, count }) = asked {
        return Ok(Some(whole("part", index, 1, count)));
    }
    let number = |name: &'static str| -> Result<usize> {
        let text = variable(name).unwrap_or_default();
        let number = text.parse().ok();
        number.ok_or_else(|| FormatError::unfit(out, name, "a number, or `part I/N`", format!("{text:?}")))
    };
    if variable(SLURM_ID).is_some() {
        let (id, first, count) =
            (number(SLURM_ID)?, number("SLURM_ARRAY_TASK_MIN")?, number("SLURM_ARRAY_TASK_COUNT")?);
        let step = variable("SLURM_ARRAY_TASK_STEP").map_or(Ok(1), |_| number("SLURM_ARRAY_TASK_STEP"))?.max(1);
        let shares = Shares { first, step, count: count.max(1) };
        return Ok(Some(Task { name: SLURM_ID, number: id, shares, is_whole: false }));
    }
    if variable(INDEX).is_some() {
        return Ok(Some(whole(INDEX, number(INDEX)?, 0, number("JOB_COMPLETIONS")?.max(1))));
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(variables: &[(&str, &str)]) -> Result<Option<Part>> {
        let find = |name: &str| variables.iter().find(|(n, _)| *n == name).map(|(_, value)| (*value).to_owned());
        Ok(choose_part(Path::new("no such folder"), None, &find)?.map(|(part, _)| part))
    }

    #[test]
    fn the_environment_of_both_schedulers_is_understood() {
        assert_eq!(of(&[]).unwrap(), None);
        let slurm = |id| [("SLURM_ARRAY_TASK_ID", id), ("SLURM_ARRAY_TASK_MIN", "1"), ("SLURM_ARRAY_TASK_COUNT", "3")];
        assert_eq!(of(&slurm("1")).unwrap(), Some(Part { index: 1, count: 3 }));
        assert_eq!(of(&slurm("3")).unwrap(), Some(Part { index: 3, count: 3 }));
        assert!(of(&slurm("7")).unwrap_err().to_string().contains("part"));
        let stepped = [slurm("5").as_slice(), &[("SLURM_ARRAY_TASK_STEP", "2")]].concat();
        assert_eq!(of(&stepped).unwrap(), Some(Part { index: 3, count: 3 }));
        let indexed = [("JOB_COMPLETION_INDEX", "0"), ("JOB_COMPLETIONS", "4")];
        assert_eq!(of(&indexed).unwrap(), Some(Part { index: 1, count: 4 }));
        let message = of(&indexed[..1]).unwrap_err().to_string();
        assert!(message.contains("JOB_COMPLETIONS: expected a number, or `part I/N`"), "{message}");
        assert!(of(&[("JOB_COMPLETION_INDEX", "4"), ("JOB_COMPLETIONS", "4")]).is_err());
    }

    #[test]
    fn what_is_asked_for_goes_first() {
        let flag = Some(Part { index: 2, count: 5 });
        let find = |name: &str| (name == "SLURM_ARRAY_TASK_ID").then(|| "1".to_owned());
        let chosen = choose_part(Path::new("no such folder"), flag, &find).unwrap();
        assert_eq!(chosen, flag.map(|part| (part, Shares { first: 1, step: 1, count: 5 })));
    }

    #[test]
    fn tasks_that_are_submitted_again_keep_their_shares() {
        let place = tempfile::tempdir().unwrap();
        let share = |[id, min, count, step]: [&str; 4]| {
            let find = |name: &str| match name.strip_prefix("SLURM_ARRAY_TASK_")? {
                "ID" => Some(id.to_owned()),
                "MIN" => Some(min.to_owned()),
                "COUNT" => Some(count.to_owned()),
                "STEP" => Some(step.to_owned()),
                _ => None,
            };
            choose_part(place.path(), None, &find)
        };
        let (part, shares) = share(["1", "1", "3", "1"]).unwrap().unwrap();
        shares.write(place.path()).unwrap();
        assert_eq!(part, Part { index: 1, count: 3 });
        // One that failed; two that failed, beside each other and apart.
        for [id, min, count, step] in
            [["2", "2", "1", "1"], ["2", "2", "2", "1"], ["3", "2", "2", "1"], ["3", "1", "2", "2"]]
        {
            let index = id.parse().unwrap();
            assert_eq!(
                share([id, min, count, step]).unwrap().map(|(part, _)| part),
                Some(Part { index, count: 3 }),
                "{id} {min}"
            );
        }
        let message = share(["4", "1", "5", "1"]).unwrap_err().to_string();
        assert!(message.contains("3 shares, tasks 1 to 3") && message.contains("shares.json"), "{message}");
        let flag = |index, count| choose_part(place.path(), Some(Part { index, count }), &|_| None);
        assert!(flag(2, 3).is_ok() && flag(2, 4).is_err());
    }
}

//! Which share of a job this process does.

use lgs_formats::targets::Part;

use crate::error::{Result, TargetError};

/// The share by the flag, else by the environment of a Slurm array task or of a Kubernetes indexed job; `None` for the whole job.
///
/// `SLURM_ARRAY_TASK_ID` with `_MIN` and `_COUNT` (and `_STEP`, 1 when it is missing), or `JOB_COMPLETION_INDEX`, from 0, with
/// `JOB_COMPLETIONS`, which the job's file sets to its `completions`.
///
/// # Errors
/// An environment that is not complete or does not fit together.
pub fn choose_part(flag: Option<Part>, variable: &dyn Fn(&str) -> Option<String>) -> Result<Option<Part>> {
    if flag.is_some() {
        return Ok(flag);
    }
    let number = |name: &str| -> Result<usize> {
        let text = variable(name).unwrap_or_default();
        let number = text.parse().ok();
        number.ok_or_else(|| TargetError::setting(name, "a number, or --part I/N", format!("{text:?}")))
    };
    if variable("SLURM_ARRAY_TASK_ID").is_some() {
        let (id, min, count) =
            (number("SLURM_ARRAY_TASK_ID")?, number("SLURM_ARRAY_TASK_MIN")?, number("SLURM_ARRAY_TASK_COUNT")?);
        let step = variable("SLURM_ARRAY_TASK_STEP").map_or(Ok(1), |_| number("SLURM_ARRAY_TASK_STEP"))?.max(1);
        let even = id >= min && (id - min).is_multiple_of(step);
        return part("SLURM_ARRAY_TASK_ID", if even { (id - min) / step + 1 } else { 0 }, count).map(Some);
    }
    if variable("JOB_COMPLETION_INDEX").is_some() {
        let (index, count) = (number("JOB_COMPLETION_INDEX")?, number("JOB_COMPLETIONS")?);
        return part("JOB_COMPLETION_INDEX", index.saturating_add(1), count).map(Some);
    }
    Ok(None)
}

fn part(name: &str, index: usize, count: usize) -> Result<Part> {
    if (1..=count).contains(&index) {
        return Ok(Part { index, count });
    }
    let found = format!("task {index} of {count}; give --part I/N where tasks are not numbered evenly");
    Err(TargetError::setting(name, "tasks that are numbered evenly", found))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(variables: &[(&str, &str)]) -> Result<Option<Part>> {
        let find = |name: &str| variables.iter().find(|(n, _)| *n == name).map(|(_, value)| (*value).to_owned());
        choose_part(None, &find)
    }

    #[test]
    fn the_environment_of_both_schedulers_is_understood() {
        assert_eq!(of(&[]).unwrap(), None);
        let slurm = |id| [("SLURM_ARRAY_TASK_ID", id), ("SLURM_ARRAY_TASK_MIN", "1"), ("SLURM_ARRAY_TASK_COUNT", "3")];
        assert_eq!(of(&slurm("1")).unwrap(), Some(Part { index: 1, count: 3 }));
        assert_eq!(of(&slurm("3")).unwrap(), Some(Part { index: 3, count: 3 }));
        assert!(of(&slurm("7")).unwrap_err().to_string().contains("--part"));
        let stepped = [slurm("5").as_slice(), &[("SLURM_ARRAY_TASK_STEP", "2")]].concat();
        assert_eq!(of(&stepped).unwrap(), Some(Part { index: 3, count: 3 }));
        let indexed = [("JOB_COMPLETION_INDEX", "0"), ("JOB_COMPLETIONS", "4")];
        assert_eq!(of(&indexed).unwrap(), Some(Part { index: 1, count: 4 }));
        let message = of(&indexed[..1]).unwrap_err().to_string();
        assert!(message.contains("JOB_COMPLETIONS: expected a number, or --part I/N"), "{message}");
        assert!(of(&[("JOB_COMPLETION_INDEX", "4"), ("JOB_COMPLETIONS", "4")]).is_err());
    }

    #[test]
    fn the_flag_goes_first() {
        let flag = Some(Part { index: 2, count: 5 });
        let find = |name: &str| (name == "SLURM_ARRAY_TASK_ID").then(|| "1".to_owned());
        assert_eq!(choose_part(flag, &find).unwrap(), flag);
    }
}

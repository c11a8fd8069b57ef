//! The command line and its failures.

use rt::{Exit, Failure};
use std::fmt::{Debug, Display};

/// Parses the command line. An invalid one ends the program with EX_USAGE of sysexits(3).
pub fn parse<C: clap::Parser>() -> C {
    C::try_parse().unwrap_or_else(|error| {
        // Help and version also come this way. They are not errors.
        let _ = error.print();
        std::process::exit(if error.use_stderr() { Exit::Usage as i32 } else { 0 })
    })
}

/// The failure of an option whose value is out of its bounds.
pub fn out_of_bounds(option: &str, value: impl Display, bounds: impl Display) -> Failure {
    Failure::new(Exit::Usage, format!("{option} = {value}: must be {bounds}"))
}

/// Checks that the value of an option is within its bounds.
pub fn check_bounds<T: PartialOrd + Display + Debug>(
    option: &str,
    value: T,
    [low, high]: [T; 2],
) -> Result<(), Failure> {
    // NaN is in no bounds.
    let is_within = value >= low && value <= high;
    if is_within { Ok(()) } else { Err(out_of_bounds(option, format_args!("{value:?}"), format!("{low} to {high}"))) }
}

/// The failure of a run that a signal ended.
pub fn interrupted() -> Failure {
    Failure::new(Exit::Interrupted, "interrupted; the robot was stopped")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn value_out_of_bounds_is_refused_by_option_name() {
        assert!(check_bounds("--ticks", 1, [1, 9]).is_ok() && check_bounds("--ticks", 9, [1, 9]).is_ok());
        for value in [f64::NAN, f64::INFINITY, 0.5, 1e30] {
            let failure = check_bounds("--seconds", value, [1.0, 9.0]).expect_err("out of bounds");
            assert_eq!((failure.exit, failure.text), (Exit::Usage, format!("--seconds = {value:?}: must be 1 to 9")));
        }
    }
}

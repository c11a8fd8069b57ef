//! Text for the user. Its reader may exit early (`| head`). That must not end a program that moves a robot, as it
//! would with `println!`. So text that cannot be written is lost.

use std::ffi::OsStr;

/// Returns true if text for a stream should be coloured. `is_terminal` says if the stream is a terminal. There is
/// no colour if the user sets NO_COLOR (see no-color.org), or if the terminal has none.
pub fn wants_colour(is_terminal: bool) -> bool {
    let variable = |name: &str| std::env::var_os(name).unwrap_or_default();
    colours(is_terminal, &variable("NO_COLOR"), &variable("TERM"))
}

fn colours(is_terminal: bool, no_color: &OsStr, term: &OsStr) -> bool {
    is_terminal && no_color.is_empty() && term != "dumb"
}

/// Reads a finite number for command lines.
pub fn number(text: &str) -> Result<f64, String> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite()).ok_or_else(|| "must be a number".into())
}

/// Writes a line to standard output.
#[macro_export]
macro_rules! out {
    ($($words:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stdout(), $($words)*);
    }};
}

/// Writes a line to standard error.
#[macro_export]
macro_rules! err {
    ($($words:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($words)*);
    }};
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colour_is_used_only_on_terminals_without_no_color() {
        let colours = |terminal: bool, no_color: &str, term: &str| colours(terminal, no_color.as_ref(), term.as_ref());
        assert!(colours(true, "", "xterm-256color") && colours(true, "", ""));
        assert!(!colours(false, "", "xterm"), "a file");
        assert!(!colours(true, "1", "xterm"), "NO_COLOR");
        assert!(!colours(true, "", "dumb"));
    }
}

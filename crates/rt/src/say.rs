//! Words for people. Whoever reads them may go away (`| head`), and that must not end a program that moves a robot, as
//! `println!` would: what cannot be written is lost.

use std::ffi::OsStr;

/// Whether to colour what is written to a stream, which is a terminal or not: not where the user asks for none (NO_COLOR, see
/// no-color.org), nor in a terminal that cannot.
pub fn wants_colour(is_terminal: bool) -> bool {
    let says = |name: &str| std::env::var_os(name).unwrap_or_default();
    colours(is_terminal, &says("NO_COLOR"), &says("TERM"))
}

fn colours(is_terminal: bool, no_color: &OsStr, term: &OsStr) -> bool {
    is_terminal && no_color.is_empty() && term != "dumb"
}

/// A line on standard output.
#[macro_export]
macro_rules! out {
    ($($words:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stdout(), $($words)*);
    }};
}

/// A line on standard error.
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
    fn colour_goes_to_terminals_whose_user_wants_it() {
        let colours = |terminal: bool, no_color: &str, term: &str| colours(terminal, no_color.as_ref(), term.as_ref());
        assert!(colours(true, "", "xterm-256color") && colours(true, "", ""));
        assert!(!colours(false, "", "xterm"), "a file");
        assert!(!colours(true, "1", "xterm"), "NO_COLOR");
        assert!(!colours(true, "", "dumb"));
    }
}

//! Words for people. Whoever reads them may go away (`| head`), and that must not end a program that moves a robot, as
//! `println!` would: what cannot be written is lost.

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

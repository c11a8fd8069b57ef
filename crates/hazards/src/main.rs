//! Prints the list as a table in Markdown.

use hazards::{Answer, Group, Hazard, groups};
use std::io::Write;

fn main() {
    let mut out = String::new();
    for Group { title, hazards } in groups() {
        out += &format!("\n**{title}**\n\n| id | what goes wrong | what teleopd does | within |\n|---|---|---|---|\n");
        for Hazard { id, what, answer } in hazards {
            out += &match answer {
                Answer::Does { does, within } => format!("| {id} | {what} | {does} | {within} |\n"),
                Answer::Struck { because } => format!("| {id} | {what} | does not apply: {because} | |\n"),
            };
        }
    }
    // The reader may have closed the pipe. That is no error.
    let _ = std::io::stdout().write_all(out.as_bytes());
}

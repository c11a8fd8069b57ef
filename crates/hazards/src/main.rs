//! Prints the list as a table in Markdown.

use hazards::{Answer, GROUPS};
use std::io::Write;

fn main() {
    let mut out = String::new();
    for (title, hazards) in GROUPS {
        out += &format!("\n**{title}**\n\n| id | what goes wrong | what teleopd does | within |\n|---|---|---|---|\n");
        for hazard in hazards {
            out += &match hazard.answer {
                Answer::Does { does, within } => format!("| {} | {} | {does} | {within} |\n", hazard.id, hazard.what),
                Answer::Struck { because } => format!("| {} | {} | struck: {because} | |\n", hazard.id, hazard.what),
            };
        }
    }
    // The reader may have closed the pipe. That is no error.
    let _ = std::io::stdout().write_all(out.as_bytes());
}

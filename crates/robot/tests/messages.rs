//! Every refusal of a changed robot file or URDF names the file, what was changed, and what is allowed.

use crate::support::{TOML, URDF, load};
use robot::RobotError;
use std::collections::BTreeSet;

/// Words of a bound. A value that is out of its bound is corrected by them.
const BOUNDS: &str = "\
    must |at most|at least|above |below |within|between|exactly|expected|not allowed|is not |only |unique|one of|\
    missing|twice|unknown|has no|fit again|collision fit|not as in|no |duplicate|invalid";

/// Checks a refusal. `names` are the changed key, or what it belongs to.
fn check(error: &RobotError, names: &[&str], wrong: &mut BTreeSet<String>) {
    if let RobotError::Several { errors } = error {
        return errors.iter().for_each(|error| check(error, names, wrong));
    }
    let text = error.to_string();
    let file = text.contains("tiago_dual.toml") || text.contains("tiago_dual.urdf");
    let named = names.iter().any(|name| text.contains(name));
    // 1e30 is one word, and no row of zeros. A parser shows the line, and the number in full.
    let is_long =
        !text.contains("TOML parse error") && text.split(|c: char| !c.is_ascii_digit()).any(|digits| digits.len() > 17);
    if is_long || !file || !named || !BOUNDS.split('|').any(|word| text.contains(word)) {
        wrong.insert(format!("{names:?}: {text}"));
    }
}

#[test]
fn every_refusal_of_a_changed_file_names_file_key_and_bound() {
    let (mut wrong, mut refused) = (BTreeSet::new(), 0);
    let lines: Vec<&str> = TOML.lines().collect();
    for (n, line) in lines.iter().enumerate().filter(|(_, line)| !line.starts_with('#')) {
        let Some((key, value)) = line.split_once(" = ") else { continue };
        let others: &[&str] = match value.chars().next() {
            Some('"') => &["\"nonesuch\"", "3"],
            Some('[') if value.ends_with(']') => &["[]", "3"],
            Some('0'..='9' | '-') => &["-1e9", "1e30", "nan", "\"x\""],
            _ => continue,
        };
        for other in others.iter().map(|other| format!("{key} = {other}")).chain([String::new()]) {
            let changed = [&lines[..n], &[other.as_str()], &lines[n + 1..]].concat().join("\n");
            if let Err(error) = load(&changed, URDF) {
                refused += 1;
                // The key, its value, or one of a list.
                let values = value.split('"').filter(|part| part.len() > 3);
                let names: Vec<_> = values.chain([key.trim(), "nonesuch"]).collect();
                check(&error, &names, &mut wrong);
            }
        }
    }
    let mut seen = BTreeSet::new();
    for (n, line) in URDF.lines().enumerate() {
        let Some((tag, attributes)) = line.trim().strip_prefix('<').and_then(|line| line.split_once(' ')) else {
            continue;
        };
        for (name, value) in attributes.split("\" ").filter_map(|part| part.split_once("=\"")) {
            let value = value.split('"').next().unwrap_or("");
            // Each attribute of each kind of element once.
            if value.is_empty() || !seen.insert((tag, name)) {
                continue;
            }
            for other in ["nan", "-1e30", "nonesuch"] {
                let line = line.replacen(&format!("{name}=\"{value}\""), &format!("{name}=\"{other}\""), 1);
                let lines = URDF.lines().enumerate().map(|(i, own)| if i == n { line.as_str() } else { own });
                if let Err(error) = load(TOML, &lines.collect::<Vec<_>>().join("\n")) {
                    refused += 1;
                    check(&error, &[name, tag, value, other], &mut wrong);
                }
            }
        }
    }
    println!("{refused} refused, {} without file, key or bound", wrong.len());
    assert!(refused > 1000, "{refused} changes were refused");
    assert!(wrong.is_empty(), "{}", wrong.iter().cloned().collect::<Vec<_>>().join("\n"));
}

//! What happened, a sentence each, from one `Status` to the next.

use foxglove::messages::log::Level;
use messages::{FAULTS, Fault, Faults, Mode, Response, Status, TRANSITIONS_KEPT, reduced_flag};
use pipeline::Names;

/// A sentence and how grave it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sentence {
    /// How grave.
    pub level: Level,
    /// What happened.
    pub text: String,
}

/// Everything that happened after `before`, up to `now`; without `before`, only where the robot stands.
pub fn sentences(before: Option<&Status>, now: &Status, names: &Names) -> Vec<Sentence> {
    let say = |level, text| Sentence { level, text };
    let Some(before) = before.filter(|before| before.header.incarnation == now.header.incarnation) else {
        let mut all = vec![say(Level::Info, format!("The robot is {}.", mode(now.mode)))];
        all.extend(Faults(now.faults).iter().map(|fault| say(level(fault), meaning(fault, now, names))));
        return all;
    };
    let mut all = Vec::new();
    let made = now.transition_count.wrapping_sub(before.transition_count);
    let kept = TRANSITIONS_KEPT as u32;
    if made > kept {
        all.push(say(Level::Warning, format!("{} changes of mode were not seen.", made - kept)));
    }
    for n in now.transition_count.wrapping_sub(made.min(kept))..now.transition_count {
        let made = &now.transitions[(n % kept) as usize];
        let fault = Fault::from_u32(made.why);
        let why = fault.map_or_else(|| made.why_name().to_owned(), |fault| meaning(fault, now, names));
        let text = format!("{} after {}: {}", mode(made.to), mode(made.from), why);
        all.push(say(fault.map_or(Level::Info, level), if text.ends_with('.') { text } else { text + "." }));
    }
    for row in &FAULTS {
        let count = now.fault_counts[row.fault.index()].wrapping_sub(before.fault_counts[row.fault.index()]);
        let told = (0..made.min(kept)).any(|i| {
            let n = now.transition_count.wrapping_sub(i + 1);
            now.transitions[(n % kept) as usize].why == row.fault as u32
        });
        if count > 0 && !told {
            all.push(say(level(row.fault), meaning(row.fault, now, names)));
        }
    }
    let denied = now.gate_denials.wrapping_sub(before.gate_denials);
    if denied > 0 {
        let pair = names.pair(now.nearest_pair);
        all.push(say(Level::Error, format!("The gate denied {denied} commands; {pair} are nearest.")));
    }
    let refused = now.fallbacks.wrapping_sub(before.fallbacks);
    if refused > 0 {
        let (pair, clearance_mm) = (names.pair(now.nearest_pair), now.clearance_command_m * 1e3);
        let text = format!("{refused} motions were refused, the plan went on: {pair} are {clearance_mm:.1} mm apart.");
        all.push(say(Level::Info, text));
    }
    for (flag, name) in reduced_flag::NAMES {
        if now.reduced & flag != 0 && before.reduced & flag == 0 {
            all.push(say(Level::Warning, format!("The speed is reduced: {name}.")));
        }
    }
    all
}

/// The mode's name.
pub fn mode(value: u32) -> &'static str {
    Mode::from_u32(value).map_or("in an unknown mode", Mode::name)
}

fn level(fault: Fault) -> Level {
    match fault.row().response {
        Response::Inhibit => Level::Info,
        Response::Hold | Response::Release => Level::Warning,
        Response::Stop => Level::Error,
    }
}

/// What a fault means, with the joint or pair that it happened to.
fn meaning(fault: Fault, status: &Status, names: &Names) -> String {
    let (name, meaning) = (fault.row().name, fault.row().meaning);
    match (fault, status.joint_outside.checked_sub(1)) {
        (Fault::StartOutsideLimits, Some(joint)) => {
            let (joint, unit) = (joint as usize, names.unit(joint as usize));
            format!("{name}: {meaning} {} is outside by {:.4} {unit}.", names.joint(joint), status.outside_by)
        }
        (Fault::StartInCollision | Fault::CollisionNear, _) => {
            let pair = names.pair(status.nearest_pair_measured);
            format!("{name}: {meaning} {pair} are {:.1} mm apart.", status.clearance_measured_m * 1e3)
        }
        (Fault::GateDenied, _) => format!("{name}: {meaning} {} are nearest.", names.pair(status.nearest_pair)),
        (Fault::TrackingError, _) => format!("{name}: {meaning} The largest error is {:.4}.", status.tracking_error),
        _ => format!("{name}: {meaning}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Layout, Transition};

    #[test]
    fn every_transition_fault_and_denial_is_told_once() {
        let names = Names::default();
        let mut status = Status::ZERO;
        let first = sentences(None, &status, &names);
        assert_eq!(first[0].text, "The robot is Disengaged.");
        let before = status;
        status.transitions[0] = Transition { k: 5, from: 0, to: 1, why: Transition::ENABLED, reserved: 0 };
        status.transitions[1] = Transition { k: 9, from: 1, to: 3, why: Fault::CollisionNear as u32, reserved: 0 };
        status.transition_count = 2;
        status.fault_counts[Fault::CollisionNear.index()] = 1;
        status.fault_counts[Fault::StateLate.index()] = 1;
        (status.gate_denials, status.nearest_pair, status.nearest_pair_measured) = (2, [1, 2], [3, 4]);
        let texts: Vec<_> = sentences(Some(&before), &status, &names).into_iter().map(|said| said.text).collect();
        assert_eq!(texts.len(), 4, "{texts:?}");
        assert_eq!(texts[0], "Engaging after Disengaged: enabled.");
        assert!(
            texts[1].starts_with("Holding after Engaging: CollisionNear") && texts[1].contains("part 3 and part 4")
        );
        assert!(texts[2].starts_with("StateLate: "), "{texts:?}");
        assert_eq!(texts[3], "The gate denied 2 commands; part 1 and part 2 are nearest.");
        assert!(sentences(Some(&status), &status, &names).is_empty());
        status.header.incarnation = 9;
        assert_eq!(sentences(Some(&before), &status, &names).len(), 1, "another control begins anew");
    }
}

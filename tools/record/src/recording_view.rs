//! Prepares a recording for the page of `view`.

use crate::error::RecordError;
use crate::read::{Content, Recorded};
use messages::RobotId;
use robot::Model;
use std::path::Path;
use view::{GONE_AFTER_NS, LatestMessages, RecordingView, RecordingViewBuilder};

/// Reads a recording of the robot `model`. Also returns the reason if the file breaks off.
pub fn recording_view(path: &Path, model: &Model) -> Result<(RecordingView, Option<String>), RecordError> {
    let mut recorded = Recorded::open(path)?;
    recorded.check_robot(model)?;
    // The robot file may have changed since the recording, so only the number of joints has to be equal.
    let own = |robot: &mut RobotId| {
        if robot.joint_count != model.id().joint_count {
            let cause = format!("is about a {robot}, not about {} with {} joints", model.name, model.count);
            return Err(RecordError::Lacks { file: path.display().to_string(), cause });
        }
        *robot = model.id();
        Ok(())
    };
    let (mut heard, mut at, mut begin_ns) = (LatestMessages::default(), [f64::NEG_INFINITY; 5], None);
    let mut builder = RecordingViewBuilder::new(model);
    while let Some((at_ns, content)) = recorded.next_message()? {
        let at_s = at_ns.saturating_sub(*begin_ns.get_or_insert(at_ns)) as f64 * 1e-9;
        match content {
            Content::Skeleton(skeleton) => (heard.skeleton, at[0]) = (Some(*skeleton), at_s),
            Content::Target(mut target) => {
                own(&mut target.robot)?;
                (heard.target, at[1]) = (Some(*target), at_s);
            }
            Content::Command(mut command) => {
                own(&mut command.robot)?;
                (heard.command, at[2]) = (Some(*command), at_s);
            }
            Content::State(mut state) => {
                own(&mut state.robot)?;
                (heard.state, at[3]) = (Some(*state), at_s);
            }
            Content::Status(status) => (heard.status, at[4]) = (Some(*status), at_s),
            Content::Policy(_) | Content::Inputs(_) | Content::Other { .. } => continue,
        }
        let [skeleton, target, command, state, status] = at.map(|at| at_s - at <= GONE_AFTER_NS as f64 * 1e-9);
        heard = LatestMessages {
            skeleton: heard.skeleton.filter(|_| skeleton),
            target: heard.target.filter(|_| target),
            command: heard.command.filter(|_| command),
            state: heard.state.filter(|_| state),
            status: heard.status.filter(|_| status),
        };
        builder.add(&heard, at_s);
    }
    let broken_off = recorded.broken_off();
    if begin_ns.is_none() {
        let cause = match broken_off {
            Some(why) => format!("it has no whole message: {why}"),
            None => "there is no message in it".to_owned(),
        };
        return Err(RecordError::Lacks { file: path.display().to_string(), cause });
    }
    Ok((builder.build(), broken_off))
}

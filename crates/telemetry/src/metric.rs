//! The measured durations, in the order of the path from the person to the motor.

/// A duration that a loop measures. Each hop begins where the one before ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Metric {
    /// A client's frame is published -> `ingest` holds it.
    PublishedToIngest,
    /// `ingest` holds a frame -> the skeleton is about to be published.
    IngestWork,
    /// The skeleton is published -> `retarget` wakes and reads it. It includes the wait for the next deadline.
    IngestToRetarget,
    /// `retarget` wakes -> the target is about to be published.
    RetargetWork,
    /// The target is published -> `control` wakes with it.
    TargetToControl,
    /// `control` wakes -> the command is about to be published.
    ControlWork,
    /// The command is published -> the driver holds it.
    CommandToDriver,
    /// A client's frame is published -> the driver executes the frame's first command. There is one sample per
    /// frame.
    SkeletonToCommand,
    /// The target is published -> the driver executes its command. There is one sample per command.
    TargetToCommand,
    /// The deadline of the tick's index -> the loop wakes for it.
    WakeUp,
}

impl Metric {
    /// All metrics. The index of each is its number.
    pub const ALL: [Self; 10] = [
        Self::PublishedToIngest,
        Self::IngestWork,
        Self::IngestToRetarget,
        Self::RetargetWork,
        Self::TargetToControl,
        Self::ControlWork,
        Self::CommandToDriver,
        Self::SkeletonToCommand,
        Self::TargetToCommand,
        Self::WakeUp,
    ];

    /// Returns its name in reports and metrics.
    pub const fn name(self) -> &'static str {
        match self {
            Self::PublishedToIngest => "published_to_ingest",
            Self::IngestWork => "ingest_work",
            Self::IngestToRetarget => "ingest_to_retarget",
            Self::RetargetWork => "retarget_work",
            Self::TargetToControl => "target_to_control",
            Self::ControlWork => "control_work",
            Self::CommandToDriver => "command_to_driver",
            Self::SkeletonToCommand => "skeleton_to_command",
            Self::TargetToCommand => "target_to_command",
            Self::WakeUp => "wake_up",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metric_indices_match_order_and_names_are_unique() {
        for (index, metric) in Metric::ALL.into_iter().enumerate() {
            assert_eq!(metric as usize, index);
            assert_eq!(Metric::ALL.iter().filter(|other| other.name() == metric.name()).count(), 1);
        }
    }
}

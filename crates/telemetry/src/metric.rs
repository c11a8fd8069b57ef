//! The measured durations, in the order of the path from the person to the motor.

messages::named! {
    /// A duration that a loop measures. Each hop begins where the one before ends.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Metric {
        /// A client's frame is published -> `ingest` holds it.
        PublishedToIngest => "published_to_ingest",
        /// `ingest` holds a frame -> the skeleton is about to be published.
        IngestWork => "ingest_work",
        /// The skeleton is published -> `retarget` wakes and reads it. It includes the wait for the next deadline.
        IngestToRetarget => "ingest_to_retarget",
        /// `retarget` wakes -> the target is about to be published.
        RetargetWork => "retarget_work",
        /// The target is published -> `control` wakes with it.
        TargetToControl => "target_to_control",
        /// `control` wakes -> the command is about to be published.
        ControlWork => "control_work",
        /// The command is published -> the driver holds it.
        CommandToDriver => "command_to_driver",
        /// A client's frame is published -> the driver executes the frame's first command. There is one sample per
        /// frame.
        SkeletonToCommand => "skeleton_to_command",
        /// The target is published -> the driver executes its command. There is one sample per command.
        TargetToCommand => "target_to_command",
        /// The deadline of the tick's index -> the loop wakes for it.
        WakeUp => "wake_up",
    }
}

//! Modes and faults, and the one table that gives each fault its response.

crate::named! {
    /// State of the robot's control. It mirrors the state machine in `safety`, without that machine's data.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    #[repr(u32)]
    pub enum Mode {
        /// The robot is not enabled. It holds its posture.
        #[default]
        Disengaged = 0 => "Disengaged",
        /// Blending from the robot's posture to the target's.
        Engaging = 1 => "Engaging",
        /// Following the target.
        Engaged = 2 => "Engaged",
        /// Stopping, or stopped and able to resume.
        Holding = 3 => "Holding",
        /// Stopped until reset.
        Faulted = 4 => "Faulted",
        /// Moving back slowly from outside the limits or from near self-collision, while the operator holds the
        /// recovery.
        Recovering = 5 => "Recovering",
    }
}

impl Mode {
    /// Returns the mode with this number.
    pub const fn from_u32(value: u32) -> Option<Self> {
        if value < 6 { Some(Self::ALL[value as usize]) } else { None }
    }
}

/// Response to a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response {
    /// The robot cannot engage.
    Inhibit,
    /// Controlled stop that keeps the posture (stop category 2). The robot may resume while the enable is held.
    Hold,
    /// As `Hold`, and the robot is released: it needs a new enable edge.
    Release,
    /// Controlled stop, latched until reset (stop category 1).
    Stop,
}

/// A row of the fault table.
#[derive(Clone, Copy, Debug)]
pub struct FaultRow {
    /// The fault.
    pub fault: Fault,
    /// Name in reports.
    pub name: &'static str,
    /// Response to it.
    pub response: Response,
    /// Consecutive ticks with the fault before the response begins.
    pub debounce_ticks: u32,
    /// Description of the fault, in one sentence.
    pub meaning: &'static str,
}

macro_rules! faults {
    ($($(#[$meta:meta])* $name:ident: $response:ident, $debounce:literal, $meaning:literal;)*) => {
        /// All faults that can occur at run time.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(u32)]
        pub enum Fault { $(#[doc = $meaning] $name,)* }

        /// Number of faults.
        pub(crate) const FAULT_COUNT: usize = [$(Fault::$name),*].len();

        /// The one table of responses.
        pub const FAULTS: [FaultRow; FAULT_COUNT] = [$(FaultRow {
            fault: Fault::$name,
            name: stringify!($name),
            response: Response::$response,
            debounce_ticks: $debounce,
            meaning: $meaning,
        },)*];
    };
}

faults! {
    NotRealtime: Inhibit, 1, "Real-time scheduling (SCHED_FIFO, locked memory, PREEMPT_RT kernel) is missing, and \
        neither control.engage_without_realtime nor --engage-without-realtime permits engaging without it.";
    ConfigMismatch: Inhibit, 1, "Two processes run with different configurations.";
    StartOutsideLimits: Inhibit, 1, "A measured joint is outside its limits.";
    StartInCollision: Inhibit, 1, "The measured posture is closer to self-collision than allowed.";
    NoRobotState: Inhibit, 1, "No robot state has arrived yet, or the driver has not started the command stream.";
    NoTarget: Inhibit, 1, "No fresh target has arrived yet.";
    InputStale: Hold, 1, "No valid skeleton arrived for too long.";
    InputImplausible: Hold, 3, "The target is implausible: a value is out of range, or it keeps jumping.";
    TargetStale: Hold, 1, "No target arrived for too long.";
    CollisionNear: Hold, 15, "The measured posture is closer to self-collision than allowed.";
    StateLate: Hold, 1, "The robot state is late.";
    DeadlinesLate: Hold, 1, "Control missed deadlines too often within a second.";
    OperatorSilent: Release, 1, "The enable heartbeat stopped, or its client disconnected.";
    WriterRestarted: Release, 1, "Retargeting or the driver restarted.";
    PersonChanged: Release, 1, "The person, the client or the policy changed, frames contradicted each other, or ingest restarted.";
    HoldTimeout: Release, 1, "Holding lasted too long.";
    EmergencyStop: Stop, 1, "The emergency stop was pressed, by an operator or at the robot.";
    StateStale: Stop, 1, "The robot state stopped arriving.";
    FeedbackInvalid: Stop, 1, "Encoder feedback is implausible: it jumped, froze while moving, or has the wrong sign.";
    TrackingError: Stop, 1, "The robot does not follow its command.";
    VelocityError: Stop, 1, "A joint's measured motion exceeds its speed limit, or differs from the command.";
    StandstillLost: Stop, 1, "No motion is commanded, but a joint leaves its position or does not come to rest.";
    DeadlineMissed: Stop, 1, "Control missed too many deadlines in a row.";
    DriverFault: Stop, 1, "The driver latched a fault.";
    GateDenied: Stop, 3, "The gate denied commands of whole-body control.";
    Clutch: Hold, 1, "The clutch is held: the person moves freely, and the robot stands.";
}

impl Fault {
    /// Index in `FAULTS`.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns the fault's row of the table.
    pub const fn row(self) -> &'static FaultRow {
        &FAULTS[self as usize]
    }

    /// Returns the fault with this index.
    pub const fn from_u32(value: u32) -> Option<Self> {
        if (value as usize) < FAULT_COUNT { Some(FAULTS[value as usize].fault) } else { None }
    }
}

/// A set of faults, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults(pub u64);

impl Faults {
    /// No fault.
    pub const NONE: Self = Self(0);

    /// Returns this set with `fault` added.
    pub const fn with(self, fault: Fault) -> Self {
        Self(self.0 | 1 << fault as u32)
    }

    /// Adds `fault` if `present`, else removes it.
    pub const fn set(&mut self, fault: Fault, present: bool) {
        if present {
            self.0 |= 1 << fault as u32;
        } else {
            self.0 &= !(1 << fault as u32);
        }
    }

    /// Returns true if `fault` is in the set.
    pub const fn has(self, fault: Fault) -> bool {
        self.0 & (1 << fault as u32) != 0
    }

    /// Returns the union of both sets.
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns true if every fault of this set is also in `others`.
    pub const fn is_in(self, others: Self) -> bool {
        self.0 & !others.0 == 0
    }

    /// Returns true if the set is empty.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns the faults of the set that have this response.
    pub fn with_response(self, response: Response) -> Self {
        let mut out = Self::NONE;
        for row in &FAULTS {
            if row.response == response && self.has(row.fault) {
                out = out.with(row.fault);
            }
        }
        out
    }

    /// Iterates over the faults of the set in table order.
    pub fn iter(self) -> impl Iterator<Item = Fault> {
        FAULTS.iter().map(|row| row.fault).filter(move |&fault| self.has(fault))
    }
}

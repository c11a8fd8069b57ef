//! Bugs of robot software, to be planted one at a time in a build for that purpose alone: `--cfg known_bugs`. Any other
//! build holds no trace of them: [`known_bug!`](crate::known_bug) is the constant `false` there.

/// Whether this bug is planted: `known_bug!(HaltSendsZeros)`.
#[cfg(known_bugs)]
#[macro_export]
macro_rules! known_bug {
    ($name:ident) => {
        $crate::KnownBug::$name.is_planted()
    };
}

/// Whether this bug is planted: the constant `false`, because this build knows none.
#[cfg(not(known_bugs))]
#[macro_export]
macro_rules! known_bug {
    ($name:ident) => {
        false
    };
}

// A constant expression, so nothing of a bug is left in a product.
#[cfg(not(known_bugs))]
const _: () = assert!(!crate::known_bug!(HaltSendsZeros));

#[cfg(known_bugs)]
mod planted {
    use core::sync::atomic::{AtomicUsize, Ordering};

    /// One more than the index of the bug that is planted; zero for none. A setting, not a hand-over: relaxed is enough.
    static PLANTED: AtomicUsize = AtomicUsize::new(0);

    macro_rules! known_bugs {
        ($($name:ident, $what:literal $(, like $like:literal)?;)*) => {
            /// A bug that can be planted.
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            #[repr(usize)]
            pub enum KnownBug { $(#[doc = $what] $name,)* }

            impl KnownBug {
                /// All of them.
                pub const ALL: [Self; [$(stringify!($name)),*].len()] = [$(Self::$name),*];

                /// Its name.
                pub const fn name(self) -> &'static str {
                    match self { $(Self::$name => stringify!($name),)* }
                }

                /// What goes wrong, in one sentence.
                pub const fn what(self) -> &'static str {
                    match self { $(Self::$name => $what,)* }
                }

                /// The public bug of another project that it resembles; empty where none is known to us.
                pub const fn like(self) -> &'static str {
                    match self { $(Self::$name => concat!("" $(, $like)?),)* }
                }
            }
        };
    }

    impl KnownBug {
        /// Plants this bug in place of the one before, in the whole process; none: the product as it is.
        pub fn plant(bug: Option<Self>) {
            PLANTED.store(bug.map_or(0, |bug| bug as usize + 1), Ordering::Relaxed);
        }

        /// Whether it is this one that is planted.
        #[inline]
        pub fn is_planted(self) -> bool {
            PLANTED.load(Ordering::Relaxed) == self as usize + 1
        }
    }

    known_bugs! {
        // pipeline
        NanTargetPasses, "A target that is no number is below every bound.";
        StopLostWithReset, "An emergency stop that comes together with a reset is lost.";
        EnableEdgeRemains, "An enable that was taken counts again in the next tick.";
        AuthorityOfLastComer, "Whoever publishes last has authority.";
        AuthorityInMicroseconds, "The silence after which a client has left is a thousandth of what it should be.";
        StatusReadyWhileLatched, "The status says ready while a fault waits for its reset.";
        ReseedForgotten, "Control goes on from its own last command though the driver is elsewhere.";
        PlannerNotReseeded, "The check is told where the robot is, the planner is not.";
        CommandIndexOffByOne, "A command carries the index of the tick after.";
        EngagesAtTarget, "Engaging begins at the target instead of where the robot is.";
    }
}

#[cfg(known_bugs)]
pub use planted::KnownBug;

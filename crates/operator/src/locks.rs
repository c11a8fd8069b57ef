//! The users who pressed the emergency stop and have not reset it. Does no IO and reads no clock.
//!
//! Each user who presses puts a lock on the reset. Only its owner or root removes it, as with the padlocks on a
//! switch (29 CFR 1910.147, lockout by each worker). The lock belongs to the user and not to the connection:
//! `teleopctl estop` ends with its press, and a web page may be closed. The kernel gives the user (SO_PEERCRED).

/// Number of users with separate locks, as many as there are connections. With more users only root removes the locks.
const LOCKS_MAX: usize = crate::merge::CLIENTS_MAX;

/// User number of root.
const ROOT: u32 = 0;

/// The rule for resetting an emergency stop that an operator pressed. It does not concern the robot's own
/// emergency stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ResetRule {
    /// Every operator may reset.
    #[default]
    Anyone,
    /// The user who pressed it, and root. If several users pressed, each of them must reset.
    Presser,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Locks {
    owners: [Option<u32>; LOCKS_MAX],
    /// True if more users pressed than there are separate locks.
    overflowed: bool,
}

impl Locks {
    pub(crate) fn add(&mut self, uid: u32) {
        if self.owners.contains(&Some(uid)) {
            return;
        }
        match self.owners.iter_mut().find(|owner| owner.is_none()) {
            Some(free) => *free = Some(uid),
            None => self.overflowed = true,
        }
    }

    /// Handles a reset by `uid`. It removes the user's own lock, and all locks if the user is root.
    pub(crate) fn remove(&mut self, uid: u32) {
        if uid == ROOT {
            *self = Self::default();
        }
        self.owners.iter_mut().filter(|owner| **owner == Some(uid)).for_each(|owner| *owner = None);
    }

    pub(crate) fn are_gone(&self) -> bool {
        *self == Self::default()
    }

    /// Returns the number of a user with a lock, plus one. Zero if there is no lock. If too many users pressed, root.
    pub(crate) fn first_by(&self) -> u32 {
        let first = self.owners.iter().flatten().next().copied().or(self.overflowed.then_some(ROOT));
        first.map_or(0, |uid| uid.saturating_add(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANNA: u32 = 1001;
    const BERT: u32 = 1002;

    #[test]
    fn user_reset_removes_only_own_lock() {
        let mut locks = Locks::default();
        assert!(locks.are_gone() && locks.first_by() == 0);
        [ANNA, BERT, ANNA].into_iter().for_each(|uid| locks.add(uid));
        locks.remove(1003);
        assert_eq!((locks.are_gone(), locks.first_by()), (false, ANNA + 1));
        locks.remove(ANNA);
        assert_eq!((locks.are_gone(), locks.first_by()), (false, BERT + 1), "two presses are one lock");
        locks.remove(BERT);
        assert!(locks.are_gone());
    }

    #[test]
    fn only_root_resets_when_users_exceed_lock_slots() {
        let mut locks = Locks::default();
        let users = || 1000..=1000 + LOCKS_MAX as u32;
        users().for_each(|uid| locks.add(uid));
        users().for_each(|uid| locks.remove(uid));
        assert_eq!((locks.are_gone(), locks.first_by()), (false, ROOT + 1));
        locks.remove(ROOT);
        assert!(locks.are_gone());
    }
}

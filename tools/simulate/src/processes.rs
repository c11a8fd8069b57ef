//! Tracks which processes are dead or suspended.

use crate::kinds::ProcessId;
use driver::{Measured, Standstill};
use messages::JOINTS_MAX;
use world::Running;

#[derive(Clone, Copy, Debug, Default)]
struct One {
    /// The first tick in which it runs again.
    down_until: u64,
    /// True if it is dead. Then a new one is started.
    dead: bool,
    /// Ticks for which a new one has waited until the robot is at rest.
    awaited: u64,
}

#[derive(Clone, Debug, Default)]
pub struct Processes {
    all: [One; 4],
    /// Detects whether the robot of a driver that is about to start stands still.
    standstill: Option<Standstill>,
    /// Posture into which a person moves the robot while its driver is dead.
    pub moved_to: Option<[f64; JOINTS_MAX]>,
}

/// Processes that are restarted in a tick, in the order of [`ProcessId`].
pub type Started = [bool; 4];

impl Processes {
    pub fn stop(&mut self, who: ProcessId, k: u64, ticks: u64) {
        let one = &mut self.all[who as usize];
        one.down_until = one.down_until.max(k + ticks);
    }

    pub fn kill(&mut self, who: ProcessId, k: u64, ticks: u64) {
        self.stop(who, k, ticks);
        self.all[who as usize].dead = true;
        self.all[who as usize].awaited = 0;
        if who == ProcessId::Driver {
            self.standstill = None;
        }
    }

    /// Returns true if a driver is about to start in tick `k` and waits for the robot to stand still. It waits for one
    /// second at most, as the process does.
    pub fn awaits_rest(&self, k: u64) -> bool {
        let driver = &self.all[ProcessId::Driver as usize];
        driver.dead && driver.down_until <= k && driver.awaited < driver::STANDS_WITHIN_TICKS && self.moved_to.is_none()
    }

    /// Keeps the driver that waits in tick `k` from starting while the robot does not stand by its measurements.
    pub fn await_rest(&mut self, k: u64, measured: &Measured) {
        let standstill = self.standstill.get_or_insert_with(|| Standstill::new(measured));
        if !standstill.stands(measured) {
            let driver = &mut self.all[ProcessId::Driver as usize];
            driver.down_until = k + 1;
            driver.awaited += 1;
        }
    }

    /// Returns true if the newest driver started although the robot did not stand still within a second.
    pub fn gave_up_waiting(&self) -> bool {
        self.all[ProcessId::Driver as usize].awaited >= driver::STANDS_WITHIN_TICKS
    }

    /// Returns the processes that run in tick `k`, and those that restart in it.
    pub fn at(&mut self, k: u64) -> (Running, Started) {
        let runs = self.all.map(|one| k >= one.down_until);
        let started = self.all.map(|one| one.dead && k >= one.down_until);
        self.all.iter_mut().zip(started).for_each(|(one, started)| one.dead &= !started);
        (Running { ingest: runs[0], retarget: runs[1], control: runs[2], driver: runs[3] }, started)
    }
}

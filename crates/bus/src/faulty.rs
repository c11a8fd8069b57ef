//! A latest-value slot behind a faulty link. It drops, delays, duplicates and reorders, from a seed and in
//! virtual time.

use crate::error::PublishError;
use crate::port::{Latest, Publish};
use messages::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Largest number of messages under way. Further ones are dropped and counted.
const UNDER_WAY_MAX: usize = 64;

/// Faults of the link. The default is a perfect link.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaultPlan {
    /// Probability that a message is lost, 0 to 1.
    pub drop: f64,
    /// Probability that a message arrives twice, 0 to 1.
    pub duplicate: f64,
    /// Probability that a message is held back by `reorder_ns`, so that later ones overtake it, 0 to 1.
    pub reorder: f64,
    /// Time for which such a message is held back, ns.
    pub reorder_ns: u64,
    /// Shortest delay of every message, ns.
    pub delay_min_ns: u64,
    /// Longest delay, ns. Delays are drawn uniformly. Delay alone never reorders.
    pub delay_max_ns: u64,
}

/// Counts of the link's faults so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultCounts {
    /// Messages published.
    pub published: u64,
    /// Messages lost, by chance or because too many were under way.
    pub dropped: u64,
    /// Messages doubled.
    pub duplicated: u64,
    /// Messages held back.
    pub reordered: u64,
    /// Arrivals, doubles included.
    pub arrived: u64,
}

#[derive(Clone, Copy, Debug)]
struct UnderWay<M> {
    arrival: Stamp,
    order: u64,
    message: M,
}

/// The slot, with both ends in one value. `Clone` branches it: both branches have the same future.
#[derive(Clone, Debug)]
pub struct Faulty<M> {
    plan: FaultPlan,
    dice: Pcg64Mcg,
    now: Stamp,
    last_arrival: Stamp,
    sent: u64,
    under_way: Vec<UnderWay<M>>,
    newest: Option<M>,
    counts: FaultCounts,
}

impl<M: Copy> Faulty<M> {
    /// Creates a link with this plan. The same seed gives the same faults.
    pub fn new(plan: FaultPlan, seed: u64) -> Self {
        Self {
            plan,
            dice: Pcg64Mcg::seed_from_u64(seed),
            now: Stamp::NONE,
            last_arrival: Stamp::NONE,
            sent: 0,
            under_way: Vec::with_capacity(UNDER_WAY_MAX),
            newest: None,
            counts: FaultCounts::default(),
        }
    }

    /// Moves virtual time forward and delivers the messages that are due.
    pub fn advance(&mut self, now: Stamp) {
        self.now = self.now.max(now);
        while let Some(due) = self.next_due() {
            self.newest = Some(self.under_way.swap_remove(due).message);
            self.counts.arrived += 1;
        }
    }

    /// Changes the faults of the link. Messages under way keep their arrival.
    pub fn set_plan(&mut self, plan: FaultPlan) {
        self.plan = plan;
    }

    /// Takes other random numbers from here on, so that copies of a link differ.
    pub fn reseed(&mut self, seed: u64) {
        self.dice = Pcg64Mcg::seed_from_u64(seed);
    }

    /// Returns the counts so far.
    pub fn counts(&self) -> FaultCounts {
        self.counts
    }

    /// Returns the earliest message that is due: by arrival, then by order of sending.
    fn next_due(&self) -> Option<usize> {
        let due = self.under_way.iter().enumerate().filter(|(_, message)| message.arrival <= self.now);
        due.min_by_key(|(_, message)| (message.arrival, message.order)).map(|(index, _)| index)
    }

    fn send(&mut self, message: &M, arrival: Stamp) {
        if self.under_way.is_empty() && arrival <= self.now {
            // It would be the next one that arrives.
            self.newest = Some(*message);
            self.counts.arrived += 1;
            self.sent += 1;
            return;
        }
        if self.under_way.len() == UNDER_WAY_MAX {
            self.counts.dropped += 1;
            return;
        }
        self.under_way.push(UnderWay { arrival, order: self.sent, message: *message });
        self.sent += 1;
    }

    fn delay_ns(&mut self) -> u64 {
        let (shortest, longest) = (self.plan.delay_min_ns, self.plan.delay_max_ns.max(self.plan.delay_min_ns));
        self.dice.random_range(shortest..=longest)
    }
}

impl<M: Copy> Publish<M> for Faulty<M> {
    fn publish(&mut self, message: &M) -> Result<(), PublishError> {
        self.counts.published += 1;
        // Every message draws the same count of numbers, so one fault's probability does not shift the others' numbers.
        let [dropped, doubled, held] = [self.plan.drop, self.plan.duplicate, self.plan.reorder]
            .map(|probability| self.dice.random::<f64>() < probability);
        let (first_ns, second_ns) = (self.delay_ns(), self.delay_ns());
        if dropped {
            self.counts.dropped += 1;
            return Ok(());
        }
        let in_order = self.now.plus_ns(first_ns).max(self.last_arrival);
        if held {
            self.counts.reordered += 1;
            self.send(message, in_order.plus_ns(self.plan.reorder_ns));
        } else {
            self.last_arrival = in_order;
            self.send(message, in_order);
        }
        if doubled {
            self.counts.duplicated += 1;
            self.send(message, in_order.plus_ns(second_ns));
        }
        self.advance(self.now);
        Ok(())
    }
}

impl<M: Copy> Latest<M> for Faulty<M> {
    fn latest(&mut self) -> Option<M> {
        self.newest.take()
    }
}

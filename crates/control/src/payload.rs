//! Payloads of the hands: `control` executes or refuses an operator's orders.

use crate::Config;
use crate::tick::State;
use messages::{Mode, PayloadOrder, PayloadRefusal, Status};
use robot::Payload;
use safety::engage;

impl State {
    /// Executes the operator's orders for the hands, or refuses them. A payload changes only while the robot is
    /// Disengaged and at rest. So no motion was certified with another payload.
    pub(super) fn set_payloads(
        &mut self,
        config: &Config,
        orders: &[Option<PayloadOrder>; 2],
        decided: &engage::Output,
    ) {
        for (hand, order) in orders.iter().enumerate() {
            let Some(order) = order else { continue };
            let carried = self.carry(config, hand, order, decided);
            let status = &mut self.report.status;
            let (count, why, joint) = match carried {
                Ok(None) => (&mut status.payloads_taken, 0, None),
                // The load is in the hand whether the arm can hold it or not. It counts, and nothing starts.
                Ok(joint) => (&mut status.payloads_taken, PayloadRefusal::Overload as u32, joint),
                Err(why) => (&mut status.payloads_refused, why as u32, None),
            };
            *count = count.wrapping_add(1);
            status.payload_refused_why = why;
            status.payload_refused_joint = joint.map_or(0, |joint| joint as u32 + 1);
        }
    }

    fn carry(
        &mut self,
        config: &Config,
        hand: usize,
        order: &PayloadOrder,
        decided: &engage::Output,
    ) -> Result<Option<usize>, PayloadRefusal> {
        let center = order.centre_m.map(Into::into).or(config.model.payload[hand].map(|payload| payload.center));
        // A mass of zero needs no centre.
        let center = center.or((order.mass_kg == 0.0).then(Default::default));
        let one = Payload::new(order.mass_kg, center.unwrap_or_default())?;
        if center.is_none() {
            return Err(PayloadRefusal::NoCentre);
        }
        if decided.mode != Mode::Disengaged {
            return Err(PayloadRefusal::NotDisengaged);
        }
        if !decided.at_rest {
            return Err(PayloadRefusal::Moving);
        }
        let mut payload = self.commander.wbc().payload();
        payload[hand] = one;
        self.commander.carry(&config.wbc, &payload)
    }
}

/// Writes the payloads of the hands into the status.
pub(super) fn report(status: &mut Status, payload: &[Payload; 2]) {
    status.payload_kg = payload.map(|hand| hand.mass_kg);
    status.payload_centre_m = payload.map(|hand| hand.center.into());
}

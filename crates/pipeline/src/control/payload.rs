//! What the hands carry: what an operator says of it, and whether it is taken.

use super::{ControlConfig, ControlState};
use messages::{Mode, PayloadOrder, PayloadRefusal, Status};
use robot::Payload;
use safety::engage;

/// Why an order was refused, and the joint that could not hold the posture.
type Refused = (PayloadRefusal, Option<usize>);

impl ControlState {
    /// Takes what was said of the hands, or refuses it. A payload changes only while the robot is Disengaged and at rest, so
    /// no proof of a motion was made with another one.
    pub(super) fn take_payloads(
        &mut self,
        config: &ControlConfig,
        orders: &[Option<PayloadOrder>; 2],
        decided: &engage::Output,
    ) {
        for (hand, order) in orders.iter().enumerate() {
            let Some(order) = order else { continue };
            match self.carry(config, hand, order, decided) {
                Ok(()) => self.status.payloads_taken = self.status.payloads_taken.wrapping_add(1),
                Err((why, joint)) => {
                    let status = &mut self.status;
                    status.payloads_refused = status.payloads_refused.wrapping_add(1);
                    status.payload_refused_why = why as u32;
                    status.payload_refused_joint = joint.map_or(0, |joint| joint as u32 + 1);
                }
            }
        }
    }

    fn carry(
        &mut self,
        config: &ControlConfig,
        hand: usize,
        order: &PayloadOrder,
        decided: &engage::Output,
    ) -> Result<(), Refused> {
        let refuse = |why: PayloadRefusal| (why, None);
        let said = order.centre_m.map(Into::into).or(config.model.payload[hand].map(|payload| payload.center));
        // Where nothing is, it needs no place.
        let center = said.or((order.mass_kg == 0.0).then(Default::default));
        let one = Payload::new(order.mass_kg, center.unwrap_or_default()).map_err(refuse)?;
        if center.is_none() {
            return Err(refuse(PayloadRefusal::NoCentre));
        }
        if decided.mode != Mode::Disengaged {
            return Err(refuse(PayloadRefusal::NotDisengaged));
        }
        if !decided.at_rest {
            return Err(refuse(PayloadRefusal::Moving));
        }
        let mut payload = self.commander.wbc().payload();
        payload[hand] = one;
        self.commander.carry(&config.wbc, &payload)
    }
}

/// What the hands carry, in the status.
pub(super) fn note(status: &mut Status, payload: &[Payload; 2]) {
    status.payload_kg = payload.map(|hand| hand.mass_kg);
    status.payload_centre_m = payload.map(|hand| hand.center.into());
}

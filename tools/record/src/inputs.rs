//! Inputs of a control tick that are not messages, as JSON.

use messages::{Layout, PayloadOrder, Stamp, Status};
use robot::Names;
use safety::engage::OperatorView;
use serde_json::{Value, json};

/// Inputs of one control tick. The sequence numbers identify the messages that it took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Inputs {
    pub k: u64,
    pub now: Stamp,
    pub incarnation: u32,
    /// The operator, with the edges since the previous tick.
    pub operator: OperatorView,
    pub realtime_ok: bool,
    /// Sequence of the target that was taken. Zero means none.
    pub target: u64,
    /// Sequence of the policy's target that was taken. Zero means none.
    pub policy: u64,
    /// Sequence of the robot state that was taken. Zero means none.
    pub state: u64,
}

impl Inputs {
    pub fn to_json(&self) -> Value {
        let operator = &self.operator;
        json!({
            "k": self.k,
            "now_ns": self.now.0,
            "incarnation": self.incarnation,
            "realtime_ok": self.realtime_ok,
            "target_sequence": self.target,
            "policy_sequence": self.policy,
            "state_sequence": self.state,
            "operator": {
                "connected": operator.connected,
                "enable_level": operator.enable_level,
                "enable_edge": operator.enable_edge,
                "recover_level": operator.recover_level,
                "recover_edge": operator.recover_edge,
                "left_arm_left_out": operator.left_out[0],
                "right_arm_left_out": operator.left_out[1],
                "takes_over_left": operator.takes_over[0],
                "takes_over_right": operator.takes_over[1],
                "clutch_level": operator.clutch_level,
                "release_edge": operator.release_edge,
                "reset_edge": operator.reset_edge,
                "estop_edge": operator.estop_edge,
                "heartbeat_received_ns": operator.heartbeat_received.0,
                "payload_left": payload_json(operator.payload[0].as_ref()),
                "payload_right": payload_json(operator.payload[1].as_ref()),
            },
        })
    }

    /// Parses JSON. None if a key is missing or has another type.
    pub fn from_json(bytes: &[u8]) -> Option<Self> {
        let value: Value = serde_json::from_slice(bytes).ok()?;
        let number = |key: &str| value.get(key)?.as_u64();
        let operator = value.get("operator")?;
        let bit = |key: &str| operator.get(key)?.as_bool();
        let payload = |key: &str| payload_of(operator.get(key)?);
        Some(Self {
            k: number("k")?,
            now: Stamp(number("now_ns")?),
            incarnation: u32::try_from(number("incarnation")?).ok()?,
            realtime_ok: value.get("realtime_ok")?.as_bool()?,
            target: number("target_sequence")?,
            // Older recordings have none.
            policy: number("policy_sequence").unwrap_or_default(),
            state: number("state_sequence")?,
            operator: OperatorView {
                connected: bit("connected")?,
                enable_level: bit("enable_level")?,
                enable_edge: bit("enable_edge")?,
                recover_level: bit("recover_level")?,
                recover_edge: bit("recover_edge")?,
                // Older recordings have neither these nor the clutch.
                left_out: ["left_arm_left_out", "right_arm_left_out"].map(|key| bit(key).unwrap_or_default()),
                takes_over: ["takes_over_left", "takes_over_right"].map(|key| bit(key).unwrap_or_default()),
                clutch_level: bit("clutch_level").unwrap_or_default(),
                release_edge: bit("release_edge")?,
                reset_edge: bit("reset_edge")?,
                estop_edge: bit("estop_edge")?,
                heartbeat_received: Stamp(operator.get("heartbeat_received_ns")?.as_u64()?),
                payload: [payload("payload_left")?, payload("payload_right")?],
            },
        })
    }
}

/// Formats the payload order of one hand, as a list with one item or none. So its type is visible even without
/// an order.
fn payload_json(order: Option<&PayloadOrder>) -> Value {
    let item = |order: &PayloadOrder| json!({ "mass_kg": order.mass_kg, "centre_m": order.centre_m.unwrap_or_default(), "centre_said": order.centre_m.is_some() });
    Value::Array(order.map(item).into_iter().collect())
}

fn payload_of(value: &Value) -> Option<Option<PayloadOrder>> {
    let Some(item) = value.as_array()?.first() else { return Some(None) };
    let mut centre_m = [0.0; 3];
    let numbers = item.get("centre_m")?.as_array()?;
    for (place, number) in centre_m.iter_mut().zip(numbers) {
        *place = number.as_f64()?;
    }
    let has_centre = item.get("centre_said")?.as_bool()? && numbers.len() == 3;
    Some(Some(PayloadOrder { mass_kg: item.get("mass_kg")?.as_f64()?, centre_m: has_centre.then_some(centre_m) }))
}

pub(crate) fn example() -> Value {
    Inputs::default().to_json()
}

pub(crate) fn status_example() -> Value {
    let mut status = Status::ZERO;
    // One item in each list, so that its items have a type.
    (status.faults, status.latched, status.transition_count) = (1, 1, 1);
    explain::status_json(&status, &Names::default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_read_back_exactly_and_bad_json_is_refused() {
        let order = |centre_m| Some(PayloadOrder { mass_kg: 0.1 + 0.2, centre_m });
        let payload = [order(None), order(Some([0.1, -1.0 / 3.0, 1e-300]))];
        let operator = OperatorView {
            estop_edge: true,
            clutch_level: true,
            left_out: [false, true],
            heartbeat_received: Stamp(u64::MAX),
            payload,
            ..Default::default()
        };
        let inputs = Inputs {
            k: u64::MAX - 1,
            now: Stamp(7),
            incarnation: 3,
            operator,
            realtime_ok: true,
            target: 3,
            policy: 4,
            state: 0,
        };
        let text = inputs.to_json().to_string();
        assert_eq!(Inputs::from_json(text.as_bytes()), Some(inputs));
        assert_eq!(Inputs::from_json(text.replace("true", "1").as_bytes()), None);
        assert_eq!(Inputs::from_json(b"{"), None);
    }
}

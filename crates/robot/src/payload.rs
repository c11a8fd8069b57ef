//! The payload of a hand: a mass at a point that moves with the arm's last joint.

use crate::error::RobotError;
use crate::file::{PayloadEntry, Sides};
use crate::model::Source;
use messages::PayloadRefusal;
use nalgebra::Vector3;

/// Largest payload of a hand, kg. Assumption: more than any motor of these arms can lift.
pub const PAYLOAD_MAX_KG: f64 = 5.0;
/// Largest distance of a payload's centre from the origin of the hand's frame, m. Assumption: a tool of 0.3 m
/// beyond the fingers.
pub const PAYLOAD_REACH_MAX_M: f64 = 0.5;

/// A point mass in a hand. The hand's frame is that of the link that the arm's last joint moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Payload {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in the hand's frame, m.
    pub center: Vector3<f64>,
}

impl Payload {
    /// An empty hand.
    pub const EMPTY: Self = Self { mass_kg: 0.0, center: Vector3::new(0.0, 0.0, 0.0) };

    /// Creates a payload within the bounds. Never allocates.
    pub fn new(mass_kg: f64, center: Vector3<f64>) -> Result<Self, PayloadRefusal> {
        if !(0.0..=PAYLOAD_MAX_KG).contains(&mass_kg) {
            return Err(PayloadRefusal::Mass);
        }
        if !(center.norm() <= PAYLOAD_REACH_MAX_M) {
            return Err(PayloadRefusal::Centre);
        }
        Ok(Self { mass_kg, center })
    }
}

impl Source<'_> {
    /// The payloads of the left and the right hand. None if the file does not mention a hand.
    pub(crate) fn payloads(&self, file: &Sides<Option<PayloadEntry>>) -> Result<[Option<Payload>; 2], RobotError> {
        Ok([self.payload("left", file.left.as_ref())?, self.payload("right", file.right.as_ref())?])
    }

    fn payload(&self, side: &str, entry: Option<&PayloadEntry>) -> Result<Option<Payload>, RobotError> {
        let Some(PayloadEntry { mass_kg, centre_m }) = entry else { return Ok(None) };
        match Payload::new(*mass_kg, Vector3::from(*centre_m)) {
            Ok(payload) => Ok(Some(payload)),
            Err(PayloadRefusal::Mass) => {
                let bound = format!("must be 0 to {PAYLOAD_MAX_KG}");
                Err(self.value(&format!("payload.{side}.mass_kg"), schema::short(*mass_kg), bound))
            }
            Err(_) => {
                let bound = format!("must be at most {PAYLOAD_REACH_MAX_M} m from the origin of the hand's frame");
                Err(self.value(&format!("payload.{side}.centre_m"), format!("{centre_m:?}"), bound))
            }
        }
    }
}

//! Judges, once all faults are over, whether the robot does what the person does. Knows nothing of retargeting.
//! It compares directions of bones: the person's from the positions that the client sent, the target's from the
//! robot's kinematics.

use crate::modes::Broken;
use crate::oracle::Seen;
use messages::{JOINTS_MAX, Mode, Smpl, TICK_HZ, target_flag};
use nalgebra::{Matrix3, Vector3};

/// Ticks of following before the first judgement (`SETTLED`) and between judgements (`JUDGED`). By then the
/// robot has caught up, and the error that a single pose adds is averaged.
const SETTLED: u64 = TICK_HZ;
const JUDGED: u64 = TICK_HZ;
/// Largest mean angle between a bone of the person and that of its target, rad: three times the largest seen.
const ANGLE: f64 = 0.3;
/// Largest mean distance of a joint from its target, as far as limits let the joint reach it, rad. It applies
/// to runs without any fault, in which no posture is far away. The largest seen was 0.28, at a shoulder that
/// gives way to the robot's own body.
const BEHIND: f64 = 0.4;

#[derive(Clone, Default)]
pub struct PersonJudge {
    following: u64,
    person: Option<[Vector3<f64>; 4]>,
    count: u64,
    angles: [f64; 4],
    behind: [f64; JOINTS_MAX],
}

impl PersonJudge {
    pub fn check(&mut self, seen: &Seen<'_>, mode: Mode) -> Result<(), Broken> {
        if let Some(raw) = seen.sent.last() {
            self.person = bones(&|joint: Smpl| Vector3::from(raw.positions[joint as usize].map(f64::from)));
        }
        self.following =
            if seen.quiet && mode == Mode::Engaged && seen.policy.leads == 0 { self.following + 1 } else { 0 };
        if self.following <= SETTLED {
            (self.count, self.angles, self.behind) = (0, [0.0; 4], [0.0; JOINTS_MAX]);
            return Ok(());
        }
        let (Some(robot), Some(target), Some(person)) = (&seen.moment.robot, &seen.moment.target, &self.person) else {
            return Ok(());
        };
        self.count += 1;
        for (side, arm) in seen.robot.arms.iter().enumerate() {
            let q = arm.limb_values(&target.q);
            let (upper, fore) = arm.limb_rotations(&q);
            let bone = Vector3::y() * if side == 0 { 1.0 } else { -1.0 };
            for (limb, rotation) in [upper, fore].into_iter().enumerate() {
                let cos = (rotation * bone).dot(&person[2 * side + limb]);
                // A hand that touches as the person's does costs its limbs something (`retarget.contact_weight`).
                let is_own = target.flags & target_flag::TOUCHING[side] == 0;
                self.angles[2 * side + limb] += if is_own { cos.clamp(-1.0, 1.0).acos() } else { 0.0 };
            }
        }
        for j in (0..seen.robot.count).filter(|&j| target.valid_mask & 1 << j != 0) {
            let limits = &seen.robot.limits[j];
            self.behind[j] += (target.q[j].clamp(limits.q_min, limits.q_max) - robot.q[j]).abs();
        }
        if self.count >= JUDGED { self.judge(seen) } else { Ok(()) }
    }

    fn judge(&mut self, seen: &Seen<'_>) -> Result<(), Broken> {
        let mean = |sum: f64| sum / self.count as f64;
        let (angles, behind) = (self.angles.map(mean), self.behind.map(mean));
        (self.count, self.angles, self.behind) = (0, [0.0; 4], [0.0; JOINTS_MAX]);
        if let Some(limb) = (0..4).find(|&limb| angles[limb] > ANGLE) {
            return Err(("likeness", format!("limb {limb} is {} rad from the person's on average", angles[limb])));
        }
        let Some(j) = (0..seen.robot.count).find(|&j| seen.calm && behind[j] > BEHIND) else { return Ok(()) };
        Err(("likeness", format!("joint {j} is {} from its target on average", behind[j])))
    }
}

/// Directions of the four limbs in the frame of the chest (x forward, y left, z up).
fn bones(at: &dyn Fn(Smpl) -> Vector3<f64>) -> Option<[Vector3<f64>; 4]> {
    let (left, right) = (at(Smpl::LeftShoulder), at(Smpl::RightShoulder));
    let hips = (at(Smpl::LeftHip) + at(Smpl::RightHip)) / 2.0;
    let up = ((left + right) / 2.0 - hips).try_normalize(1e-3)?;
    let across = left - right;
    let y = (across - up * up.dot(&across)).try_normalize(1e-3)?;
    let chest = Matrix3::from_columns(&[y.cross(&up), y, up]);
    let bone = |from, to| (at(to) - at(from)).try_normalize(1e-3).map(|bone| chest.tr_mul(&bone));
    Some([
        bone(Smpl::LeftShoulder, Smpl::LeftElbow)?,
        bone(Smpl::LeftElbow, Smpl::LeftWrist)?,
        bone(Smpl::RightShoulder, Smpl::RightElbow)?,
        bone(Smpl::RightElbow, Smpl::RightWrist)?,
    ])
}

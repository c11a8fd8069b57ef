//! The messages of Unitree's `rt/arm_sdk` and `rt/lowstate`, as DDS types.
//!
//! The layouts are those of `unitree_hg` in unitree_sdk2. A message carries a CRC-32 with the polynomial 0x04c11db7. It begins
//! with ones, takes the highest bit first, and inverts nothing (CRC-32/MPEG-2). It goes over the 32-bit words of the struct
//! as C lays it out, without the last word, which is the CRC.
//!
//! The robot blends what it is sent with what its own controller wants, by a weight. The weight is the position of a motor
//! that is not there.

use crate::ros::RosType;
use dust_dds::infrastructure::type_support::DdsType;
use messages::JOINTS_MAX;
use robot::Motor;

pub const MOTORS: usize = 35;
/// Index of the motor whose position is the weight (`kNotUsedJoint` of unitree_sdk2).
pub const WEIGHT: usize = 29;
/// Mode of a motor that is enabled (xr_teleoperate).
const ENABLED: u8 = 1;
const POLYNOMIAL: u32 = 0x04c1_1db7;

/// `unitree_hg/MotorCmd`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct MotorCmd {
    /// 1 if the motor is enabled.
    pub mode: u8,
    /// Position, rad.
    pub q: f32,
    /// Velocity, rad/s.
    pub dq: f32,
    /// Torque, N m.
    pub tau: f32,
    /// Stiffness, N m/rad.
    pub kp: f32,
    /// Damping, N m s/rad.
    pub kd: f32,
    pub reserve: u32,
}

/// `unitree_hg/LowCmd`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct LowCmd {
    /// Control of the ankles: 0 is pitch and roll.
    pub mode_pr: u8,
    /// Robot type, as the state reports it.
    pub mode_machine: u8,
    pub motor_cmd: [MotorCmd; MOTORS],
    pub reserve: [u32; 4],
    pub crc: u32,
}

/// `unitree_hg/MotorState`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct MotorState {
    /// 1 if the motor is enabled.
    pub mode: u8,
    /// Position, rad.
    pub q: f32,
    /// Velocity, rad/s.
    pub dq: f32,
    /// Acceleration, torque, two temperatures in one word, voltage, sensors, state, reserve.
    pub rest: [u32; 11],
}

/// The beginning of `unitree_hg/LowState`. The rest is not read.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct LowState {
    pub version: [u32; 2],
    pub mode_pr: u8,
    /// Robot type.
    pub mode_machine: u8,
    pub tick: u32,
    /// Orientation, rates, accelerations, angles.
    pub imu: [f32; 13],
    pub imu_temperature: i16,
    pub motor_state: [MotorState; MOTORS],
}

impl RosType for LowCmd {
    const NAME: &'static str = "unitree_hg::msg::dds_::LowCmd_";
}

impl RosType for LowState {
    const NAME: &'static str = "unitree_hg::msg::dds_::LowState_";
}

impl LowCmd {
    /// The message that commands joint j, through its motor, to `q` (rad), with the torque `tau` that holds it there (N m), and
    /// a weight from 0 to 1. No velocity is commanded: a motor would go on pushing by it if messages end.
    ///
    /// The torque does not follow the weight. A robot that takes the weight for a switch would let the arms sag otherwise.
    pub fn new(
        mode_machine: u8,
        motors: &[Motor],
        q: &[f64; JOINTS_MAX],
        tau: &[f64; JOINTS_MAX],
        weight: f64,
    ) -> Self {
        let off = MotorCmd { mode: 0, q: 0.0, dq: 0.0, tau: 0.0, kp: 0.0, kd: 0.0, reserve: 0 };
        let mut motor_cmd: [MotorCmd; MOTORS] = std::array::from_fn(|_| off.clone());
        for ((motor, q), tau) in motors.iter().zip(q).zip(tau) {
            if let Some(to) = motor_cmd.get_mut(motor.index as usize) {
                (to.mode, to.q, to.tau) = (ENABLED, *q as f32, *tau as f32);
                (to.kp, to.kd) = (motor.stiffness_n_m_per_rad as f32, motor.damping_n_m_s_per_rad as f32);
            }
        }
        motor_cmd[WEIGHT].q = weight as f32;
        let mut message = Self { mode_pr: 0, mode_machine, motor_cmd, reserve: [0; 4], crc: 0 };
        message.crc = crc(message.words());
        message
    }

    /// The words of the struct before the CRC.
    fn words(&self) -> impl Iterator<Item = u32> {
        let first = u32::from_le_bytes([self.mode_pr, self.mode_machine, 0, 0]);
        let motors = self.motor_cmd.iter().flat_map(|motor| {
            let [q, dq, tau, kp, kd] = [motor.q, motor.dq, motor.tau, motor.kp, motor.kd].map(f32::to_bits);
            [u32::from(motor.mode), q, dq, tau, kp, kd, motor.reserve]
        });
        std::iter::once(first).chain(motors).chain(self.reserve)
    }
}

fn crc(words: impl Iterator<Item = u32>) -> u32 {
    words.fold(u32::MAX, |crc, word| {
        (0..32).fold(crc ^ word, |crc, _| if crc >> 31 == 1 { crc << 1 ^ POLYNOMIAL } else { crc << 1 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motor(index: u32, stiffness_n_m_per_rad: f64, damping_n_m_s_per_rad: f64) -> Motor {
        Motor { index, stiffness_n_m_per_rad, damping_n_m_s_per_rad }
    }

    #[test]
    fn crc_is_that_of_a_long_division_in_python() {
        // The remainder of integers by 0x104c11db7. The same program gives the published 0x0376e6e7 for "123456789".
        assert_eq!(crc([].into_iter()), 0xffff_ffff);
        assert_eq!(crc([0].into_iter()), 0xc704_dd7b);
        assert_eq!(crc([1, 2, 3].into_iter()), 0x64c5_1784);
        assert_eq!(crc([0x3132_3334, 0x3536_3738].into_iter()), 0x49e3_c2fb);
        assert_eq!(LowCmd::new(0, &[], &[0.0; JOINTS_MAX], &[0.0; JOINTS_MAX], 0.0).crc, 0xfe17_2f9f);
        let (mut q, motors) = ([0.0; JOINTS_MAX], [motor(15, 80.0, 3.0), motor(28, 40.0, 1.5)]);
        (q[0], q[1]) = (0.5, -1.25);
        assert_eq!(LowCmd::new(5, &motors, &q, &[0.0; JOINTS_MAX], 0.75).crc, 0xc233_9699);
    }

    #[test]
    fn joints_reach_their_motors_and_no_other_is_enabled() {
        let q = std::array::from_fn(|j| 0.1 * (j + 1) as f64);
        let message = LowCmd::new(5, &[motor(22, 80.0, 3.0), motor(12, 300.0, 3.0)], &q, &q.map(|q| -q), 0.25);
        assert_eq!((message.mode_pr, message.mode_machine, message.words().count()), (0, 5, 250));
        for (index, sent) in message.motor_cmd.iter().enumerate() {
            let expected = match index {
                22 => (1, 0.1, -0.1, 80.0, 3.0),
                12 => (1, 0.2, -0.2, 300.0, 3.0),
                WEIGHT => (0, 0.25, 0.0, 0.0, 0.0),
                _ => (0, 0.0, 0.0, 0.0, 0.0),
            };
            assert_eq!((sent.mode, sent.q, sent.tau, sent.kp, sent.kd), expected, "motor {index}");
            assert_eq!((sent.dq, sent.reserve), (0.0, 0));
        }
    }
}

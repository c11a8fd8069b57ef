//! The driver's port to the simulated robot, which is a process of its own: `teleopd robot`.

use super::bus_failure;
use super::driver::{ANSWERS_WITHIN_NS, LOOK_NS};
use crate::cli::InstanceArgs;
use bus::{Domain, Reader, Writer};
use driver::{Driver, Drives, Measured, Setpoint};
use messages::{
    GripperMotion, GripperState, Header, Layout, RobotId, RobotMeasured, RobotSetpoint, Service, Stamp, StopPlan,
    measured_flag,
};
use rt::{Exit, Failure};
use std::os::unix::process::CommandExt;
use std::process::Command;

/// Set in the environment of a driver's own program, so that a program that starts this one again is refused.
const STARTED: &str = "TELEOPD_DRIVER_PROGRAM";

struct RemoteRobot {
    setpoints: Writer<RobotSetpoint>,
    measurements: Reader<RobotMeasured>,
    newest: RobotMeasured,
    /// Index of the last setpoint sent.
    sent_k: u64,
    /// Header of the driver's messages. The sender fills in sequence and stamp.
    header: Header,
    robot: RobotId,
    grippers: GripperMotion,
}

impl RemoteRobot {
    /// Waits for the robot's first measurement.
    fn find(core: &Domain, header: Header, robot: RobotId) -> Result<Self, Failure> {
        let setpoints = core.writer::<RobotSetpoint>(Service::RobotSetpoint).map_err(bus_failure)?;
        let mut measurements = core.reader::<RobotMeasured>(Service::RobotMeasured).map_err(bus_failure)?;
        let give_up = rt::now().plus_ns(ANSWERS_WITHIN_NS);
        while rt::now() < give_up {
            if let Some(newest) = measurements.latest() {
                if newest.robot != robot {
                    let text = format!("the robot that answers is {}, this driver is for {robot}", newest.robot);
                    return Err(Failure::new(Exit::Config, text));
                }
                return Ok(Self {
                    setpoints,
                    measurements,
                    newest,
                    sent_k: 0,
                    header,
                    robot,
                    grippers: GripperMotion::ZERO,
                });
            }
            rt::sleep_until(rt::now().plus_ns(LOOK_NS));
        }
        let text = format!(
            "no robot answered within {} s; start `teleopd robot` before this one (`up` and `demo` do so)",
            ANSWERS_WITHIN_NS / 1_000_000_000
        );
        Err(Failure::new(Exit::Unavailable, text))
    }
}

impl Driver for RemoteRobot {
    fn read(&mut self, _now: Stamp) -> Measured {
        let newest = rt::allocating_aside(|| self.measurements.latest());
        // A measurement of another robot is none: the driver notices the silence.
        if let Some(newest) = newest.filter(|newest| newest.robot == self.robot) {
            self.newest = newest;
        }
        let RobotMeasured { measured, q, dq, flags, seen_k, .. } = self.newest;
        let has = |bit: u32| flags & bit != 0;
        let drives = Drives {
            emergency_stop: has(measured_flag::EMERGENCY_STOP),
            fault: has(measured_flag::DRIVE_FAULT),
            powered: has(measured_flag::POWERED),
        };
        Measured {
            stamp: measured,
            q,
            dq,
            drives,
            unanswered: self.sent_k > seen_k,
            refused: has(measured_flag::REFUSED),
        }
    }

    /// Sends a setpoint. Its answer comes with the next measurement, so the one read now belongs to an earlier
    /// setpoint.
    fn write(&mut self, now: Stamp, setpoint: &Setpoint, plan: &StopPlan) -> bool {
        self.header.sequence += 1;
        self.header.stamp = now;
        let &Setpoint { k, q, v, a } = setpoint;
        let (header, robot, plan, grippers) = (self.header, self.robot, *plan, self.grippers);
        let message = RobotSetpoint { header, robot, k, q, v, a, plan, grippers };
        let sent = rt::allocating_aside(|| self.setpoints.publish(&message)).is_ok();
        if sent {
            self.sent_k = k;
        }
        sent && self.newest.flags & measured_flag::REFUSED == 0
    }

    fn grip(&mut self, grippers: &GripperMotion) {
        self.grippers = *grippers;
    }

    fn gripped(&self) -> Option<GripperState> {
        Some(self.newest.grippers)
    }
}

/// Drives the simulated robot, or becomes the program that the settings name in place of this one.
pub fn run(place: &InstanceArgs) -> Result<(), Failure> {
    let settings = config::read_settings(&place.config, &place.overrides()).map_err(Failure::with(Exit::Config))?;
    if let Some(program) = settings.driver_program(&place.config) {
        if std::env::var_os(STARTED).is_some() {
            let text = format!("driver.program = {:?} starts `teleopd driver` again", settings.driver.program);
            return Err(Failure::new(Exit::Config, text));
        }
        // A child of `up` ends with it, whatever program it becomes.
        rt::die_with_parent();
        // The subcommand is dropped, its options are passed on.
        let cause = Command::new(&program).args(std::env::args_os().skip(2)).env(STARTED, "1").exec();
        let text = format!(
            "{}: driver.program = {:?} cannot be started: {cause}. Name a program that this user may run, or leave it \
             empty for the simulated robot",
            place.config.display(),
            settings.driver.program
        );
        return Err(Failure::new(Exit::Config, text));
    }
    super::driver::run(place, None, |process, core| {
        RemoteRobot::find(core, process.header(0, Stamp::NONE, Stamp::NONE), process.loaded.model.id())
    })
}

//! The joints of a running instance as topics of ROS 2, for programs that watch: `/joint_states` and `/robot_description`.
//! It reads `Joints`, publishes them, and does nothing else. A program that reads slowly loses messages.

use crate::cli::States;
use crate::dds::{failed, join_domain, latched_qos, open_writer, writer_qos};
use crate::discovery::count_publishers;
use crate::ros::{Header, JointState, Text, Time, topic};
use dust_dds::infrastructure::listener::NO_LISTENER;
use dust_dds::infrastructure::qos::QosKind;
use dust_dds::infrastructure::status::NO_STATUS;
use instance::Instance;
use messages::{Joints, Service, joints_flag};
use robot::Model;
use rt::{Exit, Failure, Shutdown};
use std::time::{Duration, Instant, SystemTime};

/// Period of the joints, ns.
const EVERY_NS: u64 = 10_000_000;
/// Periods between two looks at who else publishes joint states: 1 s, twice the time between two announcements.
const LOOK_EVERY: u64 = 100;
/// Time limit of the search for a running instance. Assumption: a thousand processes took 0.1 s.
const SEARCH: Duration = Duration::from_secs(5);

/// Publishes until a signal ends it.
pub fn publish(options: &States) -> Result<(), Failure> {
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let overrides = config::Overrides::robot(options.robot.as_ref());
    let (settings, model) = config::load_robot(&options.config, &overrides).map_err(Failure::with(Exit::Config))?;
    let (instance, folder) = (Instance::unmade(&options.run_dir), options.run_dir.display());
    if !bus::is_inhabited(&instance.input_domain().prefix, Instant::now() + SEARCH) {
        let text = format!("no instance of teleopd runs in {folder}: start `teleopd up --run-dir {folder}`");
        return Err(Failure::new(Exit::Unavailable, text));
    }
    let unavailable = Failure::with::<String>(Exit::Unavailable);
    let domain = bus::Domain::open(instance.input_domain(), "states").map_err(Failure::with(Exit::Unavailable))?;
    let mut reader = domain.reader::<Joints>(Service::Joints).map_err(Failure::with(Exit::Unavailable))?;
    let [member, _] = join_domain(&settings.ros2).map_err(unavailable)?;
    let publisher = member.participant.create_publisher(QosKind::Default, NO_LISTENER, NO_STATUS);
    let publisher = publisher.map_err(failed("publisher")).map_err(unavailable)?;
    let name = &settings.ros2.joint_states_topic;
    let states = open_writer::<JointState>(&member, &publisher, name, writer_qos()).map_err(unavailable)?;
    let description =
        open_writer::<Text>(&member, &publisher, "/robot_description", latched_qos()).map_err(unavailable)?;
    let (own, builtin) = (states.get_instance_handle().into(), member.participant.get_builtin_subscriber());
    // Others announce themselves meanwhile.
    let mut due = rt::now().plus_ns(LOOK_EVERY * EVERY_NS);
    for round in 0_u64.. {
        if !shutdown.sleep_until(due) {
            break;
        }
        due = due.max(rt::now()).plus_ns(EVERY_NS);
        // Two publishers would show two robots, and a driver that listens would believe both.
        if round.is_multiple_of(LOOK_EVERY) && count_publishers(&builtin, &topic(name), own) > 0 {
            let text =
                format!("a robot or another program publishes {name} in this domain: set another ros2.domain_id");
            return Err(unavailable(text));
        }
        if round == 0 {
            let _ = description.write(Text { data: model.texts.urdf.clone() }, None);
            rt::out!("teleopd-ros2: publishes {name} and /robot_description; Ctrl-C ends");
        }
        let Some(joints) = reader.latest().filter(|joints| joints.known & joints_flag::STATE != 0) else { continue };
        if joints.robot != model.id() {
            let text = format!("the instance in {folder} drives another robot than {}: give its --robot", model.name);
            return Err(Failure::new(Exit::Config, text));
        }
        // Nobody may listen, or too slowly. The next one comes in 10 ms.
        let _ = states.write(state(&model, &joints), None);
    }
    Ok(())
}

/// The measured joints, with the time of the wall clock at which they were published.
fn state(model: &Model, joints: &Joints) -> JointState {
    let wall = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    let age_ns = rt::now().since(joints.header.stamp);
    let stamp = Time::from_ns(i64::try_from(wall.as_nanos()).unwrap_or(0).saturating_sub_unsigned(age_ns));
    JointState {
        header: Header { stamp, frame_id: String::new() },
        name: model.joint_names[..model.count].to_vec(),
        position: joints.measured[..model.count].to_vec(),
        velocity: joints.measured_v[..model.count].to_vec(),
        effort: Vec::new(),
    }
}

//! The command line.

use crate::link::Name;
use clap::{Args, Parser, Subcommand};
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

/// Receives from a motion capture program, and publishes the person that it sends. Links an operator's machine to the
/// robot's.
#[derive(Debug, Parser)]
#[command(name = "teleop-bridge", version)]
pub struct Cli {
    /// The motion capture program, or the link.
    #[command(subcommand)]
    pub program: Program,
}

/// The supported motion capture programs, and the link.
#[derive(Debug, Subcommand)]
pub enum Program {
    /// Xsens MVN: its network streamer, with "Position + Orientation (Quaternion)" selected.
    Mvn {
        /// Address to listen on. Other machines reach it only if it is not a loopback address.
        #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:9763")]
        bind: SocketAddr,
        /// The character of the scene (default: the first that arrives).
        #[arg(long, value_name = "ID")]
        character: Option<u8>,
        /// Allowed senders, and output.
        #[command(flatten)]
        to: To,
    },
    /// VMC, the protocol of VirtualMotionCapture, VSeeFace, Warudo and others.
    Vmc {
        /// Address to listen on. Other machines reach it only if it is not a loopback address.
        #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:39539")]
        bind: SocketAddr,
        /// Allowed senders, and output.
        #[command(flatten)]
        to: To,
    },
    /// A link between an operator's machine and the robot's.
    #[command(subcommand)]
    Link(Link),
}

/// The ends of a link, and its certificates.
#[derive(Debug, Subcommand)]
pub enum Link {
    /// The robot's end: runs beside teleopd, as a client of it.
    Robot(LinkRobot),
    /// The operator's end: clients on this machine find the robot in its folder.
    Operator(LinkOperator),
    /// A router between a robot and its operators. It passes on what the robot would admit.
    Router(LinkRouter),
    /// Makes the certificates, at the robot.
    #[command(subcommand)]
    Pair(Pair),
}

/// Arguments of the robot's end.
#[derive(Args, Debug)]
pub struct LinkRobot {
    /// Folder with the keys that `teleop-bridge link pair` made.
    #[arg(long, value_name = "DIR", default_value = "link-keys")]
    pub keys: PathBuf,
    /// Address to listen on: quic/HOST:PORT.
    #[arg(long, value_name = "ADDRESS", required_unless_present = "connect")]
    pub listen: Vec<String>,
    /// Address of a router to connect to: quic/HOST:PORT.
    #[arg(long, value_name = "ADDRESS")]
    pub connect: Vec<String>,
    /// Folder of the running instance.
    #[arg(long, value_name = "DIR", default_value_os_t = instance::default_run_dir())]
    pub run_dir: PathBuf,
}

/// Arguments of the operator's end.
#[derive(Args, Debug)]
pub struct LinkOperator {
    /// Bundle that `teleop-bridge link pair operator` made.
    #[arg(long, value_name = "FILE")]
    pub bundle: PathBuf,
    /// Address of the robot, or of a router: quic/HOST:PORT.
    #[arg(long, value_name = "ADDRESS", required = true)]
    pub connect: Vec<String>,
    /// Folder for the sockets of this end. No instance of teleopd may run there.
    #[arg(long, value_name = "DIR")]
    pub run_dir: PathBuf,
}

/// Arguments of a router.
#[derive(Args, Debug)]
pub struct LinkRouter {
    /// Bundle that `teleop-bridge link pair router` made.
    #[arg(long, value_name = "FILE")]
    pub bundle: PathBuf,
    /// Copy of the folder `operators` of the robot's keys.
    #[arg(long, value_name = "DIR")]
    pub operators: PathBuf,
    /// Address to listen on: quic/HOST:PORT.
    #[arg(long, value_name = "ADDRESS", required = true)]
    pub listen: Vec<String>,
}

/// Owner of the certificate to make.
#[derive(Debug, Subcommand)]
pub enum Pair {
    /// The robot: its authority and its certificate. Once, at first.
    Robot {
        /// Name of the robot: a-z, 0-9, - and _.
        #[arg(long)]
        name: Name,
        /// Folder for the keys.
        #[arg(long, value_name = "DIR", default_value = "link-keys")]
        keys: PathBuf,
    },
    /// An operator: a bundle to copy to the operator's machine.
    Operator {
        /// Name of the operator: a-z, 0-9, - and _.
        #[arg(long)]
        name: Name,
        /// Folder with the robot's keys.
        #[arg(long, value_name = "DIR", default_value = "link-keys")]
        keys: PathBuf,
    },
    /// A router, where robot and operators reach only a third machine.
    Router {
        /// Folder with the robot's keys.
        #[arg(long, value_name = "DIR", default_value = "link-keys")]
        keys: PathBuf,
    },
    /// Prints the names and the code of a bundle, to compare.
    Show {
        /// The bundle.
        bundle: PathBuf,
    },
}

/// Allowed senders, and output.
#[derive(Args, Debug)]
pub struct To {
    /// Accept packets from this address only.
    #[arg(long, value_name = "IP")]
    pub from: Option<IpAddr>,
    /// Accept every user of this machine. Without it, a sender on this machine must belong to the user that
    /// runs this program, or to root. Packets of other users are rejected and counted. The user of a sender on
    /// another machine is not checked: see --from.
    #[arg(long)]
    pub any_user: bool,
    /// Folder of the running instance.
    #[arg(long, value_name = "DIR", default_value_os_t = instance::default_run_dir())]
    pub run_dir: PathBuf,
    /// Publish through this socket of `ingest` instead of shared memory. It works for a user that is not the daemon's.
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
}

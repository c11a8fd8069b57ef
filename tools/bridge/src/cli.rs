//! The command line.

use clap::{Args, Parser, Subcommand};
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

/// Listens to a motion capture program, and publishes the person that it sends.
#[derive(Debug, Parser)]
#[command(name = "bridge", version)]
pub struct Cli {
    /// What is listened to.
    #[command(subcommand)]
    pub program: Program,
}

/// What is listened to.
#[derive(Debug, Subcommand)]
pub enum Program {
    /// Xsens MVN: its network streamer, with "Position + Orientation (Quaternion)" chosen.
    Mvn {
        /// Where to listen; other machines reach it only where this is not a loopback address.
        #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:9763")]
        bind: SocketAddr,
        /// The character of the scene (default: the first that is seen).
        #[arg(long, value_name = "ID")]
        character: Option<u8>,
        /// Whom to listen to, and where to publish.
        #[command(flatten)]
        to: To,
    },
    /// VMC, the protocol of VirtualMotionCapture, VSeeFace, Warudo and others.
    Vmc {
        /// Where to listen; other machines reach it only where this is not a loopback address.
        #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:39539")]
        bind: SocketAddr,
        /// Whom to listen to, and where to publish.
        #[command(flatten)]
        to: To,
    },
}

/// Whom to listen to, and where to publish.
#[derive(Args, Debug)]
pub struct To {
    /// Listens to this address alone.
    #[arg(long, value_name = "IP")]
    pub from: Option<IpAddr>,
    /// Listens to every user of this machine. Without it, a sender on this machine has to be of the user that runs this, or
    /// root; one of another user is refused and counted. What other machines send is not asked for its user: see --from.
    #[arg(long)]
    pub any_user: bool,
    /// Folder of the running instance.
    #[arg(long, value_name = "DIR", default_value_os_t = pipeline::default_run_dir())]
    pub run_dir: PathBuf,
    /// Publishes through this socket of `ingest` instead of shared memory: as a user that is not the daemon's.
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
}

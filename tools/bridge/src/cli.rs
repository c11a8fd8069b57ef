//! The command line.

use clap::{Args, Parser, Subcommand};
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

/// Receives from a motion capture program, and publishes the person that it sends.
#[derive(Debug, Parser)]
#[command(name = "bridge", version)]
pub struct Cli {
    /// The motion capture program.
    #[command(subcommand)]
    pub program: Program,
}

/// The supported motion capture programs.
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
    /// Publish through this socket of `ingest` instead of shared memory. It works for a user that is not the
    /// daemon's.
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
}

//! `keyposes motions` writes the named motions, `keyposes interpolate` a joint trajectory between poses, `keyposes draw`
//! stick figures.

use clap::{Parser, Subcommand};
use keyposes::error::KeyposesError;
use keyposes::{draw, motions, trajectory, write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Named key poses, and interpolation between poses in the latent space.
#[derive(Parser)]
#[command(version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Writes each named motion as .bvh, and beside it the best joint trajectory as .csv.
    Motions {
        /// The folder; made if it is missing.
        #[arg(long, value_name = "DIR", default_value = "tools/keyposes/motions")]
        out: PathBuf,
        /// Robot file.
        #[arg(long, value_name = "FILE", default_value = "config/robots/tiago_dual.toml")]
        robot: PathBuf,
    },
    /// Draws stick figures of a motion, as SVG.
    Draw {
        /// The motion file (.bvh).
        file: PathBuf,
        /// The picture.
        #[arg(long, value_name = "FILE.svg")]
        out: PathBuf,
        /// Number of instants, 1 to 40.
        #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u8).range(1..=40))]
        count: u8,
    },
}

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Motions { out, robot } => write_motions(&out, &robot),
        Command::Draw { file, out, count } => draw_file(&file, &out, usize::from(count)),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("keyposes: {error}");
            // EX_DATAERR of sysexits(3).
            ExitCode::from(65)
        }
    }
}

fn save(path: &Path, text: &str) -> Result<(), KeyposesError> {
    std::fs::write(path, text).map_err(|source| KeyposesError::File { path: path.to_path_buf(), source })
}

fn write_motions(out: &Path, robot: &Path) -> Result<(), KeyposesError> {
    let (model, _) = pipeline::load_model(robot)?;
    std::fs::create_dir_all(out).map_err(|source| KeyposesError::File { path: out.to_path_buf(), source })?;
    for motion in motions::paper_motions() {
        let truth = trajectory::ground_truth(&model, &motion);
        save(&out.join(format!("{}.bvh", motion.name)), &write::compact_bvh(&motion))?;
        save(&out.join(format!("{}.csv", motion.name)), &write::trajectory_csv(&truth))?;
        println!("{:<18} {:>4} frames, {:.1} s", motion.name, motion.frames.len(), motion.duration_s());
    }
    Ok(())
}

fn draw_file(file: &Path, out: &Path, count: usize) -> Result<(), KeyposesError> {
    let motion = motion::load(file)?;
    save(out, &draw::svg(&motion, count))
}

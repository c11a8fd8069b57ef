//! Makes and checks the content of a robot file beyond its URDF.

// `println` panics if the reader has closed the pipe.
#![deny(clippy::print_stdout)]

mod command_cover;
mod command_limits;

use clap::{Parser, Subcommand};
use collision::check::{capsules_in_frame, collision_share, deviations_m, reasons, sticks_out_m};
use collision::error::{CollisionError, read_text};
use collision::first::first_plan;
use collision::judge::Judge;
use collision::plan::{Plan, SIDE};
use collision::scene::{Posture, Scene};
use collision::write::{Named, bare_model, fit_all, robot_file, tightened};
use robot::{AllowedReason, Frames, Model};
use rt::{Exit, Failure, err, out};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Fits and checks the capsules of a robot file, and finds the accelerations that its motors can give.
#[derive(Parser)]
#[command(version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Fit capsules around the meshes and primitives of a URDF, and decide which pairs need no check.
    Fit {
        #[command(flatten)]
        source: Source,
        /// Write the robot file here instead of to standard output.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Write the plan here, to edit it and to fit again.
        #[arg(long)]
        plan_out: Option<PathBuf>,
    },
    /// Verify containment and the reason of every pair that is not checked, and that a new fit gives the same
    /// result.
    Check {
        #[command(flatten)]
        source: Source,
        /// Write a new record of the fit into the robot file, if all holds.
        #[arg(long)]
        sign: bool,
    },
    /// Print how far the shape of each link sticks out of its capsules, the worst first, and how much larger the
    /// capsules are.
    Cover(command_cover::Cover),
    /// Print torques by inverse dynamics at the limits in force, or the accelerations that the motors can
    /// always give.
    Limits(command_limits::Limits),
}

#[derive(clap::Args)]
struct Source {
    /// URDF whose links have the meshes or primitives. It may be the manufacturer's, if links and joints agree.
    /// Each further URDF adds the links that the previous ones do not have.
    #[arg(long, required = true)]
    urdf: Vec<PathBuf>,
    /// Folder of the meshes. The part after `/meshes/` in the URDF's file names is looked up in it.
    #[arg(long)]
    meshes: Option<PathBuf>,
    /// Robot file. It names the URDF that defines limits and kinematics.
    #[arg(long, default_value = "config/robots/tiago_dual.toml")]
    robot: PathBuf,
    /// Plan: which links share capsules, and how many. Without it the tool makes one, and says which pairs are
    /// near.
    #[arg(long)]
    plan: Option<PathBuf>,
}

/// Difference by which a fit on another machine may differ, because rounding affects the search, m.
const SAME_FIT_M: f64 = 5e-4;

fn main() -> ExitCode {
    rt::abort_on_panic();
    let done = match Arguments::parse().command {
        Command::Fit { source, out, plan_out } => fit(&source, out.as_deref(), plan_out.as_deref()),
        Command::Check { source, sign } => check(&source, sign),
        Command::Cover(options) => command_cover::cover(&options),
        Command::Limits(options) => command_limits::limits(&options),
    };
    rt::finish("collision", done.map_err(Failure::with(Exit::DataErr)))
}

type NamedText = (String, String);

struct Texts {
    plan: Plan,
    /// The capsules of a plan that the tool made.
    first: Option<Vec<Named>>,
    notes: Vec<String>,
    /// Joints with their unit and the narrower range that the plan needs.
    narrower: Vec<(String, &'static str, [f64; 2])>,
    shapes: urdf_rs::Robot,
    held: Posture,
    toml: NamedText,
    urdf: NamedText,
}

impl Texts {
    fn scene<'a>(&'a self, source: &'a Source) -> Scene<'a> {
        Scene::new(&self.shapes, source.meshes.as_deref(), &self.plan.fingers).holding(self.held.clone())
    }
}

/// The robot file's keys that a plan needs before there are capsules.
#[derive(serde::Deserialize)]
struct Head {
    base_link: String,
    #[serde(default)]
    held_rad: Posture,
    #[serde(default)]
    held_m: Posture,
}

fn read_all(source: &Source) -> Result<Texts, CollisionError> {
    let shapes = parse_all(&source.urdf)?;
    let (toml, urdf) = robot_texts(&source.robot)?;
    let (base_link, held) = held(&toml)?;
    let mut narrower = Vec::new();
    let (plan, first, notes) = match &source.plan {
        Some(path) => (Plan::parse(&path.display().to_string(), &read_text(path)?)?, None, Vec::new()),
        None => {
            let model = bare_model(&base_link, (&toml.0, &toml.1), (&urdf.0, &urdf.1))?;
            let first = first_plan(&model, &shapes, source.meshes.as_deref(), &held)?;
            for j in (0..model.count).filter(|j| model.limits[*j] != first.narrowed.limits[*j]) {
                let (limits, unit) = (first.narrowed.limits[j], if model.prismatic[j] { "m" } else { "rad" });
                narrower.push((model.joint_names[j].clone(), unit, [limits.q_min, limits.q_max]));
            }
            (first.plan, Some(first.capsules), first.notes)
        }
    };
    Ok(Texts { plan, first, notes, narrower, shapes, held, toml, urdf })
}

/// Returns a robot file's base link, and the positions of the joints that nothing commands.
fn held(toml: &NamedText) -> Result<(String, Posture), CollisionError> {
    let head: Head =
        toml::from_str(&toml.1).map_err(|error| CollisionError::content(toml.0.as_str(), error.to_string()))?;
    Ok((head.base_link, head.held_rad.into_iter().chain(head.held_m).collect()))
}

/// Returns the first URDF, with the links and joints of the others that it lacks.
fn parse_all(paths: &[PathBuf]) -> Result<urdf_rs::Robot, CollisionError> {
    let mut merged: Option<urdf_rs::Robot> = None;
    for path in paths {
        let robot = robot::read_urdf(&path.display().to_string(), &read_text(path)?)?;
        merged = Some(match merged {
            None => robot,
            Some(mut first) => {
                let new = |child: &str| !first.links.iter().any(|link| link.name == child);
                let joints: Vec<_> = robot.joints.into_iter().filter(|joint| new(&joint.child.link)).collect();
                let links: Vec<_> = robot.links.into_iter().filter(|link| new(&link.name)).collect();
                first.joints.extend(joints);
                first.links.extend(links);
                first
            }
        });
    }
    merged.ok_or_else(|| CollisionError::content("arguments", "--urdf is missing"))
}

fn robot_texts(path: &Path) -> Result<(NamedText, NamedText), CollisionError> {
    let name = |path: &Path| path.display().to_string();
    let toml = (name(path), read_text(path)?);
    let urdf_path = own_urdf(path, &toml.1)?;
    let urdf = (name(&urdf_path), read_text(&urdf_path)?);
    Ok((toml, urdf))
}

fn own_urdf(path: &Path, toml: &str) -> Result<PathBuf, CollisionError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    Ok(folder.join(robot::urdf_file(&path.display().to_string(), toml)?))
}

fn write_text(path: &Path, text: &str) -> Result<(), CollisionError> {
    std::fs::write(path, text).map_err(|cause| CollisionError::Write { path: path.to_path_buf(), cause })
}

fn fit(source: &Source, out: Option<&Path>, plan_out: Option<&Path>) -> Result<bool, CollisionError> {
    let mut texts = read_all(source)?;
    texts.notes.iter().for_each(|note| err!("{note}"));
    for (joint, unit, range) in std::mem::take(&mut texts.narrower) {
        texts.toml.1 = tightened(&texts.toml.1, &joint, unit, range);
        // Rounded inward, so that a file takes what is printed.
        let [least, most] = [(range[0] * 1e4).ceil() / 1e4, (range[1] * 1e4).floor() / 1e4];
        err!("narrowed, so that parts never touch: {joint} to {least:.4} .. {most:.4} {unit} ([tighten])");
    }
    if let Some(path) = plan_out {
        write_text(path, &texts.plan.text())?;
    }
    let drawn = texts.shapes.links.iter().filter(|link| link.collision.is_empty() && !link.visual.is_empty());
    let drawn: Vec<&str> = drawn.map(|link| link.name.as_str()).collect();
    if !drawn.is_empty() {
        err!("enclosed as drawn, for want of a collision shape: {}", drawn.join(", "));
    }
    let capsules = match texts.first.take() {
        Some(capsules) => capsules,
        None => fit_all(&texts.plan, &texts.scene(source))?,
    };
    if capsules.is_empty() {
        let cause = "no link has a collision shape: give --meshes, or the manufacturer's URDF";
        return Err(CollisionError::content(source.urdf[0].display().to_string(), cause));
    }
    let wide = capsules.iter().map(|capsule| capsule.name.len()).max().unwrap_or(0);
    for capsule in &capsules {
        err!(
            "{:wide$} radius {:5.1} mm  length {:5.1} mm  volume ratio {:.2}",
            capsule.name,
            capsule.shape.radius_m * 1e3,
            (capsule.shape.b - capsule.shape.a).norm() * 1e3,
            capsule.volume_ratio
        );
    }
    for link in links(&capsules) {
        let of = |capsule: &&Named| link.is_none_or(|link| capsule.link == link);
        let (mut capsule_m3, mut hull_m3) = (0.0, 0.0);
        for capsule in capsules.iter().filter(of).filter(|capsule| capsule.volume_ratio.is_finite()) {
            capsule_m3 += capsule.volume_m3;
            hull_m3 += capsule.volume_m3 / capsule.volume_ratio;
        }
        err!("{:wide$} volume ratio {:.2}", link.unwrap_or("total"), capsule_m3 / hull_m3);
    }
    let mut ratios: Vec<f64> = capsules.iter().map(|capsule| capsule.volume_ratio).collect();
    ratios.sort_by(f64::total_cmp);
    err!("{} capsules, median volume ratio {:.2}", ratios.len(), ratios[ratios.len() / 2]);
    let (toml, urdf) = (&texts.toml, &texts.urdf);
    check_arms(&bare_model(&capsules[0].link, (&toml.0, &toml.1), (&urdf.0, &urdf.1))?, &capsules, source)?;
    let decided = robot_file(&texts.plan, &capsules, (&toml.0, &toml.1), (&urdf.0, &urdf.1))?;
    for (a, b, clearance_m) in &decided.near_home {
        err!("near at home: {a} - {b} {:.1} mm", clearance_m * 1e3);
    }
    // An invalid file is written too, without a record, so that it can be inspected.
    let model = Model::from_text(&toml.0, &decided.text, &urdf.0, &urdf.1);
    let text = model.as_ref().ok().map_or(Ok(decided.text), Model::signed)?;
    match out {
        Some(path) => write_text(path, &text)?,
        None => out!("{text}"),
    }
    let model = model?;
    summary(&model);
    model.check_guarded()?;
    Ok(true)
}

/// Checks that each part of an arm has a capsule. Otherwise it could collide unseen.
fn check_arms(model: &Model, capsules: &[Named], source: &Source) -> Result<(), CollisionError> {
    let bodies: Vec<usize> = capsules.iter().filter_map(|named| Some(model.link_body(&named.link)?.0)).collect();
    let mut missing = Vec::new();
    for (side, arm) in ["left", "right"].into_iter().zip(&model.arms) {
        for (part, slots) in arm.parts() {
            let moved = |body: usize| slots.iter().flatten().any(|j| j + 1 == body);
            if !bodies.iter().any(|body| moved(*body)) {
                let links: Vec<&str> =
                    model.links().filter(|(_, body, _)| moved(*body)).map(|(name, ..)| name).collect();
                missing.push(format!("the {side} {part} ({})", links.join(", ")));
            }
        }
    }
    if missing.is_empty() {
        return Ok(());
    }
    let missing = missing.join(" and ");
    let advice = "Write links with shapes, fixed to these, into a URDF of your own, and name it with a second --urdf";
    let cause = format!("no link of {missing} has a <collision> or <visual> shape. {advice}");
    Err(CollisionError::content(source.urdf[0].display().to_string(), cause))
}

/// Returns the links that carry capsules, then `None` for all of them.
fn links(capsules: &[Named]) -> Vec<Option<&str>> {
    let mut links: Vec<Option<&str>> = capsules.iter().map(|capsule| Some(capsule.link.as_str())).collect();
    links.dedup();
    links.push(None);
    links
}

fn check(source: &Source, sign: bool) -> Result<bool, CollisionError> {
    let texts = read_all(source)?;
    let model = Model::from_text(&texts.toml.0, &texts.toml.1, &texts.urdf.0, &texts.urdf.1)?;
    let scene = texts.scene(source);
    let mut good = texts.narrower.is_empty();
    for (joint, unit, [low, high]) in &texts.narrower {
        out!("{joint} needs a range of at most {low:.4} to {high:.4} {unit}: fit again, or narrow it under [tighten]");
    }
    let wide = texts.plan.groups.iter().map(|group| group.name.len()).max().unwrap_or(0);
    for group in &texts.plan.groups {
        // The right side of a pair of groups is mirrored into the left one, both contents and capsules.
        let side = if group.frame.contains(SIDE) { "left" } else { "" };
        let stem = group.name.replace(SIDE, side);
        let shapes = capsules_in_frame(&model, &group.frame.replace(SIDE, side), |name| belongs(name, &stem));
        let out = sticks_out_m(&scene.matter(group)?, &shapes);
        out!("{:wide$} {} capsules, worst point {:+.2} mm from the surface", group.name, shapes.len(), out * 1e3);
        good &= out <= 0.0;
    }
    // The fit is deterministic. It shows again which points each capsule must contain.
    let capsules = fit_all(&texts.plan, &scene)?;
    let deviations = deviations_m(&model, &capsules);
    let worst = deviations.iter().max_by(|a, b| a.1.total_cmp(&b.1));
    if let Some((name, deviation_m)) = worst {
        out!("fitted again: at most {:.3} mm from the file, at {name}", deviation_m * 1e3);
        good &= *deviation_m <= SAME_FIT_M && capsules.len() == model.capsules.len();
    }
    if sign && capsules.is_empty() {
        out!("nothing was fitted: without shapes or a plan nothing shows that the capsules contain the robot");
        good = false;
    }
    let names: Vec<String> = capsules.iter().map(|capsule| capsule.name.clone()).collect();
    for reason in reasons(&model, &Judge::new(&model, &texts.plan, &capsules), &names) {
        let why = match (reason.reason, reason.proof) {
            (AllowedReason::SameBody, _) => "same body".to_owned(),
            (AllowedReason::Adjacent, _) => "adjacent".to_owned(),
            (AllowedReason::OverlapAsPublished, _) if reason.overlaps => "overlaps everywhere as published".to_owned(),
            (AllowedReason::ProvedClear | AllowedReason::OverlapAsPublished, _) if !reason.holds() => {
                "NOT PROVED".to_owned()
            }
            (_, proof) => proof.map_or(String::new(), |proof| format!("proved clear by {proof}")),
        };
        out!("{} - {}: {why}", reason.names.0, reason.names.1);
        good &= reason.holds();
    }
    summary(&model);
    if sign && good {
        // A person may have edited the file meanwhile.
        if read_text(&source.robot)? != texts.toml.1 {
            let cause = "was edited while it was proved, so nothing was signed: run this again";
            return Err(CollisionError::content(texts.toml.0.as_str(), cause));
        }
        write_text(&source.robot, &model.signed()?)?;
    }
    Ok(good)
}

/// Returns true if a capsule's name is the stem, or the stem and a number.
fn belongs(name: &str, stem: &str) -> bool {
    let Some(rest) = name.strip_prefix(stem) else { return false };
    rest.is_empty() || rest.strip_prefix('_').is_some_and(|number| number.parse::<usize>().is_ok())
}

fn summary(model: &Model) {
    let mut frames = Frames::default();
    model.forward(&model.home, &mut frames);
    let (clearance_m, index) = model.clearance(&frames);
    let name = |capsule: usize| model.capsules[capsule].name.as_str();
    let count = |reason| model.allowed.iter().filter(|pair| pair.reason == reason).count();
    err!(
        "{} capsules, {} pairs checked, {} on one body, {} adjacent, {} proved clear, {} overlapping as published",
        model.capsules.len(),
        model.pairs.len(),
        count(AllowedReason::SameBody),
        count(AllowedReason::Adjacent),
        count(AllowedReason::ProvedClear),
        count(AllowedReason::OverlapAsPublished)
    );
    if let Some(pair) = model.pairs.get(index) {
        err!("home: {:.1} mm between {} and {}", clearance_m * 1e3, name(pair.a), name(pair.b));
    }
    let share = collision_share(model, 20_000);
    err!("{:.1} % of uniform configurations are in self-collision by capsules", share * 100.0);
}

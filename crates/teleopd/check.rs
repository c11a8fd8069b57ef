//! Prints every effective value, its source, and the configuration hash that every message header carries.

use crate::cli::InstanceArgs;
use crate::process::door_group;
use config::{ConfigError, Loaded};
use rt::{Exit, Failure, out};
use std::path::Path;

/// Returns true if the file exists, or if a bare name is found in PATH.
fn is_there(program: &Path) -> bool {
    let folders = std::env::var_os("PATH").filter(|_| program.components().count() == 1);
    let mut named = folders.iter().flat_map(std::env::split_paths).map(|folder| folder.join(program));
    program.is_file() || named.any(|file| file.is_file())
}

/// Makes the configuration of every stage, as the processes do.
pub fn check_stages(loaded: &Loaded) -> Result<(), ConfigError> {
    world::control_config(loaded, true)?;
    world::retarget_config(loaded)?;
    world::driver_config(loaded, true)?;
    world::robot_config(loaded).map(drop)
}

/// Loads everything that an instance would load and fails where it would fail. Otherwise prints the effective values.
pub fn run(place: &InstanceArgs) -> Result<Exit, Failure> {
    let loaded = place.load()?;
    check_stages(&loaded).map_err(Failure::with(Exit::Config))?;
    let doors = &loaded.settings.doors;
    door_group(place, "doors.skeleton_group", &doors.skeleton_group)?;
    door_group(place, "doors.operator_group", &doors.operator_group)?;
    if let Some(program) = loaded.driver_program().filter(|program| !is_there(program)) {
        let text = format!("{}: driver.program: there is no program {}", place.config.display(), program.display());
        return Err(Failure::new(Exit::Config, text));
    }
    for file in &loaded.files {
        out!("read {}", file.display());
    }
    out!();
    let source = place.config.display();
    for (key, value) in loaded.effective() {
        let overridden = match key.as_str() {
            "control.engage_without_realtime" => place.engage_without_realtime,
            "driver.interface" => place.interface.is_some(),
            "robot.file" => place.robot.is_some(),
            "weights.file" => {
                let own = place.robot.as_ref().map(|robot| format!("/{}\"", robot.name()));
                own.is_some_and(|own| value.ends_with(&own))
            }
            _ => false,
        };
        let from = match key.as_str() {
            _ if overridden => "command line".to_owned(),
            "driver.interface" if loaded.settings.driver.interface.is_none() => "default".to_owned(),
            _ => source.to_string(),
        };
        out!("{key:<44} {value:<28} {from}");
    }
    out!("\n{:<28} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}", "joint", "q_min", "q_max", "v_max", "a_max", "j_max", "home");
    let model = &loaded.model;
    for (j, name) in model.joint_names.iter().enumerate() {
        let limits = &model.limits[j];
        out!(
            "{:<28} {:>9.4} {:>9.4} {:>9.3} {:>9.3} {:>9.1} {:>9.4}",
            name,
            limits.q_min,
            limits.q_max,
            limits.v_max,
            limits.a_max,
            limits.j_max,
            model.home[j]
        );
    }
    out!("(rad, rad/s, rad/s^2, rad/s^3; m for joints that slide)");
    out!(
        "\ncapsules {}, checked pairs {}, d_min {:.1} mm",
        model.capsules.len(),
        model.pairs.len(),
        model.d_min_m * 1e3
    );
    let light = model.massless_links();
    if !light.is_empty() {
        out!("links of the arms without <inertial>, which torques leave out: {}", light.join(", "));
    }
    model.doubts().iter().for_each(|doubt| out!("note: {doubt}"));
    let obstacles: Vec<_> = model.obstacles.iter().map(|obstacle| obstacle.name.as_str()).collect();
    out!("obstacles {}", if obstacles.is_empty() { "none".to_owned() } else { obstacles.join(", ") });
    out!("hash {:016x}", loaded.hash);
    Ok(Exit::Ok)
}

//! /dev/cpu_dma_latency: a core that sleeps deeply wakes late (linux, Documentation/power/pm_qos_interface.rst).

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::OnceLock;

/// File that takes the longest acceptable wake-up latency, us, as a native 32-bit integer. The value holds while
/// the file is open.
const DEVICE: &str = "/dev/cpu_dma_latency";

/// The open file. It is held until the process ends.
static HELD: OnceLock<File> = OnceLock::new();

/// Keeps every core of the machine from sleeping until this process ends.
pub(super) fn hold_awake() -> Result<String, String> {
    let held = match HELD.get() {
        Some(held) => held,
        None => {
            let opened = ask(Path::new(DEVICE))?;
            HELD.get_or_init(|| opened)
        }
    };
    let mut latency_us = [0; 4];
    held.read_exact_at(&mut latency_us, 0).map_err(|error| format!("{DEVICE}: cannot be read back: {error}"))?;
    match i32::from_ne_bytes(latency_us) {
        0 => Ok(format!("{DEVICE} held at 0 us")),
        other => Err(format!("{DEVICE}: 0 us was written, but {other} us is in effect")),
    }
}

fn ask(device: &Path) -> Result<File, String> {
    let refused = |error: std::io::Error| {
        let path = device.display();
        let help = match error.kind() {
            std::io::ErrorKind::PermissionDenied => {
                "; give the user of this process access: in /etc/udev/rules.d/60-teleop.rules, \
                 KERNEL==\"cpu_dma_latency\", OWNER=\"teleop\", MODE=\"0660\""
            }
            std::io::ErrorKind::NotFound => "; the kernel has none, or the unit's DevicePolicy hides it",
            _ => "",
        };
        format!("{path}: {error}{help}")
    };
    let mut file = OpenOptions::new().read(true).write(true).open(device).map_err(refused)?;
    file.write_all(&0_i32.to_ne_bytes()).map_err(refused)?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cpu_dma_latency_is_read_back_or_refusal_names_device() {
        match hold_awake() {
            Ok(what) => {
                assert!(what.contains("0 us"), "{what}");
                assert_eq!(hold_awake().as_deref(), Ok(what.as_str()), "once is enough");
            }
            Err(why) => {
                println!("not to be had here: {why}");
                assert!(why.contains(DEVICE), "{why}");
            }
        }
        let why = ask(Path::new("/dev/no_such_device")).expect_err("there is none");
        assert!(why.contains("/dev/no_such_device") && why.contains("DevicePolicy"), "{why}");
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("latency");
        std::fs::write(&file, "").expect("a file");
        drop(ask(&file).expect("a plain file takes it"));
        assert_eq!(std::fs::read(&file).expect("a file"), [0; 4], "four bytes, native order");
    }
}

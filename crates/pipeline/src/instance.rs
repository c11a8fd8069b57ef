//! Where an instance of teleopd lives: its folder, its operator socket, its two shared-memory domains.

use std::path::{Path, PathBuf};

/// The folder of an instance that was given none.
pub const DEFAULT_RUN_DIR: &str = "/tmp/teleopd";

/// The places of one instance; two instances with different folders never meet.
#[derive(Clone, Debug)]
pub struct Instance {
    run_dir: PathBuf,
    tag: String,
}

impl Instance {
    /// The instance whose folder is `run_dir`, created with mode 0750 if missing; the path is made absolute so that
    /// processes started elsewhere agree on it.
    pub fn new(run_dir: &Path) -> std::io::Result<Self> {
        let mut builder = std::fs::DirBuilder::new();
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o750);
        builder.recursive(true).create(run_dir)?;
        Ok(Self::at(run_dir.canonicalize()?))
    }

    /// The same without making the folder: to look at what is there.
    pub fn unmade(run_dir: &Path) -> Self {
        let absolute = std::path::absolute(run_dir).unwrap_or_else(|_| run_dir.to_path_buf());
        Self::at(absolute.canonicalize().unwrap_or(absolute))
    }

    fn at(run_dir: PathBuf) -> Self {
        let tag = format!("{:08x}", crate::fnv(run_dir.as_os_str().as_encoded_bytes()) as u32);
        Self { run_dir, tag }
    }

    /// The folder itself.
    pub fn run_dir(&self) -> &Path {
        &self.run_dir
    }

    /// Operator socket of `control`.
    pub fn operator_socket(&self) -> PathBuf {
        self.run_dir.join("operator.sock")
    }

    /// What `control` holds locked as long as it owns that socket.
    pub fn operator_lock(&self) -> PathBuf {
        self.run_dir.join("operator.sock.lock")
    }

    /// Where a process leaves its figures when it ends.
    pub fn report(&self, process: &str) -> PathBuf {
        self.run_dir.join(format!("{process}.json"))
    }

    /// The domain that only teleopd's own processes open.
    pub fn core_domain(&self) -> bus::DomainConfig {
        self.domain("core")
    }

    /// The domain in which clients publish.
    pub fn input_domain(&self) -> bus::DomainConfig {
        self.domain("input")
    }

    /// Removes what the transport leaves in shared memory after every process of the instance has ended.
    pub fn retire(&self) {
        let prefixes = [self.core_domain().prefix, self.input_domain().prefix];
        for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            let name = entry.file_name();
            if prefixes.iter().any(|prefix| name.to_string_lossy().starts_with(prefix)) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }

    // Shared-memory names have no folders: the prefix keeps instances and domains apart there.
    fn domain(&self, name: &str) -> bus::DomainConfig {
        bus::DomainConfig { root: self.run_dir.join(name), prefix: format!("teleop_{name}_{}_", self.tag) }
    }
}

//! Places of an instance of teleopd: its folder, its operator socket, its two shared-memory domains.

use messages::{FNV_BASIS, fnv};
use std::fs::OpenOptions;
use std::io::Write;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// Folder of an instance without `--run-dir`.
pub const DEFAULT_RUN_DIR: &str = "/tmp/teleopd";

/// Places of one instance. Two instances with different folders never meet.
#[derive(Clone, Debug)]
pub struct Instance {
    run_dir: PathBuf,
    tag: String,
}

impl Instance {
    /// Opens the instance whose folder is `run_dir`. A missing folder is created with mode 0751: other users may reach
    /// a socket whose name they know, and see nothing else. The path is made absolute, so processes started elsewhere
    /// agree on it. It is refused if another user could put or replace something in it.
    pub fn new(run_dir: &Path) -> std::io::Result<Self> {
        if !run_dir.exists() {
            std::fs::create_dir_all(run_dir)?;
            // Independent of the umask.
            std::fs::set_permissions(run_dir, std::fs::Permissions::from_mode(0o751))?;
        }
        if !run_dir.is_dir() {
            let text = "is a file, not a folder. Give --run-dir a folder";
            return Err(std::io::Error::new(std::io::ErrorKind::NotADirectory, text));
        }
        refuse_foreign(run_dir)?;
        Ok(Self::at(run_dir.canonicalize()?))
    }

    /// Opens the instance without creating the folder, to look at what is there.
    pub fn unmade(run_dir: &Path) -> Self {
        let absolute = std::path::absolute(run_dir).unwrap_or_else(|_| run_dir.to_path_buf());
        Self::at(absolute.canonicalize().unwrap_or(absolute))
    }

    fn at(run_dir: PathBuf) -> Self {
        let tag = format!("{:08x}", fnv(FNV_BASIS, run_dir.as_os_str().as_encoded_bytes()) as u32);
        Self { run_dir, tag }
    }

    /// The folder.
    pub fn run_dir(&self) -> &Path {
        &self.run_dir
    }

    /// Operator socket of `control`.
    pub fn operator_socket(&self) -> PathBuf {
        self.run_dir.join("operator.sock")
    }

    /// Skeleton socket of `ingest`.
    pub fn skeleton_socket(&self) -> PathBuf {
        self.run_dir.join("skeleton.sock")
    }

    /// Lock file that `control` holds locked while it owns the operator socket.
    pub fn operator_lock(&self) -> PathBuf {
        self.run_dir.join("operator.sock.lock")
    }

    /// File into which a process writes its figures when it ends.
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

    /// Removes the files that the transport leaves in shared memory after every process of the instance has ended.
    pub fn retire(&self) {
        for path in self.shared_memory() {
            let _ = std::fs::remove_file(path);
        }
    }

    /// Returns the files of both domains in shared memory.
    pub fn shared_memory(&self) -> impl Iterator<Item = PathBuf> + use<> {
        let prefixes = [self.core_domain().prefix, self.input_domain().prefix];
        let all = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
        let ours = all
            .filter(move |entry| prefixes.iter().any(|p| entry.file_name().to_string_lossy().starts_with(p.as_str())));
        ours.map(|entry| entry.path())
    }

    // Shared-memory names have no folders. There the prefix keeps instances and domains apart.
    fn domain(&self, name: &str) -> bus::DomainConfig {
        bus::DomainConfig { root: self.run_dir.join(name), prefix: format!("teleop_{name}_{}_", self.tag) }
    }
}

/// Writes a file of the instance and replaces anything with its name: a link is replaced, not followed. The file
/// appears whole or not at all.
pub fn write_anew(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}", std::process::id()));
    let beside = path.with_file_name(name);
    // Left behind by a killed process with the same process number.
    let _ = std::fs::remove_file(&beside);
    // Synchronised before it gets the name: after a power loss the file is the old one or the new one, and never empty.
    let written = OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(&beside)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()));
    written.and_then(|()| std::fs::rename(&beside, path)).inspect_err(|_| _ = std::fs::remove_file(&beside))
}

/// Returns an error unless the folder, and the link that leads to it, belong to this user or root alone.
fn refuse_foreign(run_dir: &Path) -> std::io::Result<()> {
    let (own_uid, own_gid) = (rustix::process::geteuid().as_raw(), rustix::process::getegid().as_raw());
    for (found, what) in [(run_dir.symlink_metadata()?, "link"), (run_dir.metadata()?, "folder")] {
        let (uid, mode) = (found.uid(), found.mode() & 0o7777);
        if uid != own_uid && uid != 0 {
            let text = format!(
                "the {what} belongs to user {uid}, who could place sockets in it. Give --run-dir a folder of your own"
            );
            return Err(std::io::Error::new(std::io::ErrorKind::PermissionDenied, text));
        }
        // Most systems give each user a group of their own. Write access for it admits no other user.
        let group = mode & 0o020 != 0 && found.gid() != own_gid;
        if found.is_dir() && (mode & 0o002 != 0 || group) {
            let (who, right) = if group { ("members of another group", "g-w") } else { ("other users", "o-w") };
            let text = format!(
                "{who} may write to the {what} (mode {mode:04o}). Run chmod {right} on it, or give another folder"
            );
            return Err(std::io::Error::new(std::io::ErrorKind::PermissionDenied, text));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{chown, symlink};

    #[test]
    fn f110_folder_or_link_of_another_user_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("run");
        let instance = Instance::new(&place).unwrap();
        assert_eq!(instance.run_dir().metadata().unwrap().permissions().mode() & 0o777, 0o751);
        std::fs::set_permissions(&place, std::fs::Permissions::from_mode(0o777)).unwrap();
        let error = Instance::new(&place).unwrap_err().to_string();
        assert!(error.contains("may write") && error.contains("0777"), "{error}");
        std::fs::set_permissions(&place, std::fs::Permissions::from_mode(0o751)).unwrap();
        let link = folder.path().join("link");
        symlink(&place, &link).unwrap();
        assert_eq!(Instance::new(&link).unwrap().run_dir(), place.canonicalize().unwrap());
        if !rustix::process::geteuid().is_root() {
            return println!("skipped: only root can make files of another user");
        }
        std::os::unix::fs::lchown(&link, Some(65534), None).unwrap();
        let error = Instance::new(&link).unwrap_err().to_string();
        assert!(error.contains("the link belongs to user 65534"), "{error}");
        chown(&place, Some(65534), None).unwrap();
        let error = Instance::new(&place).unwrap_err().to_string();
        assert!(error.contains("belongs to user 65534"), "{error}");
    }

    #[test]
    fn f110_link_in_place_of_file_is_replaced_and_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (precious, file) = (folder.path().join("precious"), folder.path().join("names.json"));
        std::fs::write(&precious, "mine").unwrap();
        symlink(&precious, &file).unwrap();
        write_anew(&file, b"names").unwrap();
        assert_eq!(std::fs::read_to_string(&precious).unwrap(), "mine");
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "names");
        assert!(!file.symlink_metadata().unwrap().is_symlink());
        // A folder with the file's name gives an error, and nothing is left beside it.
        let taken = folder.path().join("taken");
        std::fs::create_dir(&taken).unwrap();
        assert!(write_anew(&taken, b"x").is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
    }

    #[test]
    fn f110_folder_writable_by_another_group_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let mode = |mode| std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(mode)).unwrap();
        mode(0o770);
        Instance::new(folder.path()).expect("the group is ours");
        if !rustix::process::geteuid().is_root() {
            return println!("skipped: only root can make folders of another group");
        }
        chown(folder.path(), None, Some(65534)).unwrap();
        mode(0o2770);
        let error = Instance::new(folder.path()).unwrap_err().to_string();
        assert!(error.contains("another group") && error.contains("chmod g-w"), "{error}");
        mode(0o750);
        Instance::new(folder.path()).expect("they may only look");
    }
}

//! The folder of meshes.

use std::fs::File;
use std::path::Path;
use view::{MESH_BYTES_MAX, MeshFolder};

fn folder() -> (tempfile::TempDir, MeshFolder) {
    let folder = tempfile::tempdir().unwrap();
    for path in ["arm/arm_1.stl", "old/arm/arm_1.stl", "arm/wrist.DAE", "arm/skin.png", "notes.txt", "arm/a b.obj"] {
        let path = folder.path().join("robot/meshes").join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, "solid").unwrap();
    }
    let meshes = MeshFolder::open(folder.path()).unwrap();
    (folder, meshes)
}

#[test]
fn mesh_is_found_by_longest_matching_suffix() {
    let (_folder, meshes) = folder();
    for (name, found) in [
        ("package://robot/meshes/arm/arm_1.stl", Some("robot/meshes/arm/arm_1.stl")),
        ("package://other/old/arm/arm_1.stl", Some("robot/meshes/old/arm/arm_1.stl")),
        ("arm_1.stl", Some("robot/meshes/arm/arm_1.stl")),
        ("file:///opt/x/wrist.DAE", Some("robot/meshes/arm/wrist.DAE")),
        ("arm/a b.obj", Some("robot/meshes/arm/a b.obj")),
        ("package://robot/meshes/arm/arm_9.stl", None),
        ("package://robot/notes.txt", None),
        ("", None),
    ] {
        assert_eq!(meshes.find(name).as_deref(), found, "{name}");
    }
}

#[test]
fn only_meshes_and_textures_below_folder_are_read() {
    let (folder, meshes) = folder();
    std::fs::write(folder.path().join("secret.stl"), "solid").unwrap();
    let secret = folder.path().join("secret.stl");
    std::os::unix::fs::symlink(secret, folder.path().join("robot/way_out.stl")).unwrap();
    let inner = MeshFolder::open(&folder.path().join("robot")).unwrap();
    assert_eq!(inner.read("meshes/arm/arm_1.stl").map(|file| file.bytes).ok(), Some(5));
    assert_eq!(meshes.read("robot/meshes/arm/skin.png").map(|file| file.kind).ok(), Some("image/png"));
    let bad = "../secret.stl meshes/../../secret.stl /etc/hostname way_out.stl meshes//arm/arm_1.stl \
        meshes/./arm/arm_1.stl meshes\\arm\\arm_1.stl meshes/notes.txt meshes/arm meshes/arm/none.stl ";
    for bad in bad.split(' ') {
        assert!(inner.read(bad).is_err(), "{bad}");
    }
    let large = File::create(folder.path().join("robot/large.stl")).unwrap();
    large.set_len(MESH_BYTES_MAX + 1).unwrap();
    assert!(inner.read("large.stl").is_err());
}

#[test]
fn missing_folder_gives_error_that_names_it() {
    let error = MeshFolder::open(Path::new("/nowhere/meshes")).unwrap_err().to_string();
    assert!(error.starts_with("/nowhere/meshes: --meshes: "), "{error}");
}

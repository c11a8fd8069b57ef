//! All integration tests of `world`. They are one program, so they are linked once.

#[path = "../../layouts/tests/before_camera.rs"]
mod before_camera;
mod engaging;
mod environment;
mod feedback;
mod files;
mod grippers;
mod input_changes;
mod layouts;
mod lift;
mod one_arm;
mod overrides;
mod payload;
mod policy;
mod recovery;
mod reduced;
mod robot_faults;
mod robot_interface;
mod simulated;
mod support;
mod unmirrored;

//! The whole at work: real processes, most of them in real time, the page, and the stages' allocations. A test that runs an
//! instance waits for its turn (`harness::Harness`).

mod allocations;
mod appearance;
mod browser;
mod calibrate;
mod clients;
mod commission;
mod doctor;
mod doors;
mod doors_abuse;
mod driver;
mod end_to_end;
mod first_minutes;
mod headset;
mod key_poses;
mod landmarks;
mod policies;
mod resources;
mod ros2;
mod secure;
mod systemd;
mod view;
mod viewer;
mod webcam;

//! The program `teleopd-ros2`.

fn main() -> std::process::ExitCode {
    ros2::main()
}

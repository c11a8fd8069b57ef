//! All integration tests of `plant`: one program, so that it is linked once.

mod agrees_with_robot;
mod dynamics;
mod following;
mod judging;
mod refusals;
mod support;
mod watchdog;

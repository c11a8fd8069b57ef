//! All integration tests of `robot`. They are one program, so they are linked once.

mod arms;
mod draft;
mod drafts;
mod environment;
mod fit;
mod kinematics;
mod messages;
mod others;
mod pointing;
mod reading;
mod refusals;
mod rounded;
mod segments;
mod shipped;
mod support;

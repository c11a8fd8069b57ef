//! All integration tests are one program, so that it is linked once.

mod live;
mod live_view;
mod offline;
mod others;
mod support;
mod viewers;

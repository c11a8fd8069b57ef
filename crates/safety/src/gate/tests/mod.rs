//! Tests of the gate's integers: limits and their edges, on exact grids. Those of single files stand beside them.

mod boundaries;
mod ceilings;
mod lattice;

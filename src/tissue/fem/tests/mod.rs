//! Tests of the whole solver on structured blocks.

pub(super) mod blocks;
mod bodies;
mod calculix;
mod checkpoint;
mod closed_forms;
mod contact;
mod convergence;
mod facing;
mod failures;
mod gliding;
mod indented;
mod locking;
mod prescribed;
mod two_blocks;
mod two_lips;

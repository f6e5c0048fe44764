//! The tests of each file of `src/service/http/routes`.

mod compare;
mod events;
mod health;
mod inputs;
mod jobs;
mod materials;
mod mesh_choice;
mod osteotomies;
mod results;
mod sessions;
pub(crate) mod tissue;
mod warm_start;

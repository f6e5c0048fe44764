//! The tests of each file of `src/service/http/routes`, under the same name.

mod accepted;
mod compare;
mod events;
mod field;
mod health;
mod inputs;
mod jobs;
mod landmarks;
mod materials;
mod mesh;
mod mesh_choice;
mod on_demand;
mod osteotomies;
mod page;
mod plans;
mod profile;
mod report;
mod report_page;
mod results;
mod sessions;
mod tissue;
mod warm_start;

//! The command line as a user meets it: what it writes, and how it refuses bad input.

mod calibrated;
mod capture;
mod demo;
mod eval;
mod experiments;
mod exported;
mod fixture;
mod general;
mod images;
mod joined;
mod link;
mod many;
mod matching;
mod outputs;
mod points;
mod recorded;
mod recording;
mod scripted;
mod sending;
mod stress;
mod view;
mod wall;

//! The link: every message survives, and what is damaged is never taken for another.

mod assembler;
mod damage;
mod golden;
mod messages;

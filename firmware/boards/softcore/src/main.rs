//! Firmware of the soft core with a stereo unit.
#![no_std]
#![no_main]

mod board;
mod camera;
mod clock;
mod i2c;
mod news;
mod processor;
mod registers;
mod sensors;
mod sink;
mod uart;
mod unit;

use riscv_rt::entry;

#[entry]
fn main() -> ! {
    board::run(unit::UnitKernels::new())
}

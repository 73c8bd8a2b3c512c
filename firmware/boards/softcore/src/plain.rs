//! Firmware of the soft core without a stereo unit: all kernels are code.
#![no_std]
#![no_main]

mod board;
mod camera;
mod clock;
mod i2c;
mod kernels;
mod news;
mod processor;
mod registers;
mod sensors;
mod sink;
mod uart;

use riscv_rt::entry;

#[entry]
fn main() -> ! {
    board::run(kernels::PlainKernels)
}

//! The registers of an I2C interface whose SDA is held low: no start goes out, and nothing comes.

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::stm32h743::generated::i2c1::{Register, cr2};

/// In the place of an interface while its bus is stuck. A start that is asked for then is
/// forgotten, where the chip may keep it until the bus is free.
#[derive(Debug, Default)]
pub struct StuckBus;

impl Device for StuckBus {
    type Register = Register;

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        _: &mut DeviceContext<'_>,
    ) {
        if register == Register::Cr2 {
            registers.set(register, value & !(cr2::START.mask() | cr2::STOP.mask()));
        }
    }
}

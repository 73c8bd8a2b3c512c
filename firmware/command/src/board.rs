//! The boards.

use core::fmt;
use core::str::FromStr;

/// A board that the firmware is built for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Board {
    /// Name on the command line and in tables.
    pub name: &'static str,
    /// Folder below `firmware/boards`, also the package's name.
    pub folder: &'static str,
    /// Rust's name of its processor.
    pub target: &'static str,
    /// Flags of the compiler besides those of the folder.
    pub compiler_flags: &'static [&'static str],
    /// The emulator that stands in for it, if there is one.
    pub emulation: Option<Emulation>,
    /// Whether its memory is for grey pairs of half the size of the benchmarks'.
    pub is_small: bool,
}

/// How a board is emulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Emulation {
    /// The emulator's program.
    pub program: &'static str,
    /// The board in that emulator.
    pub arguments: &'static [&'static str],
    /// `log2` of the emulator's nanoseconds per instruction, where instructions are counted.
    pub count_shift: u8,
}

const ARM_TARGET: &str = "thumbv7em-none-eabihf";
const RISCV_TARGET: &str = "riscv32imac-unknown-none-elf";

/// STM32F405, Cortex-M4F: the reference.
pub const STM32F405: Board = Board {
    name: "stm32f405",
    folder: "stm32f405",
    target: ARM_TARGET,
    compiler_flags: &[],
    emulation: Some(Emulation {
        program: "qemu-system-arm",
        arguments: &["-machine", "netduinoplus2"],
        count_shift: 0,
    }),
    is_small: true,
};

/// Arm's MPS2 board with the image AN500, Cortex-M7.
pub const MPS2_AN500: Board = Board {
    name: "mps2-an500",
    folder: "mps2-an500",
    target: ARM_TARGET,
    compiler_flags: &[],
    emulation: Some(Emulation {
        program: "qemu-system-arm",
        arguments: &["-machine", "mps2-an500"],
        count_shift: 6,
    }),
    is_small: false,
};

/// RV32IMAC, a soft-core's stand-in.
pub const RISCV_VIRT: Board = Board {
    name: "riscv-virt",
    folder: "riscv-virt",
    target: RISCV_TARGET,
    compiler_flags: &[],
    emulation: Some(Emulation {
        program: "qemu-system-riscv32",
        arguments: &[
            "-machine",
            "virt",
            "-bios",
            "none",
            "-cpu",
            "rv32,zbb=false",
        ],
        count_shift: 0,
    }),
    is_small: false,
};

/// The same with the instructions of Zbb.
pub const RISCV_VIRT_ZBB: Board = Board {
    name: "riscv-virt-zbb",
    compiler_flags: &["-Ctarget-feature=+zbb"],
    emulation: Some(Emulation {
        program: "qemu-system-riscv32",
        arguments: &["-machine", "virt", "-bios", "none", "-cpu", "rv32,zbb=true"],
        count_shift: 0,
    }),
    ..RISCV_VIRT
};

/// NUCLEO-H743ZI2, Cortex-M7, with a camera: not emulated.
pub const STM32H743: Board = Board {
    name: "stm32h743",
    folder: "stm32h743",
    target: ARM_TARGET,
    compiler_flags: &[],
    emulation: None,
    is_small: false,
};

impl Board {
    /// All boards.
    pub const ALL: [Self; 5] = [STM32F405, MPS2_AN500, RISCV_VIRT, RISCV_VIRT_ZBB, STM32H743];

    /// All that are emulated.
    pub fn emulated() -> impl Iterator<Item = Self> {
        let all = Self::ALL.into_iter();
        all.filter(|board| board.emulation.is_some())
    }

    /// How the board is emulated.
    ///
    /// # Errors
    /// When it is not.
    pub fn emulation(&self) -> Result<Emulation, NotEmulated> {
        self.emulation.ok_or(NotEmulated { board: self.name })
    }
}

/// A board has no emulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotEmulated {
    /// The board's name.
    pub board: &'static str,
}

impl fmt::Display for NotEmulated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.board;
        write!(
            f,
            "{name} is a real board and not emulated; firmware/boards/{name}/README.md tells how to run it"
        )
    }
}

impl std::error::Error for NotEmulated {}

/// No board has this name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnknownBoard;

impl fmt::Display for UnknownBoard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = Board::ALL.map(|board| board.name).join(", ");
        write!(f, "no board has this name; there are: {names}")
    }
}

impl std::error::Error for UnknownBoard {}

impl FromStr for Board {
    type Err = UnknownBoard;

    fn from_str(name: &str) -> Result<Self, UnknownBoard> {
        let mut all = Self::ALL.into_iter();
        all.find(|board| board.name == name).ok_or(UnknownBoard)
    }
}

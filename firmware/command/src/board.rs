//! The boards that the firmware is built for.

use core::fmt;
use core::str::FromStr;

use vgstereo_core::{DisparityRange, Preset};
use vgstereo_emulated::Request;
pub use vgstereo_emulated::request::ALONE_DISPARITIES;
use vgstereo_firmware::camera::PixelFormat;

/// A board that the firmware is built for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Board {
    /// The name on the command line and in tables.
    pub name: &'static str,
    /// The name of its package, and of the folder below `firmware/boards` that holds it.
    pub folder: &'static str,
    /// The target triple that its firmware is compiled for.
    pub target: &'static str,
    /// Compiler flags in addition to those that the folder configures.
    pub compiler_flags: &'static [&'static str],
    /// How it is emulated; `None` for a board that runs only as hardware.
    pub emulation: Option<Emulation>,
    /// The package, and the folder below `firmware/boards`, of a program for it that compares its kernels with
    /// the reference; `None` where the suite of the kernels does so on hosts.
    pub kernel_suite: Option<&'static str>,
    /// The model of its chip; `None` for a board that has none.
    pub model: Option<Model>,
    /// The simulation of its hardware in RTL; `None` for a board that has none.
    pub simulation: Option<Simulation>,
    /// The presets for which it can be built alone, in less flash: see [`Board::alone`].
    pub alone_presets: &'static [Preset],
    /// The preset that it is built for alone; `None` if it takes all requests.
    pub alone: Option<Preset>,
    /// Whether its memory is too small for the pairs of the benchmarks, so that it gets them
    /// in grey and half as large.
    pub is_small: bool,
}

/// How a board is emulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Emulation {
    /// The name of the emulator's program.
    pub program: &'static str,
    /// The arguments that choose the board in that emulator.
    pub arguments: &'static [&'static str],
    /// The base-2 logarithm of the time that an instruction takes in the emulator, ns, when
    /// instructions are counted.
    pub count_shift: u8,
}

/// The model of a real board's chip, which runs the firmware that is flashed, and what that is
/// built for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Model {
    /// The name of its package, and of the folder below `firmware/boards` that holds it.
    pub folder: &'static str,
    /// The preset of the firmware.
    pub preset: Preset,
    /// The width and the height of its frames, px.
    pub size: (u32, u32),
    /// The number of disparities that it searches, from 0 on.
    pub disparities: u16,
}

/// A board in RTL, which Verilator makes a program of: what its firmware is built for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Simulation {
    /// The preset of the firmware.
    pub preset: Preset,
    /// The processor that it has.
    pub processor: Processor,
    /// How many costs its stereo unit makes in a cycle, one of [`UNIT_LANES`]; 0 if it has none.
    pub unit_lanes: u32,
}

impl Simulation {
    /// Returns the presets for which its firmware can be built: those that its stereo unit is for, or those for which code
    /// and working memory have room.
    const fn presets(&self) -> &'static [Preset] {
        match self.unit_lanes {
            0 => &[Preset::Lite, Preset::Micro],
            _ => &[Preset::Lite],
        }
    }

    /// Returns the packages that are compiled to be small rather than fast: the code has to fit the FPGA's memory. With the
    /// board's own package that of core is compiled that depends on the kernels.
    pub fn small_packages(&self) -> impl Iterator<Item = &'static str> {
        let always = ["vgstereo-emulated", "vgstereo-link", "libm", "postcard"];
        let others: &[_] = match self.preset {
            Preset::Lite => &[],
            _ => &["vgstereo-firmware", "vgstereo-core", "softcore"],
        };
        always.into_iter().chain(others.iter().copied())
    }
}

/// A processor that a board in RTL may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Processor {
    /// VexRiscv: RV32IM, with caches, and byte instructions of ours.
    VexRiscv,
    /// CV32E40P: RV32IMC with the Xpulp instructions; words need no alignment.
    Cv32e40p,
}

impl Processor {
    /// All processors, the default first.
    pub const ALL: [Self; 2] = [Self::VexRiscv, Self::Cv32e40p];

    /// Returns its name on the command line. The folder of its RTL and the feature of the firmware have it too.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::VexRiscv => "vexriscv",
            Self::Cv32e40p => "cv32e40p",
        }
    }

    /// Returns the target triple of firmware for it.
    const fn target(self) -> &'static str {
        match self {
            Self::VexRiscv => "riscv32im-unknown-none-elf",
            Self::Cv32e40p => "riscv32imc-unknown-none-elf",
        }
    }

    /// Returns the flags of the compiler for it.
    const fn compiler_flags(self) -> &'static [&'static str] {
        match self {
            Self::VexRiscv => &[],
            Self::Cv32e40p => &["-Ctarget-feature=+unaligned-scalar-mem"],
        }
    }
}

/// The presets for which there are boards that are built for one alone.
const ALONE_PRESETS: &[Preset] = &[Preset::Lite, Preset::Micro];

/// Numbers of costs that a stereo unit may make in a cycle.
pub const UNIT_LANES: [u32; 3] = [8, 16, 32];

const ARM_TARGET: &str = "thumbv7em-none-eabihf";
const ARMV8M_TARGET: &str = "thumbv8m.main-none-eabihf";
const RISCV_TARGET: &str = "riscv32imac-unknown-none-elf";

/// The reference board: STM32F405, a Cortex-M4F.
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
    kernel_suite: None,
    model: None,
    simulation: None,
    alone_presets: ALONE_PRESETS,
    alone: None,
    is_small: true,
};

/// Arm's MPS2 board with the FPGA image AN500, a Cortex-M7.
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
    kernel_suite: None,
    model: None,
    simulation: None,
    alone_presets: ALONE_PRESETS,
    alone: None,
    is_small: false,
};

/// Arm's MPS3 board with the FPGA image AN547, a Cortex-M55 with the vector instructions of Helium. The
/// target's name does not tell them.
pub const MPS3_AN547: Board = Board {
    name: "mps3-an547",
    folder: "mps3-an547",
    target: ARMV8M_TARGET,
    compiler_flags: &["-Ctarget-cpu=cortex-m55"],
    emulation: Some(Emulation {
        program: "qemu-system-arm",
        arguments: &["-machine", "mps3-an547"],
        count_shift: 4,
    }),
    kernel_suite: Some("mps3-an547-suite"),
    model: None,
    simulation: None,
    alone_presets: &[],
    alone: None,
    is_small: false,
};

/// A virtual RISC-V board with the instruction set RV32IMAC, in place of a soft core.
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
    kernel_suite: None,
    model: None,
    simulation: None,
    alone_presets: &[],
    alone: None,
    is_small: false,
};

/// The virtual RISC-V board with the bit manipulation instructions of Zbb as well.
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

/// NUCLEO-H743ZI2, a Cortex-M7 with a camera. It is not emulated, but its chip is modelled.
pub const STM32H743: Board = Board {
    name: "stm32h743",
    folder: "stm32h743",
    target: ARM_TARGET,
    compiler_flags: &[],
    emulation: None,
    kernel_suite: None,
    model: Some(Model {
        folder: "stm32h743-model",
        preset: Preset::Lite,
        size: (320, 240),
        disparities: 48,
    }),
    simulation: None,
    alone_presets: &[],
    alone: None,
    is_small: false,
};

/// STM32F4DISCOVERY, a Cortex-M4F with a camera: the reference part's sister with a camera port. It
/// is built, and runs only as hardware.
pub const STM32F407: Board = Board {
    name: "stm32f407",
    folder: "stm32f407",
    target: ARM_TARGET,
    compiler_flags: &[],
    emulation: None,
    kernel_suite: None,
    model: None,
    simulation: None,
    alone_presets: &[],
    alone: None,
    is_small: false,
};

/// A system on a chip of ours in RTL, with two camera ports, as on an FPGA. It is simulated, cycle by cycle.
pub const SOFTCORE: Board = Board {
    name: "softcore",
    folder: "softcore",
    target: Processor::VexRiscv.target(),
    compiler_flags: Processor::VexRiscv.compiler_flags(),
    emulation: None,
    kernel_suite: None,
    model: None,
    simulation: Some(Simulation {
        preset: Preset::Lite,
        processor: Processor::VexRiscv,
        unit_lanes: 16,
    }),
    alone_presets: &[],
    alone: None,
    is_small: true,
};

impl Board {
    /// All boards, emulated or not.
    pub const ALL: [Self; 8] = [
        STM32F405,
        MPS2_AN500,
        MPS3_AN547,
        RISCV_VIRT,
        RISCV_VIRT_ZBB,
        STM32H743,
        STM32F407,
        SOFTCORE,
    ];

    /// Returns the name of the program that runs on it.
    #[must_use]
    pub fn program(&self) -> &'static str {
        match self.simulation {
            Some(Simulation { unit_lanes: 0, .. }) => "softcore-plain",
            _ => self.folder,
        }
    }

    /// Returns the board with another stereo unit, or none, if it is one in RTL.
    #[must_use]
    pub fn with_unit(self, unit_lanes: u32) -> Self {
        let simulation = self.simulation.map(|simulation| Simulation {
            unit_lanes,
            ..simulation
        });
        Self { simulation, ..self }
    }

    /// Returns the board with another processor, if it is one in RTL.
    #[must_use]
    pub fn with_processor(self, processor: Processor) -> Self {
        let Some(simulation) = self.simulation else {
            return self;
        };
        Self {
            target: processor.target(),
            compiler_flags: processor.compiler_flags(),
            simulation: Some(Simulation {
                processor,
                ..simulation
            }),
            ..self
        }
    }

    /// Returns whether it is a variant of another board: one before it in [`ALL`](Self::ALL), of the same compiler target
    /// and thus with the same kernels, and like it emulated or not. The tests of a variant run only when they are asked
    /// for.
    #[must_use]
    pub fn is_variant(&self) -> bool {
        let is_alike = |other: &Self| {
            other.target == self.target && other.emulation.is_some() == self.emulation.is_some()
        };
        let first = Self::ALL.iter().find(|other| is_alike(other));
        first.is_some_and(|first| first.name != self.name)
    }

    /// Returns all boards that are emulated.
    pub fn emulated() -> impl Iterator<Item = Self> {
        let all = Self::ALL.into_iter();
        all.filter(|board| board.emulation.is_some())
    }

    /// Returns all boards of whose chip there is a model.
    pub fn modelled() -> impl Iterator<Item = Self> {
        let all = Self::ALL.into_iter();
        all.filter(|board| board.model.is_some())
    }

    /// Returns all boards in RTL, which are simulated.
    pub fn simulated() -> impl Iterator<Item = Self> {
        let all = Self::ALL.into_iter();
        all.filter(|board| board.simulation.is_some())
    }

    /// Returns all boards that are sold, emulated in no QEMU.
    pub fn real() -> impl Iterator<Item = Self> {
        let all = Self::ALL.into_iter();
        all.filter(|board| board.emulation.is_none() && board.simulation.is_none())
    }

    /// Returns the board as it is built for this preset alone: for lines of grey that are rectified, and
    /// [`ALONE_DISPARITIES`] from 0 on. It has neither link, calibration, scan nor log. One in RTL is built for one preset
    /// in any case, and lacks nothing.
    ///
    /// # Errors
    /// Fails with [`NotAlone`] when it cannot be built so.
    pub fn alone(self, preset: Preset) -> Result<Self, NotAlone> {
        if let Some(simulation) = self.simulation
            && simulation.presets().contains(&preset)
        {
            return Ok(Self {
                simulation: Some(Simulation {
                    preset,
                    ..simulation
                }),
                ..self
            });
        }
        if !self.alone_presets.contains(&preset) {
            return Err(NotAlone {
                board: self.name,
                preset,
            });
        }
        Ok(Self {
            alone: Some(preset),
            ..self
        })
    }

    /// Returns the name, with the preset that it is built for if that is one, and the processor if it is not the default.
    #[must_use]
    pub fn full_name(&self) -> String {
        match (self.alone, self.simulation) {
            (Some(preset), _) => format!("{}, {preset} alone", self.name),
            (None, Some(simulation)) if simulation.processor != Processor::VexRiscv => {
                format!("{}, {}", self.name, simulation.processor.name())
            }
            (None, _) => self.name.to_owned(),
        }
    }

    /// Returns whether the firmware takes this request, as far as that depends on what it is built for.
    #[must_use]
    pub fn is_built_for(&self, request: &Request) -> bool {
        self.alone.is_none_or(|preset| {
            let is_whole =
                request.is_live || request.calibration.is_some() || request.scan.is_some();
            let is_plain = !is_whole && !request.hamming_alone && request.faults.is_empty();
            let disparities = DisparityRange::up_to(ALONE_DISPARITIES - 1);
            is_plain
                && request.preset == preset
                && request.disparities == disparities
                && request.geometry.format == PixelFormat::Grey8
        })
    }

    /// Returns how the board is emulated.
    ///
    /// # Errors
    /// Fails with [`NotEmulated`] when it is not.
    pub fn emulation(&self) -> Result<Emulation, NotEmulated> {
        self.emulation.ok_or(NotEmulated {
            board: self.name,
            is_modelled: self.model.is_some(),
            is_simulated: self.simulation.is_some(),
        })
    }

    /// Returns whether the firmware can run on this machine: emulated, on a model of the chip, or simulated.
    #[must_use]
    pub fn is_executed(&self) -> bool {
        self.emulation.is_some() || self.model.is_some() || self.simulation.is_some()
    }
}

/// The error for a board that is not built for one preset alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotAlone {
    /// The name of the board.
    pub board: &'static str,
    /// The preset.
    pub preset: Preset,
}

impl fmt::Display for NotAlone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { board, preset } = self;
        write!(
            f,
            "{board} is not built for {preset} alone; stm32f405 and mps2-an500 are, for lite and micro, softcore for \
             lite, and for micro without its stereo unit"
        )
    }
}

impl std::error::Error for NotAlone {}

/// The error for a board that has no emulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotEmulated {
    /// The name of the board.
    pub board: &'static str,
    /// Whether there is a model of its chip.
    pub is_modelled: bool,
    /// Whether it is hardware in RTL.
    pub is_simulated: bool,
}

impl fmt::Display for NotEmulated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.board;
        if self.is_simulated {
            return write!(
                f,
                "{name} is simulated and not emulated in QEMU; of cargo firmware build, lint, size, run, \
                 verify and bench take it"
            );
        }
        let takers = if self.is_modelled {
            "build, lint, size, run and verify"
        } else {
            "build, lint and size"
        };
        write!(
            f,
            "{name} is a real board and not emulated in QEMU; of cargo firmware {takers} take it"
        )
    }
}

impl std::error::Error for NotEmulated {}

/// The error for a name that no board has.
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

//! The options `--board`, `--preset`, `--cpu` and `--stereo-unit`, which several verbs take.

use clap::Args;
use vgstereo_core::Preset;

use crate::board::{Board, NotAlone, Processor, UNIT_LANES, UnknownBoard};
use crate::toolchain::{ModelCompiler, Simulator};

/// The option of the verbs that take boards which are built for one preset alone.
#[derive(Debug, Clone, Copy, Args)]
pub struct Alone {
    /// Boards built for this preset alone, lite or micro, in less flash: for lines of grey that are rectified, and 48
    /// disparities. Of the boards, stm32f405 and mps2-an500 can be. The firmware of softcore is for one preset in any case:
    /// lite, or without the stereo unit micro.
    #[arg(long, value_name = "P")]
    preset: Option<Preset>,
}

impl Alone {
    /// Returns these boards as they are built for the preset, if one is named: of more than one board those that can
    /// be.
    ///
    /// # Errors
    /// Fails with one line when none can be.
    pub fn of(self, boards: Vec<Board>) -> Result<Vec<Board>, NotAlone> {
        let Some(preset) = self.preset else {
            return Ok(boards);
        };
        let mut alone: Vec<_> = boards.iter().map(|board| board.alone(preset)).collect();
        if alone.iter().any(Result::is_ok) {
            alone.retain(Result::is_ok);
        }
        alone.into_iter().collect()
    }
}

/// The options of the verbs that take the soft core.
#[derive(Debug, Clone, Args)]
pub struct SoftCore {
    /// Processor of softcore: vexriscv or cv32e40p [default: vexriscv].
    #[arg(long, value_name = "CPU", value_parser = parse_processor)]
    cpu: Option<Processor>,
    /// Costs that the stereo unit of softcore makes in a cycle: 8, 16 or 32; 0 for no such unit [default: 16].
    #[arg(long, value_name = "N", value_parser = parse_unit)]
    stereo_unit: Option<u32>,
}

impl SoftCore {
    /// Returns the board with this processor and this unit, if it is one that may have them.
    #[must_use]
    pub fn applied(&self, board: Board) -> Board {
        let board = self.cpu.map_or(board, |cpu| board.with_processor(cpu));
        self.stereo_unit
            .map_or(board, |unit_lanes| board.with_unit(unit_lanes))
    }
}

/// Returns the processor that has this name.
///
/// # Errors
/// Fails with one line when none has it.
fn parse_processor(name: &str) -> Result<Processor, String> {
    let mut all = Processor::ALL.into_iter();
    let named = all.find(|processor| processor.name() == name);
    named.ok_or_else(|| "there are vexriscv and cv32e40p".to_owned())
}

/// Returns the number of costs in a cycle.
///
/// # Errors
/// Fails with one line when no unit makes so many.
fn parse_unit(lanes: &str) -> Result<u32, String> {
    let lanes = lanes.parse().ok();
    let known = lanes.filter(|lanes| *lanes == 0 || UNIT_LANES.contains(lanes));
    known.ok_or_else(|| "there are units for 8, 16 and 32 costs, and 0 for none".to_owned())
}

/// The option of the verbs that take one board or all boards.
#[derive(Debug, Clone, Args)]
pub struct Selection {
    /// Only this board: stm32f405, mps2-an500, mps3-an547, riscv-virt, riscv-virt-zbb, stm32h743, stm32f407 or
    /// softcore.
    #[arg(long, value_name = "B", value_parser = parse_board)]
    board: Option<Board>,
    #[command(flatten)]
    soft_core: SoftCore,
}

impl Selection {
    /// Returns the board that was named, or else all boards.
    #[must_use]
    pub fn boards(&self) -> Vec<Board> {
        let all = Board::ALL.into_iter();
        let selected = all.filter(|board| self.board.is_none_or(|one| one == *board));
        selected
            .map(|board| self.soft_core.applied(board))
            .collect()
    }
}

/// The option of the verbs that take one board whose costs are counted, or all that are emulated.
#[derive(Debug, Clone, Args)]
pub struct CountedSelection {
    /// Only this board: stm32f405, mps2-an500, mps3-an547, riscv-virt, riscv-virt-zbb or softcore.
    #[arg(long, value_name = "B", value_parser = parse_counted_board)]
    board: Option<Board>,
    #[command(flatten)]
    soft_core: SoftCore,
}

impl CountedSelection {
    /// Returns the board that was named, or else all emulated boards: a simulated one takes minutes.
    #[must_use]
    pub fn boards(&self) -> Vec<Board> {
        let selected = self.board.map(|board| vec![self.soft_core.applied(board)]);
        selected.unwrap_or_else(|| Board::emulated().collect())
    }
}

/// The option of the verbs that take one board that this machine can run or all of them.
#[derive(Debug, Clone, Args)]
pub struct ExecutedSelection {
    /// Only this board: stm32f405, mps2-an500, mps3-an547, riscv-virt, riscv-virt-zbb, stm32h743 or
    /// softcore.
    #[arg(long, value_name = "B", value_parser = parse_executed_board)]
    board: Option<Board>,
    #[command(flatten)]
    soft_core: SoftCore,
}

impl ExecutedSelection {
    /// Whether one board was named.
    #[must_use]
    pub const fn is_one(&self) -> bool {
        self.board.is_some()
    }

    /// Returns the board that was named, or else all emulated boards, and the modelled and the simulated ones
    /// if their models and simulations can be built.
    #[must_use]
    pub fn boards(&self) -> Vec<Board> {
        let modelled = Board::modelled().filter(|_| ModelCompiler::find().is_some());
        let simulated = Board::simulated().filter(|_| Simulator::find(Processor::VexRiscv).is_ok());
        let all = Board::emulated().chain(modelled).chain(simulated);
        let selected = self.board.map_or(all.collect(), |board| vec![board]);
        let selected = selected.into_iter();
        selected
            .map(|board| self.soft_core.applied(board))
            .collect()
    }
}

/// Returns the board that has this name.
///
/// # Errors
/// Fails with one line when no board has the name.
pub fn parse_board(name: &str) -> Result<Board, String> {
    name.parse()
        .map_err(|error: UnknownBoard| error.to_string())
}

/// Returns the board that has this name.
///
/// # Errors
/// Fails with one line when no board has the name or when nothing is counted on it.
pub fn parse_counted_board(name: &str) -> Result<Board, String> {
    let board = parse_board(name)?;
    if board.simulation.is_none() {
        board.emulation().map_err(|error| error.to_string())?;
    }
    Ok(board)
}

/// Returns the board that has this name.
///
/// # Errors
/// Fails with one line when no board has the name or when it does not serve the link here.
pub fn parse_live_board(name: &str) -> Result<Board, String> {
    let board = parse_board(name)?;
    if board.model.is_none() && board.simulation.is_none() {
        board.emulation().map_err(|error| error.to_string())?;
    }
    Ok(board)
}

/// Returns the board that has this name.
///
/// # Errors
/// Fails with one line when no board has the name or when it runs only as hardware.
pub fn parse_executed_board(name: &str) -> Result<Board, String> {
    let board = parse_board(name)?;
    if !board.is_executed() {
        board.emulation().map_err(|error| error.to_string())?;
    }
    Ok(board)
}

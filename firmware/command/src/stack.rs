//! The largest stack that firmware may need: the stack frames, as the compiler states them,
//! along the deepest chain of calls, and an interrupt on top.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use addr2line::gimli::{EndianSlice, LittleEndian, Reader};
use anyhow::Result;
use object::read::elf::ElfFile32;
use object::{Object, ObjectSection, ObjectSymbol, RelocationTarget};

use crate::elf;

/// The section in which the compiler states the size of each function's stack frame, if it is
/// asked to.
const FRAMES: &str = ".stack_sizes";
/// The section of a Cortex-M's handlers.
const VECTORS: &str = ".vector_table";
/// The handler that starts the program.
const START: &str = "Reset";
/// What a Cortex-M with an FPU puts on the stack when it takes an interrupt, with the word that aligns
/// it, bytes.
const EXCEPTION_BYTES: u64 = 27 * 4;

/// Returns the most bytes of stack along any chain of calls; `None` if the file does not state
/// the frames, for which the compiler must accept unstable options. The deepest chain of a handler
/// comes on top, once: the boards' interrupts have one priority.
///
/// Calls by a pointer are left out: formatting of text makes them, the pipeline does not. A
/// function that calls itself counts once: only panics do.
///
/// # Errors
/// Fails when the file cannot be read.
pub fn deepest_bytes(path: &Path) -> Result<Option<u64>> {
    let bytes = elf::read(path)?;
    let file = elf::parse(path, &bytes)?;
    let Some(section) = file.section_by_name(FRAMES) else {
        return Ok(None);
    };
    let mut stated = EndianSlice::new(section.data()?, LittleEndian);
    let mut frames = BTreeMap::new();
    while !stated.is_empty() {
        let function = elf::code_address(stated.read_u32()?.into());
        frames.insert(function, stated.read_uleb128()?);
    }
    let functions = elf::functions(&file);
    let mut callees: BTreeMap<u64, Vec<u64>> = BTreeMap::new();
    for (at, target) in elf::calls(&file)? {
        let to = elf::code_address(target.address());
        if let Some((&from, _)) = functions.range(..=at).next_back()
            && functions.contains_key(&to)
        {
            callees.entry(from).or_default().push(to);
        }
    }
    let handlers = handlers(&file)?;
    let mut depths = BTreeMap::new();
    let (mut thread, mut handler) = (0, 0);
    for &function in functions.keys() {
        let depth = depth(function, &frames, &callees, &mut depths);
        if handlers.contains(&function) {
            handler = handler.max(depth);
        } else {
            thread = thread.max(depth);
        }
    }
    // Where there is no interrupt, the handlers are empty loops.
    let taken = if handler > 0 { EXCEPTION_BYTES } else { 0 };
    Ok(Some(thread + handler + taken))
}

/// Returns the addresses of the functions that interrupts call.
fn handlers(file: &ElfFile32<'_>) -> Result<BTreeSet<u64>> {
    let mut handlers = BTreeSet::new();
    for (_, relocation) in file
        .section_by_name(VECTORS)
        .iter()
        .flat_map(ObjectSection::relocations)
    {
        if let RelocationTarget::Symbol(index) = relocation.target() {
            let symbol = file.symbol_by_index(index)?;
            if symbol.name() != Ok(START) {
                handlers.insert(elf::code_address(symbol.address()));
            }
        }
    }
    Ok(handlers)
}

/// Returns the bytes of a function's frame and of the deepest chain of calls below it. Where
/// functions call each other in a circle, one turn at most is counted.
fn depth(
    function: u64,
    frames: &BTreeMap<u64, u64>,
    callees: &BTreeMap<u64, Vec<u64>>,
    depths: &mut BTreeMap<u64, u64>,
) -> u64 {
    if let Some(&known) = depths.get(&function) {
        return known;
    }
    // Until its depth is known, a call of this function from below adds nothing.
    depths.insert(function, 0);
    let below = callees.get(&function).into_iter().flatten();
    let below = below.map(|&callee| depth(callee, frames, callees, depths));
    // Functions in assembly do not state a frame; theirs are too small to count.
    let depth = frames.get(&function).unwrap_or(&0) + below.max().unwrap_or(0);
    depths.insert(function, depth);
    depth
}

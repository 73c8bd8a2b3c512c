//! Reads linked firmware: its sizes, functions and calls.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use object::elf::PT_LOAD;
use object::read::elf::{ElfFile32, ElfSymbol32, FileHeader, ProgramHeader};
use object::{Object, ObjectSection, ObjectSymbol, RelocationTarget, SectionKind, SymbolKind};

/// The symbol of the memory that a board lends to matcher and session.
const LENT_MEMORY: &str = "lent_memory";

/// Returns the bytes of a linked file.
///
/// # Errors
/// Fails with one line when the file cannot be read.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))
}

/// Parses the bytes of the linked file of this path.
///
/// # Errors
/// Fails with one line when it is no firmware of a board.
pub(crate) fn parse<'data>(path: &Path, bytes: &'data [u8]) -> Result<ElfFile32<'data>> {
    ElfFile32::parse(bytes).with_context(|| format!("{} is not a 32-bit ELF file", path.display()))
}

/// The sizes of a board's firmware, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sizes {
    /// Flash: code, constants and initial values.
    pub flash_bytes: u64,
    /// Static RAM, without the lent memory.
    pub statics_bytes: u64,
    /// The static RAM that is lent to matcher and session.
    pub lent_bytes: usize,
}

impl Sizes {
    /// Returns the sizes of the firmware in a linked file.
    ///
    /// # Errors
    /// Fails when the file cannot be read or is not the firmware of a board.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = read(path)?;
        let file = parse(path, &bytes)?;
        let endian = file.endian();
        let segments = file.elf_header().program_headers(endian, &*bytes)?;
        let flash = segments.iter().filter(|s| s.p_type(endian) == PT_LOAD);
        // The fictitious sections of heap and stack hold no symbols.
        let ram = file.sections().filter(|section| {
            let kind = section.kind();
            matches!(kind, SectionKind::Data | SectionKind::UninitializedData)
                && !matches!(section.name(), Ok(".stack" | ".heap"))
        });
        let lent = file
            .symbols()
            .find(|symbol| symbol.name() == Ok(LENT_MEMORY))
            .with_context(|| format!("{} lends no memory", path.display()))?;
        let lent_bytes = usize::try_from(lent.size())?;
        Ok(Self {
            flash_bytes: flash.map(|s| u64::from(s.p_filesz(endian))).sum(),
            statics_bytes: ram.map(|s| s.size()).sum::<u64>() - lent.size(),
            lent_bytes,
        })
    }
}

/// Returns the address of a function's code. Bit 0 of a symbol's address is not a part of it:
/// it marks Thumb code.
pub(crate) const fn code_address(address: u64) -> u64 {
    address & !1
}

/// Returns the names of all functions by their address.
pub(crate) fn functions<'file>(file: &'file ElfFile32<'_>) -> BTreeMap<u64, &'file str> {
    file.symbols()
        .filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0)
        .filter_map(|symbol| Some((code_address(symbol.address()), symbol.name().ok()?)))
        .collect()
}

/// Returns the address of each reference in the code, with the symbol that it refers to: calls,
/// and pointers to functions and data. They come from the relocations that the linker has kept.
///
/// # Errors
/// Fails when a relocation names a symbol that is not in the file.
pub(crate) fn calls<'data, 'file>(
    file: &'file ElfFile32<'data>,
) -> Result<Vec<(u64, ElfSymbol32<'data, 'file>)>> {
    let mut calls = Vec::new();
    for section in file.sections().filter(|s| s.kind() == SectionKind::Text) {
        for (at, relocation) in section.relocations() {
            if let RelocationTarget::Symbol(index) = relocation.target() {
                calls.push((at, file.symbol_by_index(index)?));
            }
        }
    }
    Ok(calls)
}

/// The segments of linked firmware that are loaded into memory, each with its address and its bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image(Vec<(u64, Vec<u8>)>);

impl Image {
    /// Reads the segments of a linked file, each with the address that it is loaded to.
    ///
    /// # Errors
    /// Fails when the file cannot be read or is not the firmware of a board.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = read(path)?;
        let file = parse(path, &bytes)?;
        let endian = file.endian();
        let segments = file.elf_header().program_headers(endian, &*bytes)?;
        let loaded = segments.iter().filter(|s| s.p_type(endian) == PT_LOAD);
        let loaded = loaded.map(|segment| {
            let data = segment.data(endian, &*bytes);
            let data =
                data.map_err(|()| anyhow::anyhow!("a segment of {} is cut off", path.display()))?;
            Ok((segment.p_paddr(endian).into(), data.to_vec()))
        });
        loaded.collect::<Result<_>>().map(Self)
    }

    /// Returns what is loaded from this address on, at most as many bytes, with zeros between segments,
    /// in whole words.
    ///
    /// # Errors
    /// Fails when a segment is partly outside of this range.
    pub fn bytes(&self, start: u64, length: u64) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        for (address, segment) in &self.0 {
            let end = address + segment.len() as u64;
            if segment.is_empty() || *address >= start + length || end <= start {
                continue;
            }
            anyhow::ensure!(
                *address >= start && end <= start + length,
                "what is loaded from {address:#x} on does not fit its memory"
            );
            let first = usize::try_from(address - start)?;
            let last = first + segment.len();
            if bytes.len() < last {
                bytes.resize(last.next_multiple_of(4), 0);
            }
            if let Some(place) = bytes.get_mut(first..last) {
                place.copy_from_slice(segment);
            }
        }
        Ok(bytes)
    }
}

/// Returns the address and the size of a symbol of linked firmware.
///
/// # Errors
/// Fails when the file cannot be read, or has no such symbol.
pub fn symbol(path: &Path, name: &str) -> Result<(u64, u64)> {
    let bytes = read(path)?;
    let file = parse(path, &bytes)?;
    let mut symbols = file.symbols();
    let found = symbols.find(|symbol| symbol.name() == Ok(name));
    let found = found.with_context(|| format!("{} has no {name}", path.display()))?;
    Ok((found.address(), found.size()))
}

//! What was linked: sizes, functions, calls.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use object::elf::PT_LOAD;
use object::read::elf::{ElfFile32, ElfSymbol32, FileHeader, ProgramHeader};
use object::{Object, ObjectSection, ObjectSymbol, RelocationTarget, SectionKind, SymbolKind};

/// The symbol of the memory that a board lends.
const LENT_MEMORY: &str = "lent_memory";

/// Bytes of a board's firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sizes {
    /// Code, constants and initial values.
    pub flash_bytes: u64,
    /// Statics, without the lent memory.
    pub statics_bytes: u64,
    /// The memory that is lent to matcher and session.
    pub lent_bytes: usize,
}

impl Sizes {
    /// Of a linked file.
    ///
    /// # Errors
    /// When the file cannot be read or is no board's firmware.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes =
            std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let file: ElfFile32 = ElfFile32::parse(&*bytes)
            .with_context(|| format!("{} is not a 32-bit ELF file", path.display()))?;
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

/// Bit 0 of a function's address tells Thumb code.
pub(crate) const fn code_address(address: u64) -> u64 {
    address & !1
}

/// The names of all functions by their address.
pub(crate) fn functions<'file>(file: &'file ElfFile32<'_>) -> BTreeMap<u64, &'file str> {
    file.symbols()
        .filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0)
        .filter_map(|symbol| Some((code_address(symbol.address()), symbol.name().ok()?)))
        .collect()
}

/// Where code refers to what, as the relocations tell that it was linked with: calls, and
/// pointers to functions and data.
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

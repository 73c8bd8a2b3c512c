//! An allocator that places what a thread allocates against pages that cannot be accessed.
//!
//! A kernel that reads or writes one byte outside of a slice ends the process with a segmentation
//! fault, whatever it does with the byte. Run with `--test-threads 1` to see in which test.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ptr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use vgstereo_kernels::cases::Case;

use crate::Run;

/// Side of an allocation on which the next byte cannot be accessed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    /// The allocation begins exactly after an inaccessible page.
    Before,
    /// The allocation ends exactly before an inaccessible page.
    After,
}

impl Side {
    pub(crate) const ALL: [Self; 2] = [Self::Before, Self::After];
}

/// The allocator of the process: that of the system, but for the allocations within [`with`].
pub(crate) struct Guarded;

std::thread_local! {
    static SIDE: Cell<Option<Side>> = const { Cell::new(None) };
}

/// Runs `body`, with all that this thread allocates meanwhile guarded on one side.
pub(crate) fn with<T>(side: Side, body: impl FnOnce() -> T) -> T {
    struct Reset;
    impl Drop for Reset {
        fn drop(&mut self) {
            SIDE.set(None);
        }
    }
    SIDE.set(Some(side));
    let _reset = Reset;
    body()
}

/// Runs a copy of a case whose buffers are guarded on one side, and returns its output.
pub(crate) fn output<C: Case>(case: &C, run: Run<'_, C>, side: Side) -> C::Output {
    with(side, || {
        let mut case = case.clone();
        run(&mut case);
        case.output()
    })
}

/// The guard itself: a process that reads one byte too many does not survive.
pub(crate) fn one_byte_beyond_a_buffer_ends_the_process() {
    for side in Side::ALL {
        let bytes = with(side, || vec![1_u8; 100]);
        let at = match side {
            Side::Before => bytes.as_ptr().wrapping_sub(1),
            Side::After => bytes.as_ptr().wrapping_add(bytes.len()),
        };
        let mut status = 0;
        // SAFETY: the child only reads, which must end it, or else ends by itself; the status is
        // this process's own.
        unsafe {
            // A copy of the process rather than a new one, which an emulator could not start.
            let child = libc::fork();
            if child == 0 {
                at.read_volatile();
                libc::_exit(0);
            }
            assert_eq!(libc::waitpid(child, &raw mut status, 0), child, "{side:?}");
        }
        let signal = libc::WIFSIGNALED(status).then(|| libc::WTERMSIG(status));
        assert_eq!(signal, Some(libc::SIGSEGV), "{side:?}: {status}");
    }
}

/// Addresses for guarded allocations. An allocation has a power of two of pages, beginning at a multiple of their length;
/// before them lie as many that cannot be accessed.
struct Room {
    page_bytes: usize,
    start: usize,
    /// Address of the next pages.
    next: AtomicUsize,
}

const ROOM_BYTES: usize = 1 << 38;

static ROOM: OnceLock<Option<Room>> = OnceLock::new();

/// Numbers of pages that an allocation may have: the powers of two below this one.
const POWERS: usize = 24;

std::thread_local! {
    /// Pages that this thread has freed, by the power of two of their number: the first, which hold the address of the next.
    /// To close pages and open new ones takes longer than most kernels.
    static FREED: Cell<[*mut u8; POWERS]> = const { Cell::new([ptr::null_mut(); POWERS]) };
}

impl Room {
    fn reserve() -> Option<Self> {
        let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_NORESERVE;
        // SAFETY: a new mapping at an address of the system's choice touches no other.
        let (page_bytes, start) = unsafe {
            (
                libc::sysconf(libc::_SC_PAGESIZE),
                libc::mmap(ptr::null_mut(), ROOM_BYTES, libc::PROT_NONE, flags, -1, 0),
            )
        };
        if start == libc::MAP_FAILED {
            return None;
        }
        let start = start.expose_provenance();
        Some(Self {
            page_bytes: page_bytes.try_into().ok()?,
            start,
            next: AtomicUsize::new(start),
        })
    }

    fn contains(&self, address: usize) -> bool {
        (self.start..self.start + ROOM_BYTES).contains(&address)
    }

    /// Returns the number of pages for `layout`, as a power of two, and their bytes.
    fn pages(&self, layout: Layout) -> (usize, usize) {
        let pages = layout.size().div_ceil(self.page_bytes).next_power_of_two();
        (pages.ilog2() as usize, pages * self.page_bytes)
    }

    /// Returns null if there is no room left.
    fn place(&self, layout: Layout, side: Side) -> *mut u8 {
        let (power, bytes) = self.pages(layout);
        if layout.align() > self.page_bytes || power >= POWERS {
            return ptr::null_mut();
        }
        let mut freed = FREED.get();
        let mut start = freed[power];
        if start.is_null() {
            start = self.open(bytes);
        } else {
            // SAFETY: freed pages hold the address of the next ones, and are this thread's own.
            freed[power] = unsafe { start.cast::<*mut u8>().read() };
            FREED.set(freed);
        }
        match side {
            _ if start.is_null() => start,
            Side::Before => start,
            Side::After => start.wrapping_add((bytes - layout.size()) & !(layout.align() - 1)),
        }
    }

    /// Returns pages that were never used; null if there are none.
    fn open(&self, bytes: usize) -> *mut u8 {
        let end = |next: usize| next.next_multiple_of(2 * bytes) + 2 * bytes;
        // The page after the last ones cannot be accessed either.
        let last = self.start + ROOM_BYTES - self.page_bytes;
        let next = self
            .next
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |next| {
                Some(end(next)).filter(|&end| end <= last)
            });
        let Ok(next) = next else {
            return ptr::null_mut();
        };
        let start = ptr::with_exposed_provenance_mut::<u8>(end(next) - bytes);
        // SAFETY: these pages are within the reservation and nobody else's.
        let result =
            unsafe { libc::mprotect(start.cast(), bytes, libc::PROT_READ | libc::PROT_WRITE) };
        if result == 0 { start } else { ptr::null_mut() }
    }

    /// Takes the pages of an allocation back.
    ///
    /// # Safety
    /// `place` returned `at` for this layout, and it is not used any more.
    unsafe fn free(&self, at: *mut u8, layout: Layout) {
        let (power, bytes) = self.pages(layout);
        let start = at.wrapping_sub(at.addr() % bytes);
        let mut freed = FREED.get();
        // SAFETY: the pages hold this allocation alone, and are aligned.
        unsafe { start.cast::<*mut u8>().write(freed[power]) };
        freed[power] = start;
        FREED.set(freed);
    }
}

// SAFETY: memory comes from the system's allocator or from pages of a reservation that hold one allocation at a time;
// `dealloc` tells the two apart by their addresses.
unsafe impl GlobalAlloc for Guarded {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let Some(side) = SIDE.try_with(Cell::get).ok().flatten() else {
            // SAFETY: the caller's promises are those that this call needs.
            return unsafe { System.alloc(layout) };
        };
        let room = ROOM.get_or_init(Room::reserve).as_ref();
        room.map_or(ptr::null_mut(), |room| room.place(layout, side))
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        match ROOM.get().and_then(Option::as_ref) {
            // SAFETY: only `place` returns addresses in the room.
            Some(room) if room.contains(at.addr()) => unsafe { room.free(at, layout) },
            // SAFETY: all others come from the system's allocator.
            _ => unsafe { System.dealloc(at, layout) },
        }
    }
}

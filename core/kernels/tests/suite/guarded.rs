//! An allocator that places what a thread allocates against pages that cannot be accessed.
//!
//! A kernel that reads or writes one byte outside of a slice ends the process with a segmentation
//! fault, whatever it does with the byte. Run with `--test-threads 1` to see in which test.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ptr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use vgstereo_core::kernel::Kernels;
use vgstereo_kernels::cases::Case;

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
pub(crate) fn output<C: Case>(case: &C, kernels: impl Kernels, side: Side) -> C::Output {
    with(side, || {
        let mut case = case.clone();
        case.run(kernels);
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

/// Addresses for guarded allocations. None is used twice, so that one room serves some million.
struct Room {
    page_bytes: usize,
    start: usize,
    next: AtomicUsize,
}

const ROOM_BYTES: usize = 1 << 38;

static ROOM: OnceLock<Option<Room>> = OnceLock::new();

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
        (start != libc::MAP_FAILED).then_some(Self {
            page_bytes: page_bytes.try_into().ok()?,
            start: start.expose_provenance(),
            next: AtomicUsize::new(0),
        })
    }

    fn contains(&self, address: usize) -> bool {
        (self.start..self.start + ROOM_BYTES).contains(&address)
    }

    /// Whole pages that hold `layout`.
    fn bytes_of(&self, layout: Layout) -> usize {
        layout.size().next_multiple_of(self.page_bytes)
    }

    /// Returns null if there is no room left.
    fn place(&self, layout: Layout, side: Side) -> *mut u8 {
        let bytes = self.bytes_of(layout);
        // The page before stays inaccessible, and so does the one before the next allocation.
        let at = self
            .next
            .fetch_add(self.page_bytes + bytes, Ordering::Relaxed)
            + self.page_bytes;
        if layout.align() > self.page_bytes || at + bytes + self.page_bytes > ROOM_BYTES {
            return ptr::null_mut();
        }
        let start = ptr::with_exposed_provenance_mut::<u8>(self.start + at);
        // SAFETY: these pages are within the reservation and nobody else's.
        let done =
            unsafe { libc::mprotect(start.cast(), bytes, libc::PROT_READ | libc::PROT_WRITE) == 0 };
        match side {
            _ if !done => ptr::null_mut(),
            Side::Before => start,
            Side::After => start.wrapping_add((bytes - layout.size()) & !(layout.align() - 1)),
        }
    }

    /// Makes the pages of an allocation inaccessible and gives their memory back.
    ///
    /// # Safety
    /// `place` returned `at` for this layout, and it is not used any more.
    unsafe fn close(&self, at: *mut u8, layout: Layout) {
        let start = at.wrapping_sub(at.addr() % self.page_bytes).cast();
        let bytes = self.bytes_of(layout);
        // SAFETY: these pages hold this allocation alone.
        unsafe {
            libc::madvise(start, bytes, libc::MADV_DONTNEED);
            libc::mprotect(start, bytes, libc::PROT_NONE);
        }
    }
}

// SAFETY: memory comes from the system's allocator or from pages of a reservation that are used
// once; `dealloc` tells the two apart by their addresses.
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
            Some(room) if room.contains(at.addr()) => unsafe { room.close(at, layout) },
            // SAFETY: all others come from the system's allocator.
            _ => unsafe { System.dealloc(at, layout) },
        }
    }
}

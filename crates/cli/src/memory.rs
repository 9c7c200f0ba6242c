//! Memory of large arrays in large pages, where the system gives them to who asks.
//!
//! A tree of a million lights is tens of megabytes, and reading it here and there finds few of its small pages in the
//! processor's table of them. Linux makes pages of 2 MB of memory before it is first touched, on many machines only for
//! programs that ask.

#![allow(
    unsafe_code,
    reason = "an allocator hands out raw memory, and advice is about addresses"
)]

use std::alloc::{GlobalAlloc, Layout, System};

use rustix::mm::{Advice, madvise};

/// The system's allocator.
pub(crate) struct LargePages;

/// Smaller blocks are not worth a call.
const LARGE: usize = 4 << 20;
/// What addresses of advice are multiples of, on any machine of today.
const PAGE: usize = 64 << 10;

// SAFETY: every call is handed on to the system's allocator, and what that answers is handed back.
unsafe impl GlobalAlloc for LargePages {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promises are those that are asked for.
        let memory = unsafe { System.alloc(layout) };
        ask_for_large_pages(memory, layout.size());
        memory
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        let memory = unsafe { System.alloc_zeroed(layout) };
        ask_for_large_pages(memory, layout.size());
        memory
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as above.
        let memory = unsafe { System.realloc(memory, layout, size) };
        ask_for_large_pages(memory, size);
        memory
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(memory, layout) }
    }
}

/// Of a block of `size` bytes, if it is large and there is one. Whether they are given makes no difference but to speed.
fn ask_for_large_pages(memory: *mut u8, size: usize) {
    if size < LARGE || memory.is_null() {
        return;
    }
    let before = memory.align_offset(PAGE);
    let whole = (size - before) & !(PAGE - 1);
    // SAFETY: the range is within the block, which is ours; this advice changes nothing that it holds.
    let _ = unsafe {
        madvise(
            memory.wrapping_add(before).cast(),
            whole,
            Advice::LinuxHugepage,
        )
    };
}

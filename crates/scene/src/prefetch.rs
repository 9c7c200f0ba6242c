//! Asking for memory before it is needed.

/// Asks for the memory of `value`: who does something else first finds it in the cache. Nothing on processors other than
/// x86-64.
#[inline(always)]
pub(crate) fn prefetch<T>(value: Option<&T>) {
    #[cfg(target_arch = "x86_64")]
    if let Some(value) = value {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let address = std::ptr::from_ref(value).cast::<i8>();
        for line in 0..size_of::<T>().div_ceil(64) {
            #[allow(unsafe_code, reason = "the only way to prefetch")]
            // SAFETY: a prefetch reads nothing the program can see and never faults.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(64 * line));
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = value;
}

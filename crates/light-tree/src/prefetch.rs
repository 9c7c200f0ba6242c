//! Asking for memory before it is needed.

/// Asks for the memory of `value`: who does something else first finds it in the cache. Nothing on processors other than
/// x86-64.
#[inline(always)]
pub(crate) fn prefetch<T>(value: Option<&T>) {
    #[cfg(target_arch = "x86_64")]
    if let Some(value) = value {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let address = std::ptr::from_ref(value).cast::<i8>();
        // A value that is not aligned to lines may end in one more.
        let lines = (size_of::<T>() + 64 - align_of::<T>().min(64)).div_ceil(64);
        for line in 0..lines {
            #[allow(unsafe_code, reason = "the only way to prefetch")]
            // SAFETY: a prefetch reads nothing the program can see and never faults.
            unsafe {
                let byte = (64 * line).min(size_of::<T>() - 1);
                _mm_prefetch::<_MM_HINT_T0>(address.wrapping_add(byte));
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = value;
}

/// The same for one of many values, of a line at most, or for nothing where there are not so many. Without a branch.
#[inline(always)]
pub(crate) fn prefetch_at<T>(values: &[T], at: usize) {
    const { assert!(size_of::<T>() == align_of::<T>(), "within a line") };
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let address = values.as_ptr().wrapping_add(at).cast::<i8>();
        #[allow(unsafe_code, reason = "the only way to prefetch")]
        // SAFETY: a prefetch reads nothing the program can see and never faults.
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(address);
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (values, at);
}

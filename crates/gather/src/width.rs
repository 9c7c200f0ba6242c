//! The same code for vectors of several widths.

/// Declares a function of what `$with` takes and gives, which calls that where it is compiled for AVX-512 or AVX2, if the
/// processor has it: the same operations, and so the same bits. All that `$with` calls has to be inlined.
macro_rules! by_width {
    ($name:ident = $with:ident($($argument:ident: $type:ty),*) $(-> $output:ty)?) => {
        fn $name($($argument: $type),*) $(-> $output)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
                fn avx512($($argument: $type),*) $(-> $output)? {
                    $with($($argument),*)
                }

                #[target_feature(enable = "avx2")]
                fn avx2($($argument: $type),*) $(-> $output)? {
                    $with($($argument),*)
                }

                #[allow(
                    unsafe_code,
                    reason = "the only way to call code for a processor found at run time"
                )]
                if $crate::width::is_allowed($crate::width::Width::Avx512)
                    && std::arch::is_x86_feature_detected!("avx512f")
                    && std::arch::is_x86_feature_detected!("avx512vl")
                    && std::arch::is_x86_feature_detected!("avx512dq")
                    && std::arch::is_x86_feature_detected!("avx512bw")
                {
                    // SAFETY: the processor has what was just asked for.
                    return unsafe { avx512($($argument),*) };
                } else if $crate::width::is_allowed($crate::width::Width::Avx2)
                    && std::arch::is_x86_feature_detected!("avx2")
                {
                    // SAFETY: as above.
                    return unsafe { avx2($($argument),*) };
                }
            }
            $with($($argument),*)
        }
    };
}
pub(crate) use by_width;

/// Instructions that code is compiled for, the narrowest first.
#[cfg_attr(
    not(test),
    allow(dead_code, reason = "only tests are content with the narrowest")
)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Width {
    Any,
    Avx2,
    Avx512,
}

/// Whether instructions of that width may be used where the processor has them. Always, but in tests of the narrower ones.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(crate) fn is_allowed(width: Width) -> bool {
    #[cfg(test)]
    return width <= WIDEST.get();
    #[cfg(not(test))]
    {
        let _ = width;
        true
    }
}

#[cfg(test)]
thread_local! {
    /// What a test's own thread goes up to.
    pub(crate) static WIDEST: std::cell::Cell<Width> = const { std::cell::Cell::new(Width::Avx512) };
}

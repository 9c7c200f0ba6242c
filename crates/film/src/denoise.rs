//! Intel Open Image Denoise, where its library is.
//!
//! The library is looked for when it is asked for, so that neither building nor any other command needs it.
//!
//! Source: "Intel Open Image Denoise", Library Version 2, C99 API.

#![allow(unsafe_code, reason = "the library is written in another language")]

use std::ffi::{CStr, c_char, c_int, c_void};
use std::ptr;

use glam::Vec3;
use libloading::Library;

use crate::{Image, Picture};

/// Names of version 2 of the library.
const NAMES: &[&str] = if cfg!(windows) {
    &["OpenImageDenoise.dll"]
} else if cfg!(target_os = "macos") {
    &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.dylib"]
} else {
    &["libOpenImageDenoise.so.2", "libOpenImageDenoise.so"]
};

/// A device, filter or null of the library.
type Handle = *mut c_void;

/// `OIDN_DEVICE_TYPE_CPU`: the only kind of device that takes any memory.
const CPU: c_int = 1;
/// `OIDN_FORMAT_FLOAT3`.
const FLOAT3: c_int = 3;

/// A picture that cannot be denoised.
#[derive(Debug, thiserror::Error)]
pub enum DenoiseError {
    /// There is no such library.
    #[error(
        "Open Image Denoise is not here ({0}); expected version 2 of its library, of www.openimagedenoise.org or the \
         system's packages, where the system looks for libraries (on Linux also in LD_LIBRARY_PATH)"
    )]
    Library(String),
    /// The library refuses.
    #[error("Open Image Denoise failed: {0}")]
    Failed(String),
}

/// The library, ready for work.
pub struct Denoiser {
    api: Api,
    device: Handle,
}

/// What is used of the library; the pointers hold as long as it is loaded.
struct Api {
    new_device: unsafe extern "C" fn(c_int) -> Handle,
    commit_device: unsafe extern "C" fn(Handle),
    release_device: unsafe extern "C" fn(Handle),
    device_error: unsafe extern "C" fn(Handle, *mut *const c_char) -> c_int,
    new_filter: unsafe extern "C" fn(Handle, *const c_char) -> Handle,
    release_filter: unsafe extern "C" fn(Handle),
    set_image: unsafe extern "C" fn(
        Handle,
        *const c_char,
        *mut c_void,
        c_int,
        usize,
        usize,
        usize,
        usize,
        usize,
    ),
    set_bool: unsafe extern "C" fn(Handle, *const c_char, bool),
    commit_filter: unsafe extern "C" fn(Handle),
    execute_filter: unsafe extern "C" fn(Handle),
    _library: Library,
}

impl Api {
    fn load() -> Result<Self, libloading::Error> {
        // SAFETY: what runs when the library is loaded is its own affair, as for any program linked with it.
        let open = |name: &&str| unsafe { Library::new(name) };
        let library = match NAMES.iter().find_map(|name| open(name).ok()) {
            Some(library) => library,
            // The name that is expected says best why.
            None => open(&NAMES[0])?,
        };
        // SAFETY: the types are those of version 2's header, and version 1 lacks one of the names.
        unsafe {
            Ok(Self {
                new_device: *library.get(b"oidnNewDevice\0")?,
                commit_device: *library.get(b"oidnCommitDevice\0")?,
                release_device: *library.get(b"oidnReleaseDevice\0")?,
                device_error: *library.get(b"oidnGetDeviceError\0")?,
                new_filter: *library.get(b"oidnNewFilter\0")?,
                release_filter: *library.get(b"oidnReleaseFilter\0")?,
                set_image: *library.get(b"oidnSetSharedFilterImage\0")?,
                set_bool: *library.get(b"oidnSetFilterBool\0")?,
                commit_filter: *library.get(b"oidnCommitFilter\0")?,
                execute_filter: *library.get(b"oidnExecuteFilter\0")?,
                _library: library,
            })
        }
    }

    /// The first error of `device` (null for none in particular) since it was last asked.
    fn check(&self, device: Handle) -> Result<(), DenoiseError> {
        let mut message: *const c_char = ptr::null();
        // SAFETY: the device is one of ours or null, and the message is a string that lives until the next call.
        unsafe {
            if (self.device_error)(device, &mut message) == 0 {
                return Ok(());
            }
            let text = match message.is_null() {
                true => "it does not say why".into(),
                false => CStr::from_ptr(message).to_string_lossy(),
            };
            Err(DenoiseError::Failed(text.into_owned()))
        }
    }
}

/// One image of a filter.
struct Layer<'a> {
    name: &'a CStr,
    pixels: &'a [Vec3],
}

impl Denoiser {
    /// Looks for the library and starts it.
    ///
    /// # Errors
    /// When it is not there, is another version, or does not start.
    pub fn load() -> Result<Self, DenoiseError> {
        let api = Api::load().map_err(|error| DenoiseError::Library(error.to_string()))?;
        // SAFETY: the call takes any number; null is an error that is asked for next.
        let device = unsafe { (api.new_device)(CPU) };
        if device.is_null() {
            api.check(ptr::null_mut())?;
            return Err(DenoiseError::Failed("there is no device".into()));
        }
        // SAFETY: the device is there.
        unsafe { (api.commit_device)(device) };
        let denoiser = Self { api, device };
        denoiser.api.check(denoiser.device)?;
        Ok(denoiser)
    }

    /// The radiance of `picture` without its noise, guided by albedo and normals, which are rid of theirs first.
    ///
    /// # Errors
    /// When the library refuses.
    pub fn denoise(&self, picture: &Picture) -> Result<Image, DenoiseError> {
        let size = [picture.width as usize, picture.height as usize];
        let layer = |name, pixels| Layer { name, pixels };
        let albedo = self.filtered(size, &[layer(c"albedo", &picture.albedo)], &[])?;
        let normal = self.filtered(size, &[layer(c"normal", &picture.normal)], &[])?;
        let layers = [
            layer(c"color", &picture.radiance),
            layer(c"albedo", &albedo),
            layer(c"normal", &normal),
        ];
        Ok(Image {
            width: picture.width,
            height: picture.height,
            pixels: self.filtered(size, &layers, &[c"hdr", c"cleanAux"])?,
        })
    }

    /// What the ray tracing filter makes of `layers` with `flags` set.
    fn filtered(
        &self,
        [width, height]: [usize; 2],
        layers: &[Layer<'_>],
        flags: &[&CStr],
    ) -> Result<Vec<Vec3>, DenoiseError> {
        let mut output = vec![Vec3::ZERO; width * height];
        let inputs = layers
            .iter()
            .map(|l| (l.name, l.pixels.as_ptr().cast_mut(), l.pixels.len()));
        let images: Vec<_> = inputs
            .chain([(c"output", output.as_mut_ptr(), output.len())])
            .collect();
        assert!(
            images
                .iter()
                .all(|&(_, _, length)| length == width * height),
            "a layer does not have {width}x{height} pixels"
        );
        let api = &self.api;
        // SAFETY: device and filter are there; each image is as large as it is said to be, three floats a pixel without
        // gaps, and outlives the filter; only the output is written to.
        unsafe {
            let filter = (api.new_filter)(self.device, c"RT".as_ptr());
            if filter.is_null() {
                api.check(self.device)?;
                return Err(DenoiseError::Failed("there is no filter RT".into()));
            }
            for (name, pixels, _) in images {
                (api.set_image)(
                    filter,
                    name.as_ptr(),
                    pixels.cast(),
                    FLOAT3,
                    width,
                    height,
                    0,
                    0,
                    0,
                );
            }
            for flag in flags {
                (api.set_bool)(filter, flag.as_ptr(), true);
            }
            (api.commit_filter)(filter);
            (api.execute_filter)(filter);
            (api.release_filter)(filter);
        }
        api.check(self.device)?;
        Ok(output)
    }
}

impl Drop for Denoiser {
    fn drop(&mut self) {
        // SAFETY: the device is there, and nobody else has it.
        unsafe { (self.api.release_device)(self.device) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the library is not there, that is what has to be said.
    #[test]
    fn noise_goes_or_the_library_is_said_to_be_missing() {
        let denoiser = match Denoiser::load() {
            Ok(denoiser) => denoiser,
            Err(error) => {
                let text = error.to_string();
                assert!(text.contains("expected version 2 of its library"), "{text}");
                return;
            }
        };
        let mut picture = Picture::new(64, 48);
        let mut state = 1_u64;
        for i in 0..64 * 48 {
            // Half of the pixels, at random, are lit twice as much as they should be.
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            let lit = state >> 63;
            picture.radiance[i] = Vec3::splat(2.0 * lit as f32);
            picture.albedo[i] = Vec3::splat(0.5);
            picture.normal[i] = Vec3::Y;
        }
        let image = denoiser.denoise(&picture).expect("denoises");
        let off = |pixels: &[Vec3]| pixels.iter().map(|c| (c.x - 1.0).powi(2)).sum::<f32>();
        assert!(
            off(&image.pixels) < 0.1 * off(&picture.radiance),
            "noise is left"
        );
    }
}

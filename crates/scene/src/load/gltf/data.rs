//! Buffers and accessors: typed numbers in bytes, every offset checked.

use std::borrow::Cow;

use base64::Engine;
use glam::Vec3;
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::validation::Checked;
use gltf::json::{Accessor, Root};
use percent_encoding::percent_decode_str;

use crate::load::source::{Source, join};
use crate::load::unreadable;

/// Elements that an accessor may have that no bytes stand for: without a `bufferView` all are zero.
const MOST_ZEROS: u64 = 1 << 24;

/// Where a URI leads.
pub(super) enum Resource {
    /// In the URI itself.
    Data(Vec<u8>),
    /// Name in the source.
    File(String),
}

/// Follows the `uri` in the file called `from`; else a message.
pub(super) fn resource(from: &str, uri: &str) -> Result<Resource, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let base64 = data.split_once(";base64,").map(|(_, base64)| base64);
        let base64 = base64.ok_or("a data URI of another kind; expected data:…;base64,…")?;
        let bytes = base64::engine::general_purpose::STANDARD.decode(base64);
        return Ok(Resource::Data(bytes.map_err(|e| format!("base64: {e}"))?));
    }
    let name = percent_decode_str(uri).decode_utf8();
    let name = name.map_err(|_| format!("`{uri}` is not UTF-8"))?;
    Ok(Resource::File(join(from, &name)?))
}

/// Item `index` of a list of the file, which `field` names; else a message.
pub(super) fn item<'a, T>(list: &'a [T], index: usize, field: &str) -> Result<&'a T, String> {
    list.get(index).ok_or_else(|| {
        let count = list.len();
        format!("{field}: found index {index}; expected one below {count}, as many as there are")
    })
}

/// The file's buffers in memory.
pub(super) struct Data<'a> {
    pub(super) root: &'a Root,
    buffers: Vec<Cow<'a, [u8]>>,
}

impl<'a> Data<'a> {
    /// Reads all buffers of the file called `name`; `blob` is the binary part of a GLB.
    pub(super) fn read(
        root: &'a Root,
        blob: Option<&'a [u8]>,
        source: &Source,
        name: &str,
    ) -> Result<Self, String> {
        let mut buffers = Vec::new();
        for (i, buffer) in root.buffers.iter().enumerate() {
            let bytes = match &buffer.uri {
                Some(uri) => {
                    let wrong = |message| format!("buffers[{i}].uri: {message}");
                    Cow::Owned(match resource(name, uri).map_err(wrong)? {
                        Resource::Data(bytes) => bytes,
                        Resource::File(file) => source
                            .read(&file)
                            .map_err(|e| wrong(unreadable(source, &file, &e)))?,
                    })
                }
                None => {
                    let blob = blob.filter(|_| i == 0);
                    Cow::Borrowed(blob.ok_or_else(|| {
                        format!("buffers[{i}]: there is no uri, and no binary part to stand for it")
                    })?)
                }
            };
            let length = buffer.byte_length.0;
            if (bytes.len() as u64) < length {
                let found = bytes.len();
                return Err(format!(
                    "buffers[{i}]: found {found} bytes; expected byteLength, which is {length}"
                ));
            }
            buffers.push(bytes);
        }
        Ok(Self { root, buffers })
    }

    /// The bytes of a buffer view, and the distance between elements if it is given.
    pub(super) fn view(&self, index: usize, field: &str) -> Result<(&[u8], Option<usize>), String> {
        let view = item(&self.root.buffer_views, index, field)?;
        let place = format!("bufferViews[{index}]");
        let buffer = item(
            &self.buffers,
            view.buffer.value(),
            &format!("{place}.buffer"),
        )?;
        let offset = view.byte_offset.map_or(0, |offset| offset.0);
        let end = offset.checked_add(view.byte_length.0);
        let range =
            end.and_then(|end| Some(usize::try_from(offset).ok()?..usize::try_from(end).ok()?));
        let bytes = range.and_then(|range| buffer.get(range)).ok_or_else(|| {
            let (length, all) = (view.byte_length.0, buffer.len());
            format!("{place}: found {length} bytes from {offset}; expected them within the buffer's {all}")
        })?;
        Ok((bytes, view.byte_stride.map(|stride| stride.0)))
    }

    /// `count` elements of `size` bytes each.
    fn elements(
        &self,
        view: usize,
        offset: u64,
        count: u64,
        size: usize,
        field: &str,
    ) -> Result<impl Iterator<Item = &[u8]>, String> {
        let (bytes, stride) = self.view(view, &format!("{field}.bufferView"))?;
        let stride = stride.unwrap_or(size);
        if stride < size {
            return Err(format!(
                "{field}: elements of {size} bytes every {stride} bytes; expected no overlap"
            ));
        }
        let end = count.saturating_sub(1).checked_mul(stride as u64);
        let end = end.and_then(|end| end.checked_add(offset)?.checked_add(size as u64));
        if count > 0 && end.is_none_or(|end| end > bytes.len() as u64) {
            let all = bytes.len();
            return Err(format!(
                "{field}: {count} elements of {size} bytes from {offset} on; expected them within the \
                 bufferView's {all}"
            ));
        }
        // Checked: the offset lies in the view where there is any element.
        let from = bytes.get(offset as usize..).unwrap_or_default();
        Ok(from
            .chunks(stride)
            .take(count as usize)
            .map(move |chunk| &chunk[..size]))
    }

    /// The elements of an accessor, each made by `element` from its bytes; sparse ones are put in.
    fn accessor<T: Clone>(
        &self,
        index: usize,
        field: &str,
        expected: Type,
        element: impl Fn(&Accessor, ComponentType, &[u8]) -> Result<T, String>,
    ) -> Result<Vec<T>, String> {
        let accessor = item(&self.root.accessors, index, field)?;
        let place = format!("accessors[{index}]");
        let (Checked::Valid(kind), Checked::Valid(component)) =
            (accessor.type_, accessor.component_type)
        else {
            return Err(format!("{place}: found an unknown type or componentType"));
        };
        if kind != expected {
            return Err(format!(
                "{field}: {place} is of {kind:?}; expected {expected:?}"
            ));
        }
        let component = component.0;
        let size = component.size() * kind.multiplicity();
        let element = |bytes: &[u8]| {
            element(accessor, component, bytes)
                .map_err(|message| format!("{field}: {place}: {message}"))
        };
        let count = accessor.count.0;
        let mut all: Vec<T> = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                let elements = self.elements(view.value(), offset, count, size, &place)?;
                elements.map(&element).collect::<Result<_, _>>()?
            }
            None if count <= MOST_ZEROS => vec![element(&vec![0; size])?; count as usize],
            None => {
                return Err(format!(
                    "{place}: found {count} elements without a bufferView; expected at most {MOST_ZEROS}"
                ));
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let Checked::Valid(index_component) = sparse.indices.component_type else {
                return Err(format!(
                    "{place}.sparse.indices: found an unknown componentType"
                ));
            };
            let (count, indices, values) = (sparse.count.0, &sparse.indices, &sparse.values);
            let index_size = index_component.0.size();
            let (indices_at, values_at) = (
                format!("{place}.sparse.indices"),
                format!("{place}.sparse.values"),
            );
            let (view, offset) = (indices.buffer_view.value(), indices.byte_offset.0);
            let indices = self.elements(view, offset, count, index_size, &indices_at)?;
            let (view, offset) = (values.buffer_view.value(), values.byte_offset.0);
            let values = self.elements(view, offset, count, size, &values_at)?;
            for (index, value) in indices.zip(values) {
                let index = whole(index_component.0, index).unwrap_or(u32::MAX);
                let length = all.len();
                let slot = all.get_mut(index as usize).ok_or_else(|| {
                    format!("{indices_at}: found {index}; expected less than {length}")
                })?;
                *slot = element(value)?;
            }
        }
        Ok(all)
    }

    /// An accessor of `N` = 2 to 4 numbers an element, all finite; whole numbers as the file's `normalized` says.
    pub(super) fn vectors<const N: usize>(
        &self,
        index: usize,
        field: &str,
    ) -> Result<Vec<[f32; N]>, String> {
        let expected = match N {
            2 => Type::Vec2,
            3 => Type::Vec3,
            _ => Type::Vec4,
        };
        self.accessor(index, field, expected, |accessor, component, bytes| {
            let size = component.size();
            let vector: [f32; N] =
                std::array::from_fn(|c| number(component, accessor.normalized, &bytes[c * size..]));
            match vector.iter().all(|x| x.is_finite()) {
                true => Ok(vector),
                false => Err(format!("found {vector:?}; expected finite numbers")),
            }
        })
    }

    /// An accessor of colours with or without an alpha, which is left out; clamped to [0, 1].
    ///
    /// Source: glTF 2.0 specification, §3.7.2.1.
    pub(super) fn colours(&self, index: usize, field: &str) -> Result<Vec<Vec3>, String> {
        let kind = item(&self.root.accessors, index, field)?.type_;
        let colours: Vec<Vec3> = match kind {
            Checked::Valid(Type::Vec4) => {
                let with_alpha = self.vectors::<4>(index, field)?;
                let colours = with_alpha.into_iter();
                colours.map(|[r, g, b, _]| Vec3::new(r, g, b)).collect()
            }
            _ => {
                let colours = self.vectors::<3>(index, field)?;
                colours.into_iter().map(Vec3::from).collect()
            }
        };
        let colours = colours.into_iter();
        Ok(colours
            .map(|colour| colour.clamp(Vec3::ZERO, Vec3::ONE))
            .collect())
    }

    /// An accessor of whole numbers that are not negative.
    pub(super) fn indices(&self, index: usize, field: &str) -> Result<Vec<u32>, String> {
        self.accessor(index, field, Type::Scalar, |_, component, bytes| {
            whole(component, bytes).ok_or_else(|| {
                format!("found components of {component:?}; expected unsigned whole numbers")
            })
        })
    }
}

/// The unsigned whole number at the start of `bytes`; `None` where the type is another.
fn whole(component: ComponentType, bytes: &[u8]) -> Option<u32> {
    match component {
        ComponentType::U8 => bytes.first().copied().map(u32::from),
        ComponentType::U16 => bytes
            .first_chunk()
            .map(|&b| u32::from(u16::from_le_bytes(b))),
        ComponentType::U32 => bytes.first_chunk().map(|&b| u32::from_le_bytes(b)),
        ComponentType::I8 | ComponentType::I16 | ComponentType::F32 => None,
    }
}

/// The number at the start of `bytes`, which hold one; not-a-number should they not.
///
/// Source: glTF 2.0 specification, §3.6.2.2 and §3.11 for normalized whole numbers.
fn number(component: ComponentType, normalized: bool, bytes: &[u8]) -> f32 {
    let (value, most) = match component {
        ComponentType::F32 => (bytes.first_chunk().map(|&b| f32::from_le_bytes(b)), 1.0),
        ComponentType::I8 => (bytes.first().map(|&b| f32::from(b.cast_signed())), 127.0),
        ComponentType::I16 => (
            bytes
                .first_chunk()
                .map(|&b| f32::from(i16::from_le_bytes(b))),
            32767.0,
        ),
        ComponentType::U8 => (bytes.first().map(|&b| f32::from(b)), 255.0),
        ComponentType::U16 => (
            bytes
                .first_chunk()
                .map(|&b| f32::from(u16::from_le_bytes(b))),
            65535.0,
        ),
        ComponentType::U32 => (
            bytes.first_chunk().map(|&b| u32::from_le_bytes(b) as f32),
            u32::MAX as f32,
        ),
    };
    let value = value.unwrap_or(f32::NAN);
    match normalized && component != ComponentType::F32 {
        true => (value / most).max(-1.0),
        false => value,
    }
}

//! PLY files to splat clouds.

use std::path::Path;

use super::{COLOUR, FRAME, MAX_FRAME, OPACITY, POSITION, ROTATION, SCALE, TIME, VELOCITY, header, is_extra};
use crate::{
    cloud::SplatCloud,
    error::{FormatError, Result},
    read::{MAX_DATA_BYTES, read_file},
};
use header::{Header, Property, Scalar};

/// The splat cloud of a PLY file: see [`crate::ply`] for the layout.
///
/// # Errors
/// A file that is missing, a header or a length that the layout does not allow, a property that is missing, a value
/// that is not finite (by the property and the index of the splat).
pub fn read_ply(path: &Path) -> Result<SplatCloud> {
    from_bytes(path, &read_file(path, MAX_DATA_BYTES)?)
}

/// The cloud that the bytes of a file describe; `path` is what errors name.
pub(super) fn from_bytes(path: &Path, bytes: &[u8]) -> Result<SplatCloud> {
    let header = header::parse(path, bytes)?;
    let records = &bytes[header.length..];
    check_length(path, &header, records)?;
    let table = Table { path, header: &header, records };
    let extra = header.properties.iter().filter(|property| is_extra(&property.name));
    Ok(SplatCloud {
        means: table.required(POSITION)?,
        log_scales: table.required(SCALE)?,
        quats: table.required(ROTATION)?,
        logit_opacities: table.required([OPACITY])?.into_iter().map(|[v]| v).collect(),
        sh_dc: table.required(COLOUR)?,
        velocities: table.or_zero(VELOCITY)?,
        times: table.or_zero([TIME])?.into_iter().map(|[v]| v).collect(),
        frames: table.frames()?,
        extra: extra
            .map(|p| Ok((p.name.clone(), table.columns([Some(p)])?.into_iter().map(|[v]| v).collect())))
            .collect::<Result<_>>()?,
    })
}

/// Fails unless the records that the header announces are there, and nothing else.
fn check_length(path: &Path, header: &Header, records: &[u8]) -> Result<()> {
    let Header { count, stride, .. } = *header;
    let expected = u128::from(count) * stride as u128;
    if expected == records.len() as u128 && (stride > 0 || count == 0) {
        return Ok(());
    }
    let expected = format!("{expected} bytes ({count} vertices of {stride} bytes)");
    Err(FormatError::invalid(path, "length of the data", expected, format!("{} bytes", records.len())))
}

/// Records of which the header says where the values are.
struct Table<'a> {
    path: &'a Path,
    header: &'a Header,
    records: &'a [u8],
}

impl Table<'_> {
    fn find(&self, name: &str) -> Option<&Property> {
        self.header.properties.iter().find(|property| property.name == name)
    }

    /// `[N, K]` values of properties that must be there.
    fn required<const K: usize>(&self, names: [&str; K]) -> Result<Vec<[f32; K]>> {
        if let Some(missing) = names.iter().find(|name| self.find(name).is_none()) {
            let all: Vec<&str> = self.header.properties.iter().take(100).map(|p| p.name.as_str()).collect();
            let expected = format!("a property `{missing}`");
            return Err(FormatError::invalid(self.path, "header", expected, format!("`{}`", all.join(" "))));
        }
        self.columns(names.map(|name| self.find(name)))
    }

    /// `[N, K]` values of properties, 0 for those that are not there.
    fn or_zero<const K: usize>(&self, names: [&str; K]) -> Result<Vec<[f32; K]>> {
        self.columns(names.map(|name| self.find(name)))
    }

    /// `[N]` frames; `None` without such a property.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole and in range, as was checked")]
    fn frames(&self) -> Result<Option<Vec<u32>>> {
        let Some(property) = self.find(FRAME) else { return Ok(None) };
        let frame = |(index, [value]): (usize, [f32; 1])| {
            if value.fract() == 0.0 && (0.0..=MAX_FRAME as f32).contains(&value) {
                return Ok(value as u32);
            }
            let (field, expected) =
                (format!("vertex {index} {FRAME}"), format!("a whole number from 0 to {MAX_FRAME}"));
            Err(FormatError::invalid(self.path, field, expected, value.to_string()))
        };
        self.columns([Some(property)])?.into_iter().enumerate().map(frame).collect::<Result<_>>().map(Some)
    }

    fn columns<const K: usize>(&self, properties: [Option<&Property>; K]) -> Result<Vec<[f32; K]>> {
        let stride = self.header.stride.max(1); // a header without properties has no records
        let mut rows = Vec::with_capacity(self.records.len() / stride);
        for (index, record) in self.records.chunks_exact(stride).enumerate() {
            let mut row = [0.0; K];
            for (value, property) in row.iter_mut().zip(properties.iter().copied()) {
                let Some(property) = property else { continue };
                *value = to_f32(property.scalar, &record[property.offset..]);
                if !value.is_finite() {
                    let field = format!("vertex {index} {}", property.name);
                    return Err(FormatError::invalid(self.path, field, "a finite f32", value.to_string()));
                }
            }
            rows.push(row);
        }
        Ok(rows)
    }
}

/// The first value of `bytes`, which hold one.
#[expect(clippy::cast_possible_truncation, reason = "a double becomes the nearest f32, infinity beyond its range")]
fn to_f32(scalar: Scalar, bytes: &[u8]) -> f32 {
    match scalar {
        Scalar::I8 => f32::from(i8::from_le_bytes(first(bytes))),
        Scalar::U8 => f32::from(u8::from_le_bytes(first(bytes))),
        Scalar::I16 => f32::from(i16::from_le_bytes(first(bytes))),
        Scalar::U16 => f32::from(u16::from_le_bytes(first(bytes))),
        Scalar::I32 => i32::from_le_bytes(first(bytes)) as f32,
        Scalar::U32 => u32::from_le_bytes(first(bytes)) as f32,
        Scalar::F32 => f32::from_le_bytes(first(bytes)),
        Scalar::F64 => f64::from_le_bytes(first(bytes)) as f32,
    }
}

fn first<const B: usize>(bytes: &[u8]) -> [u8; B] {
    std::array::from_fn(|k| bytes[k])
}

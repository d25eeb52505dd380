//! Accessors: checked once against their views, then read without a fault.
//!
//! Source: glTF 2.0, 3.6.2 (accessors, sparse accessors, data alignment) and 3.6.2.2 (layout of matrices);
//! KHR_mesh_quantization for what normalised integers mean.
//! In: JSON and buffer bytes. Out: elements as stored, without gaps, with sparse values in place.
//! Unaware of: meshes.

use serde_json::Value;

use super::refs::{index, list};
use crate::io::SceneError;

/// Elements that an accessor without a view may have: such an accessor is zeros, and costs its file nothing.
const MAX_IMPLIED: u64 = 1 << 24;

/// Type of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_code(code: u64) -> Option<Self> {
        Some(match code {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            5126 => Component::F32,
            _ => return None,
        })
    }

    /// The number that stands for it in JSON.
    pub(super) fn code(self) -> u32 {
        [5120, 5121, 5122, 5123, 5125, 5126][self as usize]
    }

    /// Bytes.
    pub(super) fn size(self) -> usize {
        [1, 1, 2, 2, 4, 4][self as usize]
    }

    /// The value of one component; integers as they are.
    pub(super) fn read(self, bytes: &[u8]) -> f64 {
        match self {
            Component::I8 => f64::from(bytes[0] as i8),
            Component::U8 => f64::from(bytes[0]),
            Component::I16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
            Component::U16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            Component::U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
            Component::F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        }
    }

    /// Appends a value: rounded and held within the range of an integer type.
    pub(super) fn write(self, value: f64, out: &mut Vec<u8>) {
        let v = value.round();
        match self {
            Component::I8 => out.extend((v as i8).to_le_bytes()),
            Component::U8 => out.extend((v as u8).to_le_bytes()),
            Component::I16 => out.extend((v as i16).to_le_bytes()),
            Component::U16 => out.extend((v as u16).to_le_bytes()),
            Component::U32 => out.extend((v as u32).to_le_bytes()),
            Component::F32 => out.extend((value as f32).to_le_bytes()),
        }
    }

    /// What a normalised integer is divided by; 1 for floats.
    pub(super) fn unit(self) -> f64 {
        [127.0, 255.0, 32767.0, 65535.0, 4_294_967_295.0, 1.0][self as usize]
    }
}

/// Type of an element: its name and its columns and rows.
const SHAPES: [(&str, usize, usize); 7] =
    [("SCALAR", 1, 1), ("VEC2", 1, 2), ("VEC3", 1, 3), ("VEC4", 1, 4), ("MAT2", 2, 2), ("MAT3", 3, 3), ("MAT4", 4, 4)];

/// How one element is laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Format {
    pub(super) component: Component,
    /// Name of the type as in JSON.
    pub(super) shape: &'static str,
    pub(super) normalized: bool,
    columns: usize,
    rows: usize,
}

impl Format {
    /// A format of a named type. Panics if there is no such type.
    pub(super) fn new(component: Component, shape: &str, normalized: bool) -> Self {
        let found = SHAPES.iter().find(|s| s.0 == shape);
        let (shape, columns, rows) = *found.expect("a type of the table");
        Format { component, shape, normalized, columns, rows }
    }

    /// Components per element.
    pub(super) fn width(self) -> usize {
        self.columns * self.rows
    }

    /// Whether the element is a matrix.
    pub(super) fn is_matrix(self) -> bool {
        self.columns > 1
    }

    /// Bytes per element; the columns of a matrix begin at multiples of four.
    pub(super) fn size(self) -> usize {
        let column = self.rows * self.component.size();
        if self.columns > 1 { column.next_multiple_of(4) * self.columns } else { column }
    }

    /// Component `c` of element `i` of packed bytes, normalised if the format says so. Not for matrices with gaps.
    pub(super) fn get(self, packed: &[u8], i: usize, c: usize) -> f64 {
        let v = self.component.read(&packed[i * self.size() + c * self.component.size()..]);
        if self.normalized { (v / self.component.unit()).max(-1.0) } else { v }
    }
}

/// A buffer view, within its buffer.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    pub(super) buffer: usize,
    pub(super) start: usize,
    pub(super) len: usize,
    pub(super) stride: Option<usize>,
}

/// Where elements are: the first at `start` of a buffer.
#[derive(Clone, Copy, Debug)]
struct Place {
    buffer: usize,
    start: usize,
    stride: usize,
}

/// An accessor whose bytes are all there.
#[derive(Clone, Debug)]
pub(super) struct Accessor {
    pub(super) format: Format,
    pub(super) count: usize,
    place: Option<Place>,
    /// Number, type and place of the indices, place of the values.
    sparse: Option<(usize, Component, Place, Place)>,
}

fn number(object: &Value, key: &str, path: &str, default: Option<u64>) -> Result<u64, SceneError> {
    match object.get(key).filter(|v| !v.is_null()) {
        None => default.ok_or_else(|| SceneError::at(path, format!("`{key}` is missing"))),
        Some(v) => v.as_u64().ok_or_else(|| SceneError::at(path, format!("`{key}` is {v}, expected an integer >= 0"))),
    }
}

/// Reads all views; `sizes` are the lengths of the buffers.
pub(super) fn views(root: &Value, sizes: &[usize]) -> Result<Vec<View>, SceneError> {
    let mut out = Vec::new();
    for (i, v) in list(root, "bufferViews").iter().enumerate() {
        let path = format!("bufferViews[{i}]");
        let buffer = index(v, "buffer").ok_or_else(|| SceneError::at(&path, "`buffer` is missing"))?;
        let (start, len) = (number(v, "byteOffset", &path, Some(0))?, number(v, "byteLength", &path, None)?);
        let have = sizes[buffer];
        if start.checked_add(len).is_none_or(|end| end > have as u64) {
            let what = format!("bytes {start} + {len} of buffer {buffer}, which has {have}");
            return Err(SceneError::at(path, what));
        }
        if len == 0 {
            return Err(SceneError::at(path, "`byteLength` is 0, expected at least 1"));
        }
        let stride = match number(v, "byteStride", &path, Some(0))? {
            0 if v.get("byteStride").is_none_or(Value::is_null) => None,
            s @ 4..=252 if s % 4 == 0 => Some(s as usize),
            s => return Err(SceneError::at(path, format!("`byteStride` is {s}, expected a multiple of 4 in 4..=252"))),
        };
        out.push(View { buffer, start: start as usize, len: len as usize, stride });
    }
    Ok(out)
}

/// Reads and checks all accessors.
pub(super) fn accessors(root: &Value, views: &[View], buffers: &[Vec<u8>]) -> Result<Vec<Accessor>, SceneError> {
    list(root, "accessors").iter().enumerate().map(|(i, a)| accessor(a, i, views, buffers)).collect()
}

/// The formats of all accessors.
pub(super) fn formats(root: &Value) -> Result<Vec<Format>, SceneError> {
    list(root, "accessors").iter().enumerate().map(|(i, a)| format(a, &format!("accessors[{i}]"))).collect()
}

fn format(json: &Value, path: &str) -> Result<Format, SceneError> {
    let code = number(json, "componentType", path, None)?;
    let component = Component::from_code(code).ok_or_else(|| {
        SceneError::at(path, format!("`componentType` is {code}, expected 5120 to 5123, 5125 or 5126"))
    })?;
    let name = json.get("type").and_then(Value::as_str).unwrap_or_default();
    let shape = SHAPES.iter().find(|s| s.0 == name).ok_or_else(|| {
        SceneError::at(path, format!("`type` is \"{name}\", expected SCALAR, VEC2 to VEC4 or MAT2 to MAT4"))
    })?;
    let normalized = json.get("normalized").and_then(Value::as_bool).unwrap_or(false);
    if normalized && matches!(component, Component::F32 | Component::U32) {
        return Err(SceneError::at(path, format!("`normalized` with `componentType` {code}; only for 5120 to 5123")));
    }
    Ok(Format::new(component, shape.0, normalized))
}

fn accessor(json: &Value, i: usize, views: &[View], buffers: &[Vec<u8>]) -> Result<Accessor, SceneError> {
    let path = format!("accessors[{i}]");
    let format = format(json, &path)?;
    let count = number(json, "count", &path, None)?;
    if count == 0 {
        return Err(SceneError::at(path, "`count` is 0, expected at least 1"));
    }
    let layout = Layout { size: format.size(), align: format.component.size(), count };
    let place = match index(json, "bufferView") {
        Some(v) => Some(layout.place(json, v, &path, views)?),
        None if count > MAX_IMPLIED => {
            return Err(SceneError::TooLarge(format!("{path}: {count} elements without data; at most {MAX_IMPLIED}")));
        }
        None => None,
    };
    let sparse = match json.get("sparse").filter(|s| !s.is_null()) {
        Some(s) => Some(sparse(s, &format!("{path}.sparse"), layout, views, buffers)?),
        None => None,
    };
    Ok(Accessor { format, count: count as usize, place, sparse })
}

/// Size and alignment of elements, and how many there are.
#[derive(Clone, Copy)]
struct Layout {
    size: usize,
    align: usize,
    count: u64,
}

impl Layout {
    /// Checks that all elements lie in the view.
    fn place(self, json: &Value, v: usize, path: &str, views: &[View]) -> Result<Place, SceneError> {
        let view = views[v];
        let offset = number(json, "byteOffset", path, Some(0))?;
        let stride = view.stride.unwrap_or(self.size);
        if stride < self.size {
            let what = format!("elements of {} bytes in view {v}, whose byteStride is {stride}", self.size);
            return Err(SceneError::at(path, what));
        }
        let end = (self.count - 1).checked_mul(stride as u64).and_then(|n| n.checked_add(offset));
        if end.and_then(|n| n.checked_add(self.size as u64)).is_none_or(|end| end > view.len as u64) {
            let what = format!(
                "{} elements of {} bytes from byte {offset} do not fit view {v} of {} bytes",
                self.count, self.size, view.len
            );
            return Err(SceneError::at(path, what));
        }
        let start = view.start + offset as usize;
        if !start.is_multiple_of(self.align) || !offset.is_multiple_of(self.align as u64) {
            let what = format!("begins at byte {start} of its buffer, no multiple of its components' {}", self.align);
            return Err(SceneError::at(path, what));
        }
        Ok(Place { buffer: view.buffer, start, stride })
    }
}

fn sparse(
    json: &Value,
    path: &str,
    values: Layout,
    views: &[View],
    buffers: &[Vec<u8>],
) -> Result<(usize, Component, Place, Place), SceneError> {
    let count = number(json, "count", path, None)?;
    if count == 0 || count > values.count {
        return Err(SceneError::at(path, format!("`count` is {count}, expected 1..={}", values.count)));
    }
    let part = |key: &str, layout: Layout| {
        let path = format!("{path}.{key}");
        let object = json.get(key).unwrap_or(&Value::Null);
        let view = index(object, "bufferView").ok_or_else(|| SceneError::at(&path, "`bufferView` is missing"))?;
        layout.place(object, view, &path, views)
    };
    let indices_path = format!("{path}.indices");
    let code = json.get("indices").map_or(Ok(0), |o| number(o, "componentType", &indices_path, None))?;
    let kind = Component::from_code(code)
        .filter(|c| matches!(c, Component::U8 | Component::U16 | Component::U32))
        .ok_or_else(|| {
            SceneError::at(&indices_path, format!("`componentType` is {code}, expected 5121, 5123 or 5125"))
        })?;
    let at = part("indices", Layout { size: kind.size(), align: kind.size(), count })?;
    let values_at = part("values", Layout { count, ..values })?;
    let mut least = 0;
    for k in 0..count as usize {
        let v = kind.read(&buffers[at.buffer][at.start + k * at.stride..]) as u64;
        if v < least || v >= values.count {
            let what = format!("entry {k} is {v}; entries must ascend and be below {}", values.count);
            return Err(SceneError::at(indices_path, what));
        }
        least = v + 1;
    }
    Ok((count as usize, kind, at, values_at))
}

impl Accessor {
    /// Whether it has data of its own: without any it is all zeros.
    pub(super) fn has_data(&self) -> bool {
        self.place.is_some() || self.sparse.is_some()
    }

    /// All elements, packed.
    pub(super) fn packed(&self, buffers: &[Vec<u8>]) -> Vec<u8> {
        let size = self.format.size();
        let copy = |place: Place, k: usize, to: &mut [u8]| {
            let at = place.start + k * place.stride;
            to.copy_from_slice(&buffers[place.buffer][at..at + size]);
        };
        let mut out = vec![0; self.count * size];
        if let Some(place) = self.place {
            out.chunks_exact_mut(size).enumerate().for_each(|(k, to)| copy(place, k, to));
        }
        if let Some((count, kind, at, values)) = self.sparse {
            for k in 0..count {
                let i = kind.read(&buffers[at.buffer][at.start + k * at.stride..]) as usize;
                copy(values, k, &mut out[i * size..(i + 1) * size]);
            }
        }
        out
    }

    /// All elements as integers; for indices.
    pub(super) fn indices(&self, buffers: &[Vec<u8>]) -> Vec<u32> {
        let packed = self.packed(buffers);
        packed.chunks_exact(self.format.size()).map(|b| self.format.component.read(b) as u32).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(accessor: Value, view: Value, bytes: &[u8]) -> Result<Vec<u8>, SceneError> {
        let root = json!({"bufferViews": [view], "accessors": [accessor]});
        let buffers = [bytes.to_vec()];
        let views = views(&root, &[bytes.len()])?;
        Ok(accessors(&root, &views, &buffers)?[0].packed(&buffers))
    }

    #[test]
    fn strides_sparse_and_normalised_values() {
        let bytes: Vec<u8> = (0..12).collect();
        let a = json!({"bufferView": 0, "byteOffset": 1, "componentType": 5121, "type": "VEC2", "count": 3});
        let v = json!({"buffer": 0, "byteLength": 12, "byteStride": 4});
        assert_eq!(read(a, v.clone(), &bytes).unwrap(), [1, 2, 5, 6, 9, 10]);
        let sparse = json!({"componentType": 5121, "type": "SCALAR", "count": 4, "sparse": {
            "count": 2, "indices": {"bufferView": 0, "byteOffset": 1, "componentType": 5121},
            "values": {"bufferView": 0, "byteOffset": 10}}});
        assert_eq!(read(sparse, json!({"buffer": 0, "byteLength": 12}), &bytes).unwrap(), [0, 10, 11, 0]);
        let format = Format::new(Component::I8, "VEC2", true);
        assert_eq!([format.get(&[0x80, 127], 0, 0), format.get(&[0x80, 127], 0, 1)], [-1.0, 1.0]);
        assert_eq!(Format::new(Component::U8, "MAT3", false).size(), 12);
        assert_eq!(Format::new(Component::U16, "MAT2", false).size(), 8);
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let bytes = [0u8; 16];
        let view = json!({"buffer": 0, "byteLength": 16});
        let fault = |a: Value, v: &Value| read(a, v.clone(), &bytes).unwrap_err().to_string();
        let scalar = |count: u64, offset: u64| json!({"bufferView": 0, "byteOffset": offset, "componentType": 5126, "type": "SCALAR", "count": count});
        assert!(read(scalar(4, 0), view.clone(), &bytes).is_ok());
        assert!(fault(scalar(5, 0), &view).contains("do not fit view 0 of 16 bytes"));
        assert!(fault(scalar(u64::MAX, 0), &view).contains("do not fit"));
        assert!(fault(scalar(2, u64::MAX), &view).contains("do not fit"));
        assert!(fault(scalar(1, 2), &view).contains("no multiple"));
        assert!(fault(scalar(0, 0), &view).contains("`count` is 0"));
        let zeros = json!({"componentType": 5126, "type": "VEC4", "count": 4294967295u64});
        assert!(fault(zeros, &view).contains("without data"));
        assert!(fault(scalar(1, 0), &json!({"buffer": 0, "byteLength": 17})).contains("which has 16"));
        assert!(fault(scalar(1, 0), &json!({"buffer": 0, "byteLength": 16, "byteStride": 2})).contains("byteStride"));
    }
}

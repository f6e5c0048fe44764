//! Datasets of one dimension.

use super::super::super::number::{ByteOrder, NumberType};
use super::Fault;
use super::chunks::{Chunks, Filter};
use super::reader::Reader;

const DATASPACE: u16 = 0x01;
const DATATYPE: u16 = 0x03;
const LAYOUT: u16 = 0x08;
const FILTERS: u16 = 0x0b;
/// Most values: an affine transform has twelve, a deformation millions.
const MAX_VALUES: u64 = 4096;
const CUT: Fault = "a dataset is cut off";
const TOO_LONG: Fault = "a dataset has more values than a rigid transform: is it a deformation? Save a rigid transform";

/// Type of a dataset's values.
#[derive(Debug, Clone, Copy)]
enum Type {
    Float(NumberType, ByteOrder),
    /// Text of this many bytes.
    Text,
    /// Text in the global heap.
    TextInHeap,
}

impl Reader<'_> {
    /// The floating-point numbers of a dataset.
    pub(super) fn numbers(&mut self, address: u64) -> Result<Vec<f64>, Fault> {
        match self.dataset(address)? {
            (Type::Float(number_type, order), bytes) => Ok(number_type.all(&bytes, order)),
            _ => Err("the parameters of a transform are no floating-point numbers"),
        }
    }

    /// The first text of a dataset.
    pub(super) fn text(&mut self, address: u64) -> Result<String, Fault> {
        let text = match self.dataset(address)? {
            (Type::Text, bytes) => bytes,
            (Type::TextInHeap, bytes) => self.in_heap(&bytes).ok_or(CUT)?,
            _ => return Err("the type of a transform is no text"),
        };
        let text = text.split(|b| *b == 0).next().unwrap_or_default();
        Ok(String::from_utf8_lossy(text).trim().to_owned())
    }

    fn dataset(&mut self, address: u64) -> Result<(Type, Vec<u8>), Fault> {
        let messages = self.messages(address)?;
        let of = |kind: u16| messages.iter().find(|(k, _)| *k == kind).map(|(_, content)| *content);
        let count = self.count(of(DATASPACE).ok_or(CUT)?).ok_or(CUT)?;
        let (value, size) = datatype(self, of(DATATYPE).ok_or(CUT)?)?;
        let length = count.checked_mul(size).filter(|_| count <= MAX_VALUES && size <= MAX_VALUES).ok_or(TOO_LONG)?;
        let filters = of(FILTERS).map_or(Some(Vec::new()), |content| self.filters(content)).ok_or(CUT)?;
        let bytes = self.data(of(LAYOUT).ok_or(CUT)?, length, size, &filters)?;
        Ok((value, bytes))
    }

    /// Number of values.
    fn count(&self, content: &[u8]) -> Option<u64> {
        let mut fields = self.fields(content);
        let (version, rank, _) = (fields.u8()?, fields.u8()?, fields.u8()?);
        fields.take(if version == 1 { 5 } else { 1 })?;
        (0..rank).try_fold(1u64, |count, _| count.checked_mul(fields.length()?))
    }

    /// The bytes of all values, by the kind of storage.
    fn data(&mut self, layout: &[u8], length: u64, value_size: u64, filters: &[Filter]) -> Result<Vec<u8>, Fault> {
        const OTHER: Fault = "the storage of a dataset is not supported; save the transform as .tfm";
        let mut fields = self.fields(layout);
        let (version, class) = fields.u8().zip(fields.u8()).ok_or(CUT)?;
        let whole = usize::try_from(length).map_err(|_| TOO_LONG)?;
        if whole == 0 {
            return Ok(Vec::new());
        }
        match (version, class) {
            (3 | 4, 0) => {
                fields.take(2).ok_or(CUT)?;
                Ok(fields.take(whole).ok_or(CUT)?.to_vec())
            }
            (3 | 4, 1) => {
                let at = fields.offset().ok_or(CUT)?;
                Ok(self.slice(at, length).ok_or(CUT)?.to_vec())
            }
            (3, 2) => {
                let rank = fields.u8().ok_or(CUT)?;
                let tree = fields.offset().ok_or(CUT)?;
                // One dimension, and that of the bytes of a value.
                if rank != 2 {
                    return Err(OTHER);
                }
                let elements = fields.u32().ok_or(CUT)?;
                let chunk =
                    u64::from(elements).checked_mul(value_size).filter(|n| *n <= MAX_VALUES * 16).ok_or(TOO_LONG)?;
                let chunks = Chunks { length: usize::try_from(chunk).map_err(|_| TOO_LONG)?, value_size, filters };
                chunks.read(self, tree, whole).ok_or("a chunk of a dataset is broken")
            }
            _ => Err(OTHER),
        }
    }

    fn filters(&self, content: &[u8]) -> Option<Vec<Filter>> {
        let mut fields = self.fields(content);
        let (version, count) = (fields.u8()?, fields.u8()?);
        fields.take(if version == 1 { 6 } else { 0 })?;
        let mut filters = Vec::new();
        for _ in 0..count {
            let id = fields.u16()?;
            let name = if version == 1 || id >= 256 { usize::from(fields.u16()?) } else { 0 };
            let (_, values) = (fields.u16()?, fields.u16()?);
            fields.take(if version == 1 { name.checked_next_multiple_of(8)? } else { name })?;
            let padding = usize::from(version == 1 && values % 2 == 1);
            fields.take(usize::from(values).checked_add(padding)?.checked_mul(4)?)?;
            filters.push(Filter(id));
        }
        Some(filters)
    }

    /// The text at a place in the global heap: length, address of the collection, number of the object.
    fn in_heap(&mut self, place: &[u8]) -> Option<Vec<u8>> {
        let mut fields = self.fields(place);
        let (length, collection, index) = (fields.u32()?, fields.offset()?, fields.u32()?);
        let mut heap = self.block(collection)?;
        heap.magic(b"GCOL")?;
        heap.take(4)?;
        let size = usize::try_from(heap.length()?).ok()?;
        let mut heap = self.fields(heap.bytes.get(..size.min(heap.bytes.len()))?);
        loop {
            let (number, _, _) = (heap.u16()?, heap.u16()?, heap.u32()?);
            let stored = usize::try_from(heap.length()?).ok()?;
            let object = heap.take(stored)?;
            if u32::from(number) == index {
                return Some(object.get(..usize::try_from(length).ok()?)?.to_vec());
            }
            heap.take(stored.checked_next_multiple_of(8)?.checked_sub(stored)?)?;
        }
    }
}

/// Type and size of a value.
fn datatype(file: &Reader<'_>, content: &[u8]) -> Result<(Type, u64), Fault> {
    let mut fields = file.fields(content);
    let (class, bits, size) = (fields.u8(), fields.take(3).and_then(|b| b.first().copied()), fields.u32());
    let (class, (bits, size)) = class.zip(bits.zip(size)).ok_or(CUT)?;
    let order = if bits & 1 == 0 { ByteOrder::Little } else { ByteOrder::Big };
    let value = match (class & 15, size) {
        (1, 4) => Type::Float(NumberType::F32, order),
        (1, 8) => Type::Float(NumberType::F64, order),
        (3, _) => Type::Text,
        (9, _) if bits & 15 == 1 => Type::TextInHeap,
        _ => return Err("a dataset has values of an unsupported type"),
    };
    Ok((value, u64::from(size)))
}

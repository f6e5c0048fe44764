//! Numbers in binary files.

/// Order of the bytes of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ByteOrder {
    Little,
    Big,
}

impl ByteOrder {
    pub(super) fn u16(self, bytes: [u8; 2]) -> u16 {
        match self {
            Self::Little => u16::from_le_bytes(bytes),
            Self::Big => u16::from_be_bytes(bytes),
        }
    }

    pub(super) fn u32(self, bytes: [u8; 4]) -> u32 {
        match self {
            Self::Little => u32::from_le_bytes(bytes),
            Self::Big => u32::from_be_bytes(bytes),
        }
    }

    pub(super) fn u64(self, bytes: [u8; 8]) -> u64 {
        match self {
            Self::Little => u64::from_le_bytes(bytes),
            Self::Big => u64::from_be_bytes(bytes),
        }
    }
}

/// Type and byte order of the stored numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NumberFormat {
    pub(super) number_type: NumberType,
    pub(super) byte_order: ByteOrder,
}

/// Type of a stored number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NumberType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl NumberType {
    /// Bytes of one number.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// The first number in `bytes` and the remaining bytes; `None` when there are too few bytes.
    pub(super) fn first(self, bytes: &[u8], order: ByteOrder) -> Option<(f64, &[u8])> {
        let (head, rest) = bytes.split_at_checked(self.size())?;
        let mut number = None;
        self.each(head, order, &mut |found| number = Some(found));
        Some((number?, rest))
    }

    /// All complete numbers in `bytes`; an incomplete one at the end is ignored. Integers beyond 2^53 are rounded.
    pub(super) fn all(self, bytes: &[u8], order: ByteOrder) -> Vec<f64> {
        let mut numbers = Vec::with_capacity(bytes.len().checked_div(self.size()).unwrap_or(0));
        self.each(bytes, order, &mut |found| numbers.push(found));
        numbers
    }

    /// Passes each complete number in `bytes` to `take`, in order.
    pub(super) fn each(self, bytes: &[u8], order: ByteOrder, take: &mut dyn FnMut(f64)) {
        macro_rules! read {
            ($type:ty) => {
                for b in bytes.as_chunks::<{ size_of::<$type>() }>().0 {
                    take(match order {
                        ByteOrder::Little => <$type>::from_le_bytes(*b),
                        ByteOrder::Big => <$type>::from_be_bytes(*b),
                    } as f64)
                }
            };
        }
        match self {
            Self::I8 => read!(i8),
            Self::U8 => read!(u8),
            Self::I16 => read!(i16),
            Self::U16 => read!(u16),
            Self::I32 => read!(i32),
            Self::U32 => read!(u32),
            Self::I64 => read!(i64),
            Self::U64 => read!(u64),
            Self::F32 => read!(f32),
            Self::F64 => read!(f64),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back_in_both_orders() {
        let bytes = [&(-2i16).to_be_bytes()[..], &300i16.to_be_bytes(), &[7]].concat();
        assert_eq!(NumberType::I16.all(&bytes, ByteOrder::Big), [-2.0, 300.0]);
        assert_eq!(NumberType::F64.all(&1.5f64.to_le_bytes(), ByteOrder::Little), [1.5]);
        assert_eq!(NumberType::U8.first(&[5, 6], ByteOrder::Little), Some((5.0, &[6u8][..])));
        assert_eq!(NumberType::U32.first(&[1, 2, 3], ByteOrder::Little), None);
    }
}

//! Fields of the file, every read checked.

/// Most blocks that are looked at: addresses that lead in a circle end here.
pub(super) const MAX_BLOCKS: usize = 2000;

/// The bytes of a file with the sizes of its addresses.
#[derive(Debug)]
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    offset_size: usize,
    length_size: usize,
    blocks_left: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8], offset_size: usize, length_size: usize) -> Self {
        Self { bytes, offset_size, length_size, blocks_left: MAX_BLOCKS }
    }

    pub(super) fn offset_size(&self) -> usize {
        self.offset_size
    }

    /// The bytes from `address` on; counts as a block.
    pub(super) fn block(&mut self, address: u64) -> Option<Fields<'a>> {
        self.blocks_left = self.blocks_left.checked_sub(1)?;
        let bytes = self.bytes.get(usize::try_from(address).ok()?..)?;
        Some(Fields { bytes, offset_size: self.offset_size, length_size: self.length_size })
    }

    /// `length` bytes at `address`; they count as a block.
    pub(super) fn slice(&mut self, address: u64, length: u64) -> Option<&'a [u8]> {
        self.block(address)?.take(usize::try_from(length).ok()?)
    }

    /// Fields of bytes of this file.
    pub(super) fn fields<'b>(&self, bytes: &'b [u8]) -> Fields<'b> {
        Fields { bytes, offset_size: self.offset_size, length_size: self.length_size }
    }

    /// The address at position `at`, which moves behind it.
    pub(super) fn offset_at(&self, at: &mut usize) -> Option<u64> {
        let mut fields = self.fields(self.bytes.get(*at..)?);
        *at = at.checked_add(self.offset_size)?;
        fields.offset()
    }
}

/// Fields one after the other, little endian.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fields<'a> {
    pub(super) bytes: &'a [u8],
    offset_size: usize,
    length_size: usize,
}

impl<'a> Fields<'a> {
    pub(super) fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.bytes.split_at_checked(length)?;
        self.bytes = rest;
        Some(head)
    }

    /// Whether these bytes follow; skips them.
    pub(super) fn magic(&mut self, expected: &[u8]) -> Option<()> {
        (self.take(expected.len())? == expected).then_some(())
    }

    /// An integer of up to eight bytes.
    pub(super) fn uint(&mut self, size: usize) -> Option<u64> {
        let mut wide = [0; 8];
        wide.get_mut(..size)?.copy_from_slice(self.take(size)?);
        Some(u64::from_le_bytes(wide))
    }

    pub(super) fn u8(&mut self) -> Option<u8> {
        self.take(1)?.first().copied()
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.take(2)?.first_chunk().map(|b| u16::from_le_bytes(*b))
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.take(4)?.first_chunk().map(|b| u32::from_le_bytes(*b))
    }

    pub(super) fn offset(&mut self) -> Option<u64> {
        self.uint(self.offset_size)
    }

    pub(super) fn length(&mut self) -> Option<u64> {
        self.uint(self.length_size)
    }
}

//! Members of groups.

use super::Fault;
use super::reader::{MAX_BLOCKS, Reader};

const LINK_INFO: u16 = 0x02;
const LINK: u16 = 0x06;
const SYMBOL_TABLE: u16 = 0x11;
/// Most members of a group.
const MAX_MEMBERS: usize = 1000;
const CUT: Fault = "a group is cut off";

impl Reader<'_> {
    /// Names of a group's members and the addresses of their headers.
    pub(super) fn children(&mut self, address: u64) -> Result<Vec<(String, u64)>, Fault> {
        let mut found = Vec::new();
        let mut is_dense = false;
        for (kind, content) in self.messages(address)? {
            match kind {
                LINK => found.extend(self.link(content).ok_or(CUT)?),
                LINK_INFO => is_dense |= self.has_heap(content).ok_or(CUT)?,
                SYMBOL_TABLE => {
                    let mut fields = self.fields(content);
                    let (tree, heap) = fields.offset().zip(fields.offset()).ok_or(CUT)?;
                    self.table(tree, heap, &mut found).ok_or(CUT)?;
                }
                _ => {}
            }
        }
        if is_dense && found.is_empty() {
            return Err("a group stores its members in a heap, as for more than eight transforms; save one transform");
        }
        Ok(found)
    }

    /// A hard link; others have no address.
    fn link(&self, content: &[u8]) -> Option<Option<(String, u64)>> {
        let mut fields = self.fields(content);
        let (_, flags) = (fields.u8()?, fields.u8()?);
        let kind = if flags & 8 == 0 { 0 } else { fields.u8()? };
        fields.take(if flags & 4 == 0 { 0 } else { 8 })?;
        fields.take(usize::from(flags & 16 != 0))?;
        let length = fields.uint(1usize.checked_shl(u32::from(flags & 3))?)?;
        let name = String::from_utf8_lossy(fields.take(usize::try_from(length).ok()?)?).into_owned();
        if kind != 0 {
            return Some(None);
        }
        Some(Some((name, fields.offset()?)))
    }

    /// Whether the links lie in a heap.
    fn has_heap(&self, content: &[u8]) -> Option<bool> {
        let mut fields = self.fields(content);
        let (_, flags) = (fields.u8()?, fields.u8()?);
        fields.take(if flags & 1 == 0 { 0 } else { 8 })?;
        let size = self.offset_size();
        Some(!fields.take(size)?.iter().all(|b| *b == 0xff))
    }

    /// Members of a group of the old kind: a tree of tables, with the names in a heap.
    fn table(&mut self, tree: u64, heap: u64, found: &mut Vec<(String, u64)>) -> Option<()> {
        let mut fields = self.block(heap)?;
        fields.magic(b"HEAP")?;
        fields.take(4)?;
        let (size, _, data) = (fields.length()?, fields.length()?, fields.offset()?);
        let names = self.slice(data, size)?;
        let mut waiting = vec![tree];
        while let Some(address) = waiting.pop() {
            let mut node = self.block(address)?;
            if node.bytes.starts_with(b"TREE") {
                node.take(6)?;
                let entries = node.u16()?;
                let _ = (node.offset()?, node.offset()?);
                for _ in 0..entries {
                    node.length()?;
                    waiting.push(node.offset()?);
                    (waiting.len() <= MAX_BLOCKS).then_some(())?;
                }
                continue;
            }
            node.magic(b"SNOD")?;
            node.take(2)?;
            for _ in 0..node.u16()? {
                let (name, header) = (node.offset()?, node.offset()?);
                node.take(24)?;
                let name = names.get(usize::try_from(name).ok()?..)?;
                let name = name.split(|b| *b == 0).next()?;
                found.push((String::from_utf8_lossy(name).into_owned(), header));
                (found.len() <= MAX_MEMBERS).then_some(())?;
            }
        }
        Some(())
    }
}

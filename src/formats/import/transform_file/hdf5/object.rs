//! Object headers: lists of messages.

use super::Fault;
use super::reader::{Fields, Reader};

/// Most messages of a header.
const MAX_MESSAGES: usize = 1000;
const CONTINUATION: u16 = 0x10;
const CUT: Fault = "an object header is cut off";

/// A message: its type and its content.
pub(super) type Message<'a> = (u16, &'a [u8]);

/// Layout of the messages of a header.
#[derive(Debug, Clone, Copy)]
enum Layout {
    One,
    /// Whether the messages have a number in order of creation.
    Two(bool),
}

impl<'a> Reader<'a> {
    /// Messages of the object whose header is at `address`, with those of its continuations.
    pub(super) fn messages(&mut self, address: u64) -> Result<Vec<Message<'a>>, Fault> {
        let (first, layout) = self.header(address).ok_or(CUT)?;
        let (mut found, mut waiting) = (Vec::new(), vec![first]);
        while let Some(block) = waiting.pop() {
            let from = found.len();
            push_messages(self.fields(block), layout, &mut found);
            if found.len() > MAX_MESSAGES {
                return Err("an object has too many messages");
            }
            for (kind, content) in found.get(from..).unwrap_or_default() {
                if *kind == CONTINUATION {
                    let mut fields = self.fields(content);
                    let (at, length) = fields.offset().zip(fields.length()).ok_or(CUT)?;
                    let block = self.slice(at, length).ok_or(CUT)?;
                    waiting.push(match layout {
                        Layout::One => block,
                        Layout::Two(_) => block.strip_prefix(b"OCHK").and_then(without_checksum).ok_or(CUT)?,
                    });
                }
            }
        }
        Ok(found)
    }

    /// The first block of messages of a header.
    fn header(&mut self, address: u64) -> Option<(&'a [u8], Layout)> {
        let mut fields = self.block(address)?;
        if fields.bytes.starts_with(b"OHDR") {
            fields.take(5)?;
            let flags = fields.u8()?;
            fields.take(if flags & 0x20 == 0 { 0 } else { 16 })?;
            fields.take(if flags & 0x10 == 0 { 0 } else { 4 })?;
            let length = fields.uint(1usize.checked_shl(u32::from(flags & 3))?)?;
            return Some((fields.take(usize::try_from(length).ok()?)?, Layout::Two(flags & 4 != 0)));
        }
        let (version, _, _, _) = (fields.u8()?, fields.u8()?, fields.u16()?, fields.u32()?);
        let length = fields.u32()?;
        fields.take(4)?;
        (version == 1).then_some(())?;
        Some((fields.take(usize::try_from(length).ok()?)?, Layout::One))
    }
}

fn without_checksum(block: &[u8]) -> Option<&[u8]> {
    block.get(..block.len().checked_sub(4)?)
}

/// Adds the messages of a block; what is too short for one more is a gap.
fn push_messages<'a>(mut fields: Fields<'a>, layout: Layout, found: &mut Vec<Message<'a>>) {
    let mut one = || -> Option<Message<'a>> {
        let (kind, length) = match layout {
            Layout::One => (fields.u16()?, fields.u16()?),
            Layout::Two(_) => (u16::from(fields.u8()?), fields.u16()?),
        };
        fields.take(match layout {
            Layout::One => 4,
            Layout::Two(false) => 1,
            Layout::Two(true) => 3,
        })?;
        Some((kind, fields.take(usize::from(length))?))
    };
    while found.len() <= MAX_MESSAGES {
        let Some(message) = one() else { break };
        found.push(message);
    }
}

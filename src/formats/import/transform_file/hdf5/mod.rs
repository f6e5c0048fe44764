//! The part of HDF5 that ITK's transforms need.
//!
//! Read are superblocks 0 to 3; object headers 1 and 2; groups by symbol table and by link messages; datasets of one dimension
//! (floats of four and eight bytes, strings), compact, contiguous or in chunks, plain, deflated, shuffled. Anything else is
//! refused by name. The crates for HDF5 either wrap the C library or bring caches, memory maps and threads for terabytes; a
//! transform has 8 kB.
//!
//! # Source
//! The HDF Group, HDF5 File Format Specification, version 3.0.

mod chunks;
mod dataset;
mod group;
mod object;
mod reader;

use super::super::ImportError;
use super::super::error::malformed;
use super::ItkTransform;
use reader::Reader;

const FORMAT: &str = "ITK HDF5";
const MAGIC: &[u8] = b"\x89HDF\r\n\x1a\n";
/// Most transforms of a composite.
const MAX_TRANSFORMS: usize = 64;

/// Why a file cannot be read.
type Fault = &'static str;

pub(super) fn looks_like(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Reads `/TransformGroup/0`, `1` and so on: `TransformType`, `TransformParameters`, `TransformFixedParameters`.
pub(super) fn read(bytes: &[u8]) -> Result<Vec<ItkTransform>, ImportError> {
    transforms(bytes).map_err(|fault| malformed(FORMAT, fault))
}

fn transforms(bytes: &[u8]) -> Result<Vec<ItkTransform>, Fault> {
    let (mut file, root) = open(bytes)?;
    let root = file.children(root)?;
    let group = address_of(&root, "TransformGroup").ok_or("it has no group `TransformGroup`: ITK did not write it")?;
    let members = file.children(group)?;
    let mut found = Vec::new();
    for index in 0..MAX_TRANSFORMS {
        let Some(one) = address_of(&members, &index.to_string()) else { break };
        let parts = file.children(one)?;
        // Early versions of ITK misspelt the names.
        let part = |names: [&str; 2]| names.iter().find_map(|name| address_of(&parts, name));
        let kind = file.text(address_of(&parts, "TransformType").ok_or("a transform has no type")?)?;
        let mut numbers = |at: Option<u64>| at.map_or(Ok(Vec::new()), |at| file.numbers(at));
        found.push(ItkTransform {
            kind,
            parameters: numbers(part(["TransformParameters", "TranformParameters"]))?,
            fixed: numbers(part(["TransformFixedParameters", "TranformFixedParameters"]))?,
        });
    }
    Ok(found)
}

fn address_of(members: &[(String, u64)], name: &str) -> Option<u64> {
    members.iter().find(|(found, _)| found == name).map(|(_, address)| *address)
}

/// Reads the superblock; returns the address of the root group's header.
fn open(bytes: &[u8]) -> Result<(Reader<'_>, u64), Fault> {
    const CUT: Fault = "its superblock is cut off";
    let version = *bytes.get(8).ok_or(CUT)?;
    let sizes = match version {
        0 | 1 => bytes.get(13..15),
        2 | 3 => bytes.get(9..11),
        _ => return Err("its superblock has an unknown version"),
    };
    let [offset, length] = *sizes.and_then(<[u8]>::first_chunk::<2>).ok_or(CUT)?;
    if ![offset, length].iter().all(|size| [4, 8].contains(size)) {
        return Err("its addresses have neither four nor eight bytes");
    }
    let file = Reader::new(bytes, usize::from(offset), usize::from(length));
    let mut at = match version {
        0 => 24,
        1 => 28,
        _ => 12,
    };
    let base = file.offset_at(&mut at).ok_or(CUT)?;
    if base != 0 {
        return Err("its data begin with a foreign block");
    }
    // Free space or extension, and the end of the file; the root group's entry begins with the offset of its name.
    let skipped = if version < 2 { 4 } else { 2 };
    for _ in 0..skipped {
        file.offset_at(&mut at).ok_or(CUT)?;
    }
    let root = file.offset_at(&mut at).ok_or(CUT)?;
    Ok((file, root))
}

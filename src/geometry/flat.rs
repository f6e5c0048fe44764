//! Values as bytes, bit for bit, for results that are kept beyond a process.
//!
//! The layout follows the types without names or versions: only the program that wrote the bytes may read them.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

use super::{Aabb, Point, ScalarGrid, Severity, TriMesh, Vector, Warning};

/// A value that can be written as bytes, little-endian, and read again.
pub trait Flat: Sized {
    /// Appends the value.
    fn write(&self, to: &mut Vec<u8>);

    /// Takes a value from the front of `from`; `None` when there is none.
    fn read(from: &mut &[u8]) -> Option<Self>;
}

/// Implements [`Flat`] for a struct by its fields, in the order given.
#[macro_export]
macro_rules! flat {
    ($type:ty { $($field:ident),+ $(,)? }) => {
        impl $crate::Flat for $type {
            fn write(&self, to: &mut Vec<u8>) {
                $($crate::Flat::write(&self.$field, to);)+
            }

            fn read(from: &mut &[u8]) -> Option<Self> {
                Some(Self { $($field: $crate::Flat::read(from)?),+ })
            }
        }
    };
}

/// Implements [`Flat`] for an enum of names alone.
#[macro_export]
macro_rules! flat_names {
    ($type:ty { $($variant:ident),+ $(,)? }) => {
        impl $crate::Flat for $type {
            fn write(&self, to: &mut Vec<u8>) {
                $crate::Flat::write(&(*self as u8), to);
            }

            fn read(from: &mut &[u8]) -> Option<Self> {
                let code: u8 = $crate::Flat::read(from)?;
                [$(Self::$variant),+].into_iter().find(|variant| *variant as u8 == code)
            }
        }
    };
}

macro_rules! flat_numbers {
    ($($type:ty),+) => {$(
        impl Flat for $type {
            fn write(&self, to: &mut Vec<u8>) {
                to.extend_from_slice(&self.to_le_bytes());
            }

            fn read(from: &mut &[u8]) -> Option<Self> {
                from.split_off(..size_of::<Self>())?.try_into().ok().map(Self::from_le_bytes)
            }
        }
    )+};
}

flat_numbers!(u8, i16, u32, u64, f32, f64);
flat!(Aabb { min, max });
flat!(ScalarGrid { dims, origin, spacing, values });
flat!(Warning { code, severity, message, action });
flat_names!(Severity { Info, Check, Unreliable });

impl Flat for usize {
    fn write(&self, to: &mut Vec<u8>) {
        (*self as u64).write(to);
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        u64::read(from)?.try_into().ok()
    }
}

impl Flat for bool {
    fn write(&self, to: &mut Vec<u8>) {
        u8::from(*self).write(to);
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        match u8::read(from)? {
            0 => Some(false),
            1 => Some(true),
            2.. => None,
        }
    }
}

impl Flat for String {
    fn write(&self, to: &mut Vec<u8>) {
        self.len().write(to);
        to.extend_from_slice(self.as_bytes());
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        let length = usize::read(from)?;
        String::from_utf8(from.split_off(..length)?.to_vec()).ok()
    }
}

impl Flat for &'static str {
    fn write(&self, to: &mut Vec<u8>) {
        (*self).to_owned().write(to);
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        String::read(from).map(interned)
    }
}

/// The text for the rest of the process. The codes and actions of warnings are few, and each takes its memory once.
fn interned(text: String) -> &'static str {
    static KNOWN: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(found) = known.get(text.as_str()) {
        return found;
    }
    let kept: &'static str = text.leak();
    known.insert(kept);
    kept
}

impl<T: Flat> Flat for Vec<T> {
    fn write(&self, to: &mut Vec<u8>) {
        self.len().write(to);
        self.iter().for_each(|value| value.write(to));
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        let length = usize::read(from)?;
        // Every value has a byte, so that a wrong length reserves no more memory than the bytes take.
        if length > from.len() {
            return None;
        }
        (0..length).map(|_| T::read(from)).collect()
    }
}

impl<T: Flat> Flat for Option<T> {
    fn write(&self, to: &mut Vec<u8>) {
        self.is_some().write(to);
        self.iter().for_each(|value| value.write(to));
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        if bool::read(from)? { T::read(from).map(Some) } else { Some(None) }
    }
}

impl<T: Flat, const N: usize> Flat for [T; N] {
    fn write(&self, to: &mut Vec<u8>) {
        self.iter().for_each(|value| value.write(to));
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        let values: Option<Vec<T>> = (0..N).map(|_| T::read(from)).collect();
        values?.try_into().ok()
    }
}

impl<T: Flat> Flat for Arc<T> {
    fn write(&self, to: &mut Vec<u8>) {
        T::write(self, to);
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        T::read(from).map(Arc::new)
    }
}

impl<A: Flat, B: Flat> Flat for (A, B) {
    fn write(&self, to: &mut Vec<u8>) {
        self.0.write(to);
        self.1.write(to);
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        Some((A::read(from)?, B::read(from)?))
    }
}

impl Flat for Vector {
    fn write(&self, to: &mut Vec<u8>) {
        [self.x, self.y, self.z].write(to);
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        <[f64; 3]>::read(from).map(Self::from)
    }
}

impl Flat for Point {
    fn write(&self, to: &mut Vec<u8>) {
        self.coords.write(to);
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        Vector::read(from).map(Self::from)
    }
}

impl Flat for TriMesh {
    fn write(&self, to: &mut Vec<u8>) {
        self.positions().to_vec().write(to);
        self.triangles().to_vec().write(to);
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        TriMesh::new(Flat::read(from)?, Flat::read(from)?).ok()
    }
}

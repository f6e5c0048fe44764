//! Numerical checks with known answers on small problems, solved densely.

#[cfg(test)]
mod dense;
#[cfg(test)]
mod patch;
#[cfg(test)]
mod plate;
#[cfg(test)]
mod slab;

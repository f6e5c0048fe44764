//! Signed distance fields of surfaces, smooth enough for contact.
//!
//! [`DistanceField`] takes any triangle soup, also one that is open or has defects. Coordinates are LPS mm; values are mm,
//! negative inside. Invariants: value, gradient and Hessian belong to one C1 function inside the domain, and all three are
//! finite at every finite point, also far outside the band. The published methods for comparison ([`UniformField`],
//! [`Octree`]) have the same sign convention and are finite as well, but they are less smooth.

mod accuracy;
mod band_certificate;
mod banded;
mod baseline;
mod brick_values;
mod bricks;
mod build;
mod certificate;
mod closing;
mod coarse;
mod crossings;
mod defects;
mod distance_field;
mod envelope;
mod error;
mod exact;
mod features;
mod fit;
mod flood;
mod lanes;
mod lattice;
mod method;
mod query;
mod ray;
mod refine;
mod region;
mod regions;
mod rim;
mod scan;
mod sites;
mod spline;
mod tiles;
mod tree;
mod triangle;
mod visibility;
mod winding;

pub use accuracy::{Accuracy, SampleKind, sample_points};
pub use band_certificate::BandBound;
pub use baseline::{Octree, Resolution, SampledReport, SampledSettings, Tolerance, UniformField};
pub use build::{FieldReport, FieldSettings};
pub use distance_field::DistanceField;
pub use envelope::{Envelope, EnvelopeSettings, envelope};
pub use error::FieldError;
pub use exact::ExactDistance;
pub use method::{CheckedDistance, Method, MethodSettings, SignedField};
pub use region::{Region, RegionKind, RegionsOfKind};
pub use regions::unclear_regions;

#[cfg(test)]
mod tests;

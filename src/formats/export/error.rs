/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The volume has more voxels along an axis than the format can store.
    #[error("{dims:?} voxels, but the format stores at most {allowed} along each axis")]
    TooManyVoxels {
        /// Voxels along each axis.
        dims: [usize; 3],
        /// Largest number along an axis.
        allowed: i16,
    },
    /// The bytes could not be compressed or written.
    #[error("the file could not be written")]
    Write(#[from] std::io::Error),
}

use crate::import::SurfaceFormat;
use crate::import::dicom::tests::{Slice, archive};
use crate::import::malformed_tests::{other_volumes, surfaces, volumes};
use crate::import::nifti1::tests::{File, gzip};
use crate::import::number::ByteOrder;
use crate::import::transform_file::tests as transform_tests;
use crate::import::vtu::legacy_tests;
use crate::import::vtu::tests::{Encoding, file as vtu};

/// The reader of a file.
#[derive(Debug, Clone, Copy)]
pub(super) enum Target {
    Surface(SurfaceFormat),
    Volume,
    Mesh,
    Transform,
    Landmarks,
}

/// Envelope around the bytes that are damaged.
#[derive(Debug, Clone)]
enum Wrap {
    Nothing,
    Gzip,
    /// The first slice of a series.
    Series(&'static str),
}

/// An undamaged file.
#[derive(Debug, Clone)]
pub(super) struct Seed {
    pub(super) name: String,
    pub(super) target: Target,
    /// The bytes that are damaged; of a packed file, its content.
    pub(super) plain: Vec<u8>,
    wrap: Wrap,
}

impl Seed {
    fn new(name: impl Into<String>, target: Target, plain: Vec<u8>) -> Self {
        Self { name: name.into(), target, plain, wrap: Wrap::Nothing }
    }

    /// The complete file with `plain` in its envelope.
    pub(super) fn wrap(&self, plain: Vec<u8>) -> Vec<u8> {
        match self.wrap {
            Wrap::Nothing => plain,
            Wrap::Gzip => gzip(&plain),
            Wrap::Series(syntax) => {
                let mut files = vec![("0".to_owned(), plain)];
                files.extend((1..5).map(|k| (k.to_string(), Slice::near(k, syntax).file())));
                archive(&files)
            }
        }
    }

    pub(super) fn whole(&self) -> Vec<u8> {
        self.wrap(self.plain.clone())
    }
}

/// Transfer syntaxes with compressed and plain pixels.
const SYNTAXES: [&str; 6] = [
    "1.2.840.10008.1.2",
    "1.2.840.10008.1.2.1",
    "1.2.840.10008.1.2.1.99",
    "1.2.840.10008.1.2.5",
    "1.2.840.10008.1.2.4.80",
    "1.2.840.10008.1.2.4.90",
];

/// A file of every kind.
pub(super) fn seeds() -> Vec<Seed> {
    let mut all: Vec<Seed> = surfaces()
        .into_iter()
        .map(|(format, bytes, _)| Seed::new(format!("{format:?}"), Target::Surface(format), bytes))
        .collect();
    let whole = volumes().into_iter().chain(other_volumes());
    all.extend(whole.enumerate().map(|(n, bytes)| Seed::new(format!("volume {n}"), Target::Volume, bytes)));
    let packed = Seed::new("NIfTI in gzip", Target::Volume, File::new(ByteOrder::Little).plain());
    all.push(Seed { wrap: Wrap::Gzip, ..packed });
    for syntax in SYNTAXES {
        let slice = Seed::new(format!("slice in {syntax}"), Target::Volume, Slice::near(0, syntax).file());
        all.push(Seed { wrap: Wrap::Series(syntax), ..slice });
    }
    for encoding in [
        Encoding::Ascii,
        Encoding::Base64,
        Encoding::Zlib { block: 64 },
        Encoding::RawAppended,
        Encoding::Base64Appended,
    ] {
        all.push(Seed::new(format!("VTU {encoding:?}"), Target::Mesh, vtu(encoding, ByteOrder::Little, true)));
    }
    for (is_ascii, version) in [(true, 3), (true, 5), (false, 3), (false, 5)] {
        all.push(Seed::new(format!("VTK {version}"), Target::Mesh, legacy_tests::file(is_ascii, version)));
    }
    for (n, file) in transform_tests::files_of_every_kind().into_iter().enumerate() {
        all.push(Seed::new(format!("transform {n}"), Target::Transform, file));
    }
    let list = "# Markups fiducial file version = 5.6\n# CoordinateSystem = LPS\n1,6,-84.5,45,0,0,0,1,1,1,0,\"A, \"\"b\"\"\",,,2,0\n";
    all.push(Seed::new("fiducials", Target::Landmarks, list.as_bytes().to_vec()));
    let table = "label,r,a,s,defined\nANS,-6,84.5,45,1\n";
    all.push(Seed::new("table of points", Target::Landmarks, table.as_bytes().to_vec()));
    all
}

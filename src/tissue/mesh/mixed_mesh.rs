use prosopon_geometry::{Flat, Point};

/// Tissue of an element, numbered as in the cell array `tissue` of VTU files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Tissue {
    /// Skin.
    Skin = 0,
    /// Muscle.
    Muscle = 1,
    /// Fat.
    Fat = 2,
    /// Mucosa.
    Mucosa = 3,
    /// Cartilage of the nose.
    Cartilage = 4,
}

prosopon_geometry::flat_names!(Tissue { Skin, Muscle, Fat, Mucosa, Cartilage });

impl Tissue {
    /// Number of tissues.
    pub const COUNT: usize = 5;
    /// Every tissue, in the order of its number.
    pub const ALL: [Self; Self::COUNT] = [Self::Skin, Self::Muscle, Self::Fat, Self::Mucosa, Self::Cartilage];

    /// Name in lower case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Skin => "skin",
            Self::Muscle => "muscle",
            Self::Fat => "fat",
            Self::Mucosa => "mucosa",
            Self::Cartilage => "cartilage",
        }
    }
}

/// Boundary condition of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attachment {
    /// Unconstrained: interior, skin or air side.
    Free,
    /// Slides on bone: contact can push the node but not pull it.
    Sliding,
    /// Moves with bone segment `k`; 0 is the fixed skull.
    Tied(u32),
    /// Glides on bone segment `k`: held to its surface in both normal directions, free along it.
    Gliding(u32),
    /// On a far boundary (neck, back of the head): fixed.
    Fixed,
}

impl Flat for Attachment {
    fn write(&self, to: &mut Vec<u8>) {
        let (code, segment): (u8, u32) = match self {
            Self::Free => (0, 0),
            Self::Sliding => (1, 0),
            Self::Tied(segment) => (2, *segment),
            Self::Gliding(segment) => (3, *segment),
            Self::Fixed => (4, 0),
        };
        (code, segment).write(to);
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        match <(u8, u32)>::read(from)? {
            (0, _) => Some(Self::Free),
            (1, _) => Some(Self::Sliding),
            (2, segment) => Some(Self::Tied(segment)),
            (3, segment) => Some(Self::Gliding(segment)),
            (4, _) => Some(Self::Fixed),
            (5.., _) => None,
        }
    }
}

impl Attachment {
    /// Number used in files: -1 free, 0 skull or fixed, k segment k, -2 sliding, -3 - k gliding on segment k.
    #[must_use]
    pub fn number(self) -> f64 {
        match self {
            Self::Gliding(segment) => -3.0 - f64::from(segment),
            Self::Free => -1.0,
            Self::Sliding => -2.0,
            Self::Tied(segment) => f64::from(segment),
            Self::Fixed => 0.0,
        }
    }
}

/// Two parts of the tissue's surface that may touch each other: the red margins of the lips.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Facing {
    /// Boundary triangles of each part, counter-clockwise seen from outside the tissue.
    pub sides: [Vec<[u32; 3]>; 2],
}

prosopon_geometry::flat!(Facing { sides });

/// Prisms and tetrahedra of one face at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct MixedMesh {
    /// Nodes at rest, LPS mm.
    pub positions: Vec<Point>,
    /// Tetrahedra: `det(x1-x0, x2-x0, x3-x0) > 0`.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Tissue of each tetrahedron.
    pub tetrahedron_tissue: Vec<Tissue>,
    /// Prisms: the outer (skin) triangle 0, 1, 2, then the inner nodes below each.
    /// The outer triangle is counter-clockwise seen from outside the head, as in [`TriMesh`](prosopon_geometry::TriMesh). As in
    /// VTK's wedge, the first triangle faces away from the second.
    pub prisms: Vec<[u32; 6]>,
    /// Tissue of each prism; empty when all are skin.
    pub prism_tissue: Vec<Tissue>,
    /// Boundary triangles that face bone.
    /// They are counter-clockwise seen from the bone (outward from the tissue). Contact is tested at their vertices and
    /// barycentres.
    pub bone_faces: Vec<[u32; 3]>,
    /// Boundary condition of each node.
    pub attachment: Vec<Attachment>,
    /// Nodes of the faces at the depth limit, in ascending order.
    /// Tissue below [`MeshSettings::depth_mm`](super::MeshSettings::depth_mm) is cut off there.
    /// [`build`](super::build) makes them [`Attachment::Fixed`]; the caller should free those near moving bone.
    pub depth_cut_nodes: Vec<u32>,
    /// Parts of the surface that may touch each other; empty where no slit is cut.
    pub facing: Vec<Facing>,
}

prosopon_geometry::flat!(MixedMesh {
    positions,
    tetrahedra,
    tetrahedron_tissue,
    prisms,
    prism_tissue,
    bone_faces,
    attachment,
    depth_cut_nodes,
    facing,
});

impl MixedMesh {
    /// Tissue of prism `prism`.
    #[must_use]
    pub fn tissue_of_prism(&self, prism: usize) -> Tissue {
        self.prism_tissue.get(prism).copied().unwrap_or(Tissue::Skin)
    }
}

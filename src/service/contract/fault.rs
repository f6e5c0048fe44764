use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use prosopon_geometry::control::Cancelled;
use prosopon_geometry::{Motion, Point, moved_places};

macro_rules! kinds {
    ($($(#[$doc:meta])* $name:ident = $slug:literal,)*) => {
        /// Kind of a problem; its name on the wire is the last part of the problem's type.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
        pub enum FaultKind {
            $($(#[$doc])* #[serde(rename = $slug)] $name,)*
        }

        impl FaultKind {
            /// Every kind.
            pub const ALL: &'static [Self] = &[$(Self::$name),*];

            /// Name on the wire.
            #[must_use]
            pub fn slug(self) -> &'static str {
                match self { $(Self::$name => $slug),* }
            }
        }
    };
}

kinds! {
    /// The request cannot be parsed.
    MalformedRequest = "malformed-request",
    /// A stored value is damaged: it does not match its seal.
    DamagedValue = "damaged-value",
    /// Some values of the request are not allowed.
    InvalidRequest = "invalid-request",
    /// Nothing has this id or path.
    NotFound = "not-found",
    /// The thing with this id was deleted.
    Gone = "gone",
    /// The path does not take this method.
    MethodNotAllowed = "method-not-allowed",
    /// The client accepts none of the representations.
    NotAcceptable = "not-acceptable",
    /// The request took too long to arrive or to answer.
    Timeout = "timeout",
    /// The current state does not allow the request.
    WrongState = "wrong-state",
    /// Something must be uploaded or built first.
    MissingInput = "missing-input",
    /// It was built from inputs or settings that have been replaced.
    Stale = "stale",
    /// The body is longer than allowed.
    TooLarge = "too-large",
    /// The result does not have the requested range.
    RangeNotSatisfiable = "range-not-satisfiable",
    /// The format is not supported.
    UnsupportedFormat = "unsupported-format",
    /// An idempotency key was used again for another request.
    IdempotencyMismatch = "idempotency-mismatch",
    /// A surface cannot be used.
    SurfaceNotUsable = "surface-not-usable",
    /// A CT volume cannot be used.
    VolumeNotUsable = "volume-not-usable",
    /// Skin and skull do not belong together.
    AnatomyNotUsable = "anatomy-not-usable",
    /// No distance field can be built.
    FieldNotUsable = "field-not-usable",
    /// No tissue mesh can be built, or an uploaded one cannot be used.
    MeshNotUsable = "mesh-not-usable",
    /// A cut does not touch bone.
    CutMissesBone = "cut-misses-bone",
    /// The cuts leave the bone in one piece.
    BoneNotParted = "bone-not-parted",
    /// A path or plan cannot be used.
    PlanNotUsable = "plan-not-usable",
    /// Mesh, bone and settings cannot be solved together.
    SceneNotUsable = "scene-not-usable",
    /// The computation would need more memory than is allowed.
    NotEnoughMemory = "not-enough-memory",
    /// No equilibrium was reached.
    SolverNotConverged = "solver-not-converged",
    /// A material lost its stability under the load.
    SolverUnstable = "solver-unstable",
    /// An element would turn inside out.
    SolverInverted = "solver-inverted",
    /// Tissue stayed inside bone.
    SolverPenetration = "solver-penetration",
    /// Two surfaces cannot be compared.
    ComparisonNotUsable = "comparison-not-usable",
    /// No rigid motion maps one surface onto the other, or many do.
    RegistrationFailed = "registration-failed",
    /// There is nothing to compare with.
    NoReference = "no-reference",
    /// The result is not there yet.
    NotReady = "not-ready",
    /// The request is not for this host.
    ForeignHost = "foreign-host",
    /// A web page of another origin wants to write.
    ForeignOrigin = "foreign-origin",
    /// Too many jobs wait.
    QueueFull = "queue-full",
    /// Too many jobs of one tenant wait.
    TenantQueueFull = "tenant-queue-full",
    /// The session would exceed its quota.
    QuotaFull = "quota-full",
    /// The request has no valid credentials.
    Unauthenticated = "unauthenticated",
    /// The sender may not do this.
    Forbidden = "forbidden",
    /// The service is stopping.
    ShuttingDown = "shutting-down",
    /// The disk is full.
    StorageFull = "storage-full",
    /// The database or the bucket cannot be reached now.
    StoreUnavailable = "store-unavailable",
    /// The bucket refuses the service, or one of its values.
    StoreRefuses = "store-refuses",
    /// The job reached its limit of computing time.
    DeadlineExceeded = "deadline-exceeded",
    /// The service stopped too often while the job ran.
    JobInterrupted = "job-interrupted",
    /// A fault of the service.
    Internal = "internal",
}

/// A value in a request that is not allowed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FieldFault {
    /// JSON pointer to it.
    pub pointer: String,
    /// What is wrong, what is allowed, and what to do.
    pub detail: String,
}

impl FieldFault {
    /// A fault at `pointer`; a plain name of a part or query parameter becomes a pointer to it.
    pub fn new(pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        let mut pointer = pointer.into();
        if !pointer.is_empty() && !pointer.starts_with('/') {
            pointer.insert(0, '/');
        }
        Self { pointer, detail: detail.into() }
    }
}

/// Why a request was refused or failed, independent of HTTP; also stored with a failed job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    /// Kind of the problem.
    pub kind: FaultKind,
    /// What is wrong, what is allowed, and what to do.
    pub detail: String,
    /// Values of the request that are not allowed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<FieldFault>,
    /// Further members of the problem document, for programs.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub facts: Map<String, Value>,
}

impl Fault {
    /// A fault of `kind`.
    pub fn new(kind: FaultKind, detail: impl Into<String>) -> Self {
        Self { kind, detail: detail.into(), errors: Vec::new(), facts: Map::new() }
    }

    /// A fault for values of a request that are not allowed.
    #[must_use]
    pub fn invalid(errors: Vec<FieldFault>) -> Self {
        let detail = match errors.as_slice() {
            [one] => format!("{} {}", one.pointer, one.detail).trim_start().to_owned(),
            many => format!("{} values are not allowed", many.len()),
        };
        Self { errors, ..Self::new(FaultKind::InvalidRequest, detail) }
    }

    /// The fault with the places that its texts and its facts name moved.
    #[must_use]
    pub fn moved(mut self, motion: &Motion) -> Self {
        self.detail = moved_places(&self.detail, motion);
        for error in &mut self.errors {
            error.detail = moved_places(&error.detail, motion);
        }
        self.facts.iter_mut().for_each(|(name, fact)| move_fact(name, fact, motion));
        self
    }

    /// Adds a member to the problem document.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.facts.insert(name.to_owned(), value.into());
        self
    }

    /// Adds `pointer` as a value that is not allowed, with the fault's detail.
    #[must_use]
    pub fn at(mut self, pointer: &str) -> Self {
        self.errors.push(FieldFault::new(pointer, self.detail.clone()));
        self
    }

    /// Puts `pointer` before all pointers: the values are those of a part of the request.
    #[must_use]
    pub fn below(self, pointer: &str) -> Self {
        let named = Self::invalid(self.errors.clone()).detail == self.detail;
        let errors: Vec<FieldFault> =
            self.errors.iter().map(|e| FieldFault::new(format!("{pointer}{}", e.pointer), e.detail.clone())).collect();
        let detail = if named { Self::invalid(errors.clone()).detail } else { self.detail };
        Self { errors, detail, ..self }
    }

    /// Replaces pointers to `/cuts` and below by `pointer`.
    ///
    /// For requests that take their cuts from elsewhere.
    #[must_use]
    pub fn with_cuts_at(mut self, pointer: &str) -> Self {
        for error in &mut self.errors {
            if error.pointer == "/cuts" || error.pointer.starts_with("/cuts/") {
                pointer.clone_into(&mut error.pointer);
            }
        }
        self
    }
}

/// Why long work ended early.
#[derive(Debug, Clone, PartialEq)]
pub enum Halt {
    /// It was cancelled.
    Cancelled,
    /// It failed.
    Fault(Box<Fault>),
}

impl Halt {
    /// The end with the places that a fault names moved.
    #[must_use]
    pub fn moved(self, motion: &Motion) -> Self {
        match self {
            Self::Cancelled => Self::Cancelled,
            Self::Fault(fault) => Self::Fault(Box::new(fault.moved(motion))),
        }
    }
}

impl From<Fault> for Halt {
    fn from(fault: Fault) -> Self {
        Self::Fault(Box::new(fault))
    }
}

impl From<Cancelled> for Halt {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<Halt> for Fault {
    /// Work that runs within a request is only cancelled when the client has left or the service stops.
    fn from(halt: Halt) -> Self {
        match halt {
            Halt::Cancelled => Self::new(FaultKind::ShuttingDown, "the service is stopping; try again later"),
            Halt::Fault(fault) => *fault,
        }
    }
}
/// Members of facts that are places.
const PLACES: [&str; 2] = ["place_mm", "widest_bridge_mm"];

/// Moves a fact that is a place, and the places within others.
fn move_fact(name: &str, fact: &mut Value, motion: &Motion) {
    match (point_of(fact).filter(|_| PLACES.contains(&name)), fact) {
        (Some(place), fact) => *fact = Value::from(<[f64; 3]>::from((motion * place).coords).to_vec()),
        (None, Value::Object(members)) => members.iter_mut().for_each(|(name, value)| move_fact(name, value, motion)),
        (None, Value::Array(values)) => values.iter_mut().for_each(|value| move_fact("", value, motion)),
        (None, Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_)) => {}
    }
}

fn point_of(value: &Value) -> Option<Point> {
    let numbers: Vec<f64> = value.as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?;
    <[f64; 3]>::try_from(numbers).ok().map(Point::from)
}

use super::dual::Dual;
use super::landmarks::Landmarks;
use super::mouth::PhantomMouth;
use super::{air, skin, skull};
use prosopon_geometry::{Aabb, Implicit, Point, Vector};

/// Analytic solids of the phantom; each is negative inside, LPS mm.
pub struct Phantom {
    /// Everything inside the skin.
    pub skin: Box<dyn Implicit + Send>,
    /// Bone and teeth.
    pub skull: Box<dyn Implicit + Send>,
    /// Airway: nasal cavity and mouth.
    pub air: Box<dyn Implicit + Send>,
    /// Landmarks and planes, named as in `landmarks.json`.
    pub landmarks: Landmarks,
    /// Where the lips meet; `None` where they are joined.
    pub mouth: Option<PhantomMouth>,
}

impl std::fmt::Debug for Phantom {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Phantom").field("landmarks", &self.landmarks).finish_non_exhaustive()
    }
}

/// One formula in two versions: plain, and with its gradient.
struct Solid {
    value: fn([f64; 3]) -> f64,
    dual: fn([Dual; 3]) -> Dual,
}

impl Implicit for Solid {
    fn value(&self, p: &Point) -> f64 {
        (self.value)([p.x, p.y, p.z])
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let d = (self.dual)([0, 1, 2].map(|a| Dual::variable(p[a], a)));
        (d.value, Vector::from(d.gradient))
    }
}

/// Builds the standard phantom.
///
/// # Examples
///
/// The skull is a closed surface of plausible volume, and the landmark of the nose tip lies on the skin.
/// ```
/// use prosopon_geometry::TopologyFaults;
/// use prosopon_planning::phantom;
///
/// let head = phantom::head();
/// let skull = phantom::surface_of(head.skull.as_ref(), &head.bounds(), 3.0).ok_or("the box holds no skull")?;
/// assert!(TopologyFaults::of(&skull).is_closed_manifold());
/// assert!((600.0..950.0).contains(&(skull.volume() / 1e3))); // cm³
/// let nose = head.landmarks.point("pronasale").ok_or("no pronasale")?;
/// assert!(head.skin.value(&nose).abs() < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[must_use]
pub fn head() -> Phantom {
    Phantom {
        skin: Box::new(Solid { value: skin::skin, dual: skin::skin }),
        skull: Box::new(Solid { value: skull::skull, dual: skull::skull }),
        air: Box::new(Solid { value: air::air, dual: air::air }),
        landmarks: Landmarks::of_head(),
        mouth: None,
    }
}

/// The standard phantom with a mouth: closed lips with a groove between them, and a vestibule in front of the teeth.
///
/// The lips touch along [`Phantom::mouth`]. The landmarks have `stomion`, `cheilion_right` and `cheilion_left` too.
#[must_use]
pub fn head_with_mouth() -> Phantom {
    let mouth = PhantomMouth::new();
    let skin = Solid { value: skin::skin_with_mouth, dual: skin::skin_with_mouth };
    let mut landmarks = Landmarks::of_head();
    let side = mouth.half_width_mm;
    for (name, x) in [("stomion", 0.0), ("cheilion_right", -side), ("cheilion_left", side)] {
        landmarks.points.extend(mouth.on_skin(&skin, x).map(|p| (name.to_owned(), p)));
    }
    let air = Solid { value: air::air_with_closed_lips, dual: air::air_with_closed_lips };
    Phantom { skin: Box::new(skin), air: Box::new(air), landmarks, mouth: Some(mouth), ..head() }
}

impl Phantom {
    /// Box that contains the head with a margin, LPS mm.
    #[must_use]
    pub fn bounds(&self) -> Aabb {
        Aabb { min: Point::new(-80.0, -118.0, -68.0), max: Point::new(80.0, 102.0, 174.0) }
    }
}

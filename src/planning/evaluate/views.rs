//! The five oriented views of a face.

use rayon::prelude::*;

use super::picture::{Layer, encode};
use super::raster::{Camera, Canvas, Shading, draw};
use prosopon_geometry::{Aabb, Point, TriMesh, Vector};

/// Width and height of each view of [`render_views`], pixels: 37 mm of an A4 page at 250 dots per inch.
const VIEW_PX: [usize; 2] = [368, 432];

/// A viewing direction on the face, with the letters at the picture's edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedView {
    /// Name of the view.
    pub name: &'static str,
    /// Letter at the left edge: R or L for the patient's side, A or P for anterior or posterior.
    pub left: &'static str,
    /// Letter at the right edge.
    pub right: &'static str,
    /// From the eye into the scene, LPS; not normalised.
    pub(super) into: [f64; 3],
}

const fn view(name: &'static str, into: [f64; 3], left: &'static str, right: &'static str) -> OrientedView {
    OrientedView { name, left, right, into }
}

/// The views, from the patient's right side round to the left; in the front view the patient's left is on the right.
pub const ORIENTED_VIEWS: [OrientedView; 5] = [
    view("patient's right", [1.0, 0.0, 0.0], "P", "A"),
    view("three-quarter, patient's right", [0.64, 0.77, 0.0], "R", "L"),
    view("front", [0.0, 1.0, 0.0], "R", "L"),
    view("three-quarter, patient's left", [-0.64, 0.77, 0.0], "R", "L"),
    view("patient's left", [-1.0, 0.0, 0.0], "A", "P"),
];

/// Draws each layer in the [`ORIENTED_VIEWS`], each view as a PNG of 368 × 432 pixels without any text.
///
/// Returns five PNGs for each layer, in the order of the views. All pictures have one scale and show the head upright (z up);
/// the same view of two layers shows the same window of space. Layers are drawn in parallel.
#[must_use]
pub fn render_views(layers: &[Layer<'_>]) -> Vec<[Vec<u8>; 5]> {
    let meshes: Vec<&TriMesh> = layers.iter().map(|l| l.mesh).collect();
    let cameras = cameras(&meshes, &ORIENTED_VIEWS, VIEW_PX);
    let picture = |layer: &Layer<'_>, camera: &Camera| {
        let mut large = Canvas::white(2 * VIEW_PX[0], 2 * VIEW_PX[1]);
        draw(&mut large, camera, layer.mesh, layer.values, Shading::Lit);
        encode(&large.halved())
    };
    layers.par_iter().map(|layer| cameras.each_ref().map(|camera| picture(layer, camera))).collect()
}

/// Cameras for pictures of `size_px`, drawn at twice that size: all have the scale of the view that needs most room.
pub(super) fn cameras(meshes: &[&TriMesh], views: &[OrientedView; 5], size_px: [usize; 2]) -> [Camera; 5] {
    let cameras = views.map(|view| camera(meshes, Vector::from(view.into), size_px));
    let pixels_per_mm = cameras.iter().map(|c| c.pixels_per_mm).fold(f64::INFINITY, f64::min);
    cameras.map(|camera| Camera { pixels_per_mm, ..camera })
}

/// Camera of a picture at twice the size; the surfaces fill nine tenths of it.
fn camera(meshes: &[&TriMesh], direction: Vector, size_px: [usize; 2]) -> Camera {
    let into = direction.normalize();
    let right = into.cross(&Vector::z()).normalize();
    let up = right.cross(&into);
    let seen: Vec<Point> = meshes
        .iter()
        .flat_map(|mesh| mesh.triangles().iter().flatten().map(|v| mesh.positions()[*v as usize].coords))
        .map(|p| Point::new(right.dot(&p), up.dot(&p), into.dot(&p)))
        .collect();
    let bounds = Aabb::of(&seen).unwrap_or(Aabb { min: Point::origin(), max: Point::origin() });
    let (middle, extent) = (bounds.center(), bounds.max - bounds.min);
    let centre = Point::from(right * middle.x + up * middle.y + into * middle.z);
    let fit = |pixels: usize, mm: f64| 0.9 * 2.0 * pixels as f64 / mm.max(1e-6);
    let pixels_per_mm = fit(size_px[0], extent.x).min(fit(size_px[1], extent.y));
    Camera { centre, right, up, into, pixels_per_mm }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_layer_is_drawn_from_five_sides() {
        let corners = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, -10.0, 0.0], [0.0, 0.0, 10.0]].map(Point::from);
        let faces = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
        let mesh = TriMesh::new(corners.to_vec(), faces).unwrap();
        let layer = Layer { mesh: &mesh, values: None };
        let pictures = render_views(&[layer, layer]);
        assert_eq!(pictures.len(), 2);
        assert_eq!(pictures[0], pictures[1]);
        assert!(pictures[0].iter().all(|png| png.starts_with(b"\x89PNG")));
        assert!(render_views(&[]).is_empty());
    }

    #[test]
    fn the_patients_left_is_on_the_right_of_the_front_view() {
        let front = ORIENTED_VIEWS[2];
        let right = Vector::from(front.into).cross(&Vector::z());
        assert!(right.x > 0.0);
        assert_eq!((front.left, front.right), ("R", "L"));
    }
}

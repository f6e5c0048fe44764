//! Pictures of the report's page.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use super::step_surface::load_upright;
use crate::http::Problem;
use prosopon_contract::{ErrorDocument, from_json};
use prosopon_geometry::Vector;
use prosopon_jobs::Service;
use prosopon_planning::evaluate::{Coloured, Layer, ORIENTED_VIEWS, OrientedView, moved_along, render_views};
use prosopon_session::ERROR_LIMIT_MM;
use prosopon_store::{JobRecord, StepRecord};

/// The skin from five sides.
#[derive(Debug, Serialize)]
pub(super) struct PictureRow {
    title: String,
    legend: Option<Legend>,
    views: Vec<Picture>,
}

/// Scale of the colours.
#[derive(Debug, Serialize)]
struct Legend {
    /// Values at the ends and between them, mm.
    marks: Vec<String>,
    /// Meaning of blue and of red.
    blue: &'static str,
    red: &'static str,
}

/// One view, with the letters at its left and right edges.
#[derive(Debug, Serialize)]
struct Picture {
    name: &'static str,
    left: &'static str,
    right: &'static str,
    source: String,
}

/// A data URI, so that the page needs no other file.
pub(super) fn data_uri(media_type: &str, bytes: &[u8]) -> String {
    format!("data:{media_type};base64,{}", STANDARD.encode(bytes))
}

/// The skin at rest and at `step`, its movement forward and, when the step has an error map, its error, each from five sides.
pub(super) async fn pictures(
    service: &Service,
    job: &JobRecord,
    step: &StepRecord,
) -> Result<Vec<PictureRow>, Problem> {
    let (rest, mesh, frame) = load_upright(service, job, step).await?;
    let error = step.error.as_deref().map(|text| from_json::<ErrorDocument>("the error map", text)).transpose()?;
    let drawn = service.compute(move |_, _| {
        let moved = moved_along(&rest, &mesh, &-Vector::y());
        let layer = |mesh, values| Layer { mesh, values };
        let mut layers = vec![layer(&rest, None), layer(&mesh, None), layer(&mesh, Some(moved.coloured()))];
        let values = frame.error_mm.unwrap_or_default();
        if error.is_some() {
            layers.push(layer(&mesh, Some(Coloured { values: &values, limit_mm: ERROR_LIMIT_MM })));
        }
        let titles = [
            Some(("Before".to_owned(), None)),
            Some(("After, as predicted".to_owned(), None)),
            Some(("Predicted movement forward".to_owned(), Some(legend(moved.limit_mm, "back", "forward")))),
            error.map(|e| (e.title(), Some(legend(ERROR_LIMIT_MM, "behind the reference", "in front of it")))),
        ];
        let rows = titles.into_iter().flatten().zip(render_views(&layers));
        Ok(rows.map(|((title, legend), pngs)| row(title, legend, &pngs)).collect())
    });
    Ok(drawn.await?)
}

fn row(title: String, legend: Option<Legend>, pngs: &[Vec<u8>; 5]) -> PictureRow {
    let picture = |(view, png): (&OrientedView, &Vec<u8>)| Picture {
        name: view.name,
        left: view.left,
        right: view.right,
        source: data_uri("image/png", png),
    };
    PictureRow { title, legend, views: ORIENTED_VIEWS.iter().zip(pngs).map(picture).collect() }
}

fn legend(limit_mm: f64, blue: &'static str, red: &'static str) -> Legend {
    let mark = |share: f64| if share == 0.0 { "0".to_owned() } else { format!("{:+.1}", share * limit_mm) };
    Legend { marks: [-1.0, -0.5, 0.0, 0.5, 1.0].map(mark).to_vec(), blue, red }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_five_views_and_a_scale_with_signs() {
        let pngs: [Vec<u8>; 5] = std::array::from_fn(|_| vec![1, 2, 3]);
        let row = row("Movement".to_owned(), Some(legend(5.0, "back", "forward")), &pngs);
        assert_eq!(row.legend.unwrap().marks, ["-5.0", "-2.5", "0", "+2.5", "+5.0"]);
        assert_eq!(row.views.len(), 5);
        assert!(row.views.iter().all(|v| v.source == "data:image/png;base64,AQID"));
        assert_eq!((row.views[2].name, row.views[2].left, row.views[2].right), ("front", "R", "L"));
    }
}

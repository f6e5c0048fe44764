//! The part of the report's page about the distance from a reference.

use serde::Serialize;

use super::report_table::{Table, mm, region, sentence};
use prosopon_contract::{ErrorDocument, StatisticsDocument};
use prosopon_planning::evaluate::diverging;
use prosopon_session::ERROR_LIMIT_MM;

/// Height of the tallest bar of the histogram, and width of each, pixels.
const TALL_PX: f64 = 80.0;
const WIDE_PX: usize = 12;

/// Error against the reference.
#[derive(Debug, Serialize)]
pub(super) struct Errors {
    title: String,
    reference: String,
    summary: String,
    regions: Table,
    baselines: Table,
    histogram: Option<Histogram>,
    /// All statistics, for the appendix.
    details: Table,
}

/// Bars of the distribution, for an SVG picture.
#[derive(Debug, Serialize)]
struct Histogram {
    width: usize,
    height: f64,
    /// Largest share, percent.
    most: String,
    bars: Vec<Bar>,
    /// Edges of the inner bars at the left and right end, mm.
    ends: [String; 2],
}

#[derive(Debug, Serialize)]
struct Bar {
    x: usize,
    y: f64,
    height: f64,
    colour: String,
    /// What the bar counts.
    text: String,
}

pub(super) fn errors(error: &ErrorDocument) -> Errors {
    let w = &error.whole;
    let by_region = error.regions.iter().map(|(name, s)| (region(name), s));
    let rows = std::iter::once((counted(error), w)).chain(by_region).map(|(name, s)| {
        let lengths = [s.mean_mm, s.mean_abs_mm, s.p95_mm, s.max_mm].map(mm);
        std::iter::once(name).chain(lengths).chain([percent(s.share_below_1_mm)]).collect()
    });
    let names = ["region", "mean, signed", "mean", "P95", "largest", "< 1 mm, %"];
    Errors {
        title: error.title(),
        reference: error.reference.clone(),
        summary: format!(
            "The prediction lies on average {} mm from the reference, 95 % of it within {} mm, all of it within {} mm.",
            mm(w.mean_abs_mm),
            mm(w.p95_mm),
            mm(w.max_mm)
        ),
        regions: Table::new("By region, mm", &names, rows)
            .with_notes(["A negative signed mean: the prediction lies behind the reference.".to_owned()]),
        baselines: beside_baselines(error),
        histogram: histogram(error),
        details: details(error),
    }
}

/// Name of the row of all vertices that count.
fn counted(error: &ErrorDocument) -> String {
    match error.mask.as_str() {
        "face" => "whole face",
        "all" => "whole skin",
        _ => "all that counts",
    }
    .to_owned()
}

/// A share in percent, without the sign.
fn percent(share: f64) -> String {
    format!("{:.0}", 100.0 * share)
}

/// Table of the error beside that of no prediction and of 0.7 of the nearest bone, by region.
fn beside_baselines(error: &ErrorDocument) -> Table {
    let cells = |s: Option<&StatisticsDocument>| match s {
        Some(s) => [s.mean_abs_mm, s.p95_mm, s.mean_mm].map(mm).join(" / "),
        None => "–".to_owned(),
    };
    let rows = error.beside_baselines().into_iter().map(|(name, of)| {
        let name = if name == "counted" { counted(error) } else { region(name) };
        std::iter::once(name).chain(of.map(cells)).collect()
    });
    let missing = error.baselines.as_ref().and_then(|b| b.missing.as_ref());
    Table::new(
        "Beside two simple predictions: mean / P95 / signed mean, mm",
        &["region", "this prediction", "no prediction", "0.7 of nearest bone"],
        rows,
    )
    .with_notes(missing.map(|m| sentence(&format!("not every simple prediction could be scored: {m}"))))
}

/// Every statistic of every part, both ways.
fn details(error: &ErrorDocument) -> Table {
    let whole = std::iter::once((counted(error), &error.whole));
    let further = [
        ("from reference", Some(&error.backward)),
        ("averaged over 5 mm", error.smoothed.as_ref()),
        ("vertex to vertex", error.correspondence.as_ref()),
    ];
    let further = further.into_iter().filter_map(|(name, s)| s.map(|s| (name.to_owned(), s)));
    let regions = error.regions.iter().map(|(name, s)| (region(name), s));
    let rows = whole.chain(regions).chain(further).map(|(name, s)| {
        let lengths = [s.mean_mm, s.mean_abs_mm, s.rms_mm, s.p50_mm, s.p90_mm, s.p95_mm, s.max_mm].map(mm);
        std::iter::once(name).chain(lengths).chain([percent(s.share_below_1_mm)]).collect()
    });
    let names = ["region", "mean", "abs", "RMS", "P50", "P90", "P95", "max", "< 1 mm, %"];
    Table::new(format!("{}: all statistics, mm", error.title()), &names, rows).with_notes(detail_notes(error))
}

fn detail_notes(error: &ErrorDocument) -> Vec<String> {
    let w = &error.whole;
    let mut notes = vec![format!(
        "Variance {:.3} mm², L2 norm {:.1} mm over {} vertices, below 2 mm {:.1} %, below 3 mm {:.1} %. All values \
         except the L2 norm are weighted by area. Negative: the prediction lies behind the reference.",
        w.variance_mm2,
        w.l2_norm_mm,
        w.count,
        100.0 * w.share_below_2_mm,
        100.0 * w.share_below_3_mm
    )];
    if error.excluded > 0 {
        notes.push(format!("{} vertices lie beyond the reference's open border and do not count.", error.excluded));
    }
    if let Some(roughness) = error.roughness_mm {
        notes.push(format!("Averaging over 5 mm removes {} mm (RMS): noise and fine detail.", mm(roughness)));
    }
    if let Some(r) = &error.registration {
        notes.push(format!(
            "Registered on {} vertices: residual {:.3} mm, overlap {:.0} %, {} iterations.",
            r.vertices,
            r.residual_mm,
            100.0 * r.overlap,
            r.iterations
        ));
    }
    notes
}

fn histogram(error: &ErrorDocument) -> Option<Histogram> {
    let bins = &error.histogram;
    let most = bins.iter().map(|b| b.share).fold(0.0, f64::max);
    let (low, high) = (bins.get(1)?.from_mm, bins.last()?.from_mm);
    let width = (high - low) / bins.len().saturating_sub(2).max(1) as f64;
    if most <= 0.0 {
        return None;
    }
    let last = bins.len() - 1;
    let bars = bins.iter().enumerate().map(|(i, bin)| {
        let height = (TALL_PX * bin.share / most).max(0.0);
        let (range, middle) = match i {
            0 => (format!("below {low:+.2} mm"), low),
            _ if i == last => (format!("above {high:+.2} mm"), high),
            _ => (format!("{:+.2} to {:+.2} mm", bin.from_mm, bin.from_mm + width), bin.from_mm + 0.5 * width),
        };
        let [r, g, b] = diverging(middle, ERROR_LIMIT_MM);
        Bar {
            x: i * WIDE_PX,
            y: TALL_PX - height,
            height,
            colour: format!("#{r:02x}{g:02x}{b:02x}"),
            text: format!("{range}: {:.1} %", 100.0 * bin.share),
        }
    });
    Some(Histogram {
        width: WIDE_PX * bins.len(),
        height: TALL_PX,
        most: format!("{:.0} %", 100.0 * most),
        bars: bars.collect(),
        ends: [low, high].map(|v| format!("{v:+.1} mm")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn error() -> ErrorDocument {
        let statistics = json!({
            "count": 100, "mean_mm": -0.2, "mean_abs_mm": 0.4, "rms_mm": 0.5, "p50_mm": 0.3, "p90_mm": 0.8, "p95_mm": 1.1,
            "max_mm": 2.0, "l2_norm_mm": 5.0, "variance_mm2": 0.2, "share_below_1_mm": 0.94, "share_below_2_mm": 1.0,
            "share_below_3_mm": 1.0
        });
        let bins = [(-2.0, 0.1), (-1.0, 0.5), (0.0, 0.3), (1.0, 0.1)];
        let histogram: Vec<_> = bins.iter().map(|(from, share)| json!({"from_mm": from, "share": share})).collect();
        serde_json::from_value(json!({
            "reference": "target", "mask": "face", "whole": statistics, "backward": statistics,
            "regions": {"cheek_left": statistics}, "histogram": histogram, "registration": null, "warnings": []
        }))
        .unwrap()
    }

    #[test]
    fn the_summary_and_the_rows_name_what_they_measure() {
        let page = serde_json::to_value(errors(&error())).unwrap();
        assert!(page["summary"].as_str().unwrap().contains("0.40 mm from the reference, 95 % of it within 1.10 mm"));
        assert_eq!(page["regions"]["rows"][0], json!(["whole face", "-0.20", "0.40", "1.10", "2.00", "94"]));
        assert_eq!(page["regions"]["rows"][1][0], "left cheek");
        assert_eq!(page["baselines"]["rows"], json!([]));
        assert_eq!(page["details"]["rows"][2][0], "from reference");
    }

    #[test]
    fn the_open_bars_are_named() {
        let histogram = histogram(&error()).unwrap();
        let texts: Vec<&str> = histogram.bars.iter().map(|b| b.text.as_str()).collect();
        assert_eq!(texts[0], "below -1.00 mm: 10.0 %");
        assert_eq!(texts[1], "-1.00 to +0.00 mm: 50.0 %");
        assert_eq!(texts[3], "above +1.00 mm: 10.0 %");
        assert_eq!((histogram.bars[1].y, histogram.bars[1].height), (0.0, TALL_PX));
        let flat = ErrorDocument { histogram: Vec::new(), ..error() };
        assert!(super::histogram(&flat).is_none());
    }
}

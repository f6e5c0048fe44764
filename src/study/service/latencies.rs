use std::collections::BTreeMap;
use std::fmt::Display;
use std::time::Duration;

use crate::error::BenchError;

/// Kind of request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    /// `GET` of a job.
    Job,
    /// `GET` of a session.
    Session,
    /// A page of sessions.
    List,
    /// An upload of a skin and its report.
    Upload,
    /// The first event of a stream.
    Stream,
    /// Requests that prepare the load; not reported.
    Other,
}

impl Kind {
    /// The reported kinds; the first two are the status reads.
    pub(super) const TOLD: [Self; 5] = [Self::Job, Self::Session, Self::List, Self::Upload, Self::Stream];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Job => "job status",
            Self::Session => "session status",
            Self::List => "list of sessions",
            Self::Upload => "upload of a skin",
            Self::Stream => "first event",
            Self::Other => "other",
        }
    }
}

/// Times and errors of one kind.
#[derive(Debug, Clone, Default)]
struct Record {
    ms: Vec<f64>,
    errors: usize,
}

/// Times and errors of requests by kind.
#[derive(Debug, Clone, Default)]
pub(super) struct Latencies {
    kinds: BTreeMap<Kind, Record>,
    /// Message of the first error.
    pub(super) first_error: Option<String>,
}

impl Latencies {
    pub(super) fn add(&mut self, kind: Kind, took: Duration) {
        self.kinds.entry(kind).or_default().ms.push(took.as_secs_f64() * 1e3);
    }

    /// Counts an error and returns it.
    pub(super) fn error(&mut self, kind: Kind, what: &dyn Display) -> BenchError {
        self.kinds.entry(kind).or_default().errors += 1;
        let detail = what.to_string();
        self.first_error.get_or_insert_with(|| format!("{}: {detail}", kind.name()));
        BenchError::Row { case: kind.name().to_owned(), detail }
    }

    pub(super) fn join(&mut self, other: Self) {
        for (kind, record) in other.kinds {
            let own = self.kinds.entry(kind).or_default();
            own.ms.extend(record.ms);
            own.errors += record.errors;
        }
        self.first_error = self.first_error.take().or(other.first_error);
    }

    pub(super) fn errors(&self) -> usize {
        self.kinds.values().map(|r| r.errors).sum()
    }

    pub(super) fn errors_of(&self, kind: Kind) -> usize {
        self.kinds.get(&kind).map_or(0, |r| r.errors)
    }

    /// Times of all these kinds, ascending, ms.
    pub(super) fn sorted_ms(&self, kinds: &[Kind]) -> Vec<f64> {
        let mut ms: Vec<f64> = kinds.iter().filter_map(|k| self.kinds.get(k)).flat_map(|r| r.ms.clone()).collect();
        ms.sort_by(f64::total_cmp);
        ms
    }
}

/// Percentile of ascending times at `share` (0 to 1), by nearest rank; 0 when there are none.
pub(super) fn percentile(sorted: &[f64], share: f64) -> f64 {
    let rank = (share * sorted.len() as f64).ceil().max(1.0) as usize;
    sorted.get(rank.min(sorted.len()).saturating_sub(1)).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_nearest_rank_and_errors_are_counted() {
        let hundred: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!([0.5, 0.95, 0.99, 1.0, 0.0].map(|s| percentile(&hundred, s)), [50.0, 95.0, 99.0, 100.0, 1.0]);
        assert_eq!(percentile(&[], 0.5), 0.0);
        let (mut a, mut b) = (Latencies::default(), Latencies::default());
        a.add(Kind::Job, Duration::from_millis(3));
        b.add(Kind::Session, Duration::from_millis(2));
        b.error(Kind::Job, &"503");
        a.join(b);
        assert_eq!((a.errors(), a.errors_of(Kind::Job), a.errors_of(Kind::Session)), (1, 1, 0));
        assert_eq!(a.sorted_ms(&[Kind::Job, Kind::Session]), [2.0, 3.0]);
        assert_eq!(a.first_error.as_deref(), Some("job status: 503"));
    }
}

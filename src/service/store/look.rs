//! Clocks of the maintenance rounds: what is removed because of its age must not depend on a clock that is wrong for a while.

use std::time::{Duration, Instant};

use time::OffsetDateTime;

use super::records::rfc3339;

const DAY: Duration = Duration::from_secs(24 * 3600);
const DAY_MS: i64 = 24 * 3600 * 1000;

/// Difference between clock and running time in a round above which the clock counts as set.
const SET: i64 = 10 * 60 * 1000;

/// What a maintenance round knows of the time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Look {
    /// The clock, ms since 1970: the earlier one of this process's and the database's.
    pub now_ms: i64,
    /// A reading of the clock that every look since has confirmed, for a day of running time at least; ms since 1970.
    ///
    /// It lies one to two days of running time back. It is 0 in the first day of a store.
    pub settled_ms: i64,
    /// Time that the service was seen to run since the store was made, ms; downtime is not counted.
    pub ran_ms: i64,
    /// How much further the clock went than the time since the last look in this process, ms; 0 while the difference is small.
    pub jumped_ms: i64,
    /// Whether a day of running time begins with this look.
    pub begins_day: bool,
}

impl Look {
    /// The time `age` ago, RFC 3339.
    ///
    /// An age of a day and more is reckoned from the settled clock, so that what is older was old at two looks a day apart, and
    /// at all looks in between. A shorter age is reckoned from the clock as it is.
    pub(super) fn before(&self, age: Duration) -> String {
        let from = if age >= DAY { self.settled_ms } else { self.now_ms };
        time_before(from, age)
    }

    /// The time `age` ago by the clock as it is, RFC 3339.
    pub(super) fn plainly_before(&self, age: Duration) -> String {
        time_before(self.now_ms, age)
    }

    /// The running time `age` ago, ms.
    pub(super) fn ran_before(&self, age: Duration) -> i64 {
        self.ran_ms.saturating_sub(milliseconds(age))
    }

    /// The clock, RFC 3339.
    pub(super) fn now(&self) -> String {
        time_before(self.now_ms, Duration::ZERO)
    }
}

fn time_before(from_ms: i64, age: Duration) -> String {
    let then = from_ms.saturating_sub(milliseconds(age)).max(0);
    let then = OffsetDateTime::from_unix_timestamp_nanos(i128::from(then) * 1_000_000);
    rfc3339(then.unwrap_or(OffsetDateTime::UNIX_EPOCH))
}

pub(super) fn milliseconds(time: Duration) -> i64 {
    i64::try_from(time.as_millis()).unwrap_or(i64::MAX / 4)
}

/// The stored part of the clocks, ms.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Clocks {
    /// Running time.
    pub ran_ms: i64,
    /// See [`Look::settled_ms`].
    pub settled_at: i64,
    /// The next reading to settle, and the running time at which it was taken.
    pub noted: Option<(i64, i64)>,
}

impl Clocks {
    /// The clocks after a look at `now`, `elapsed_ms` of running time after the one before.
    pub(super) fn look(self, now: i64, elapsed_ms: i64) -> Self {
        let ran_ms = self.ran_ms.saturating_add(elapsed_ms.max(0));
        // A clock that went back was ahead before, so none of its readings since is confirmed.
        let settled_at = self.settled_at.min(now);
        let noted = self.noted.filter(|(reading, _)| *reading <= now);
        let (settled_at, noted) = match noted {
            Some((reading, at)) if ran_ms - at >= DAY_MS => (settled_at.max(reading), None),
            noted => (settled_at, noted),
        };
        Self { ran_ms, settled_at, noted: noted.or(Some((now, ran_ms))) }
    }
}

/// Clock and running time at the last look of this process.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub(super) now_ms: i64,
    at: Instant,
}

impl Seen {
    pub(super) fn now() -> Self {
        Self { now_ms: now_ms(), at: Instant::now() }
    }

    /// Running time until `later`, and how much further the clock went; 0 while that is little.
    pub(super) fn until(self, later: Self) -> (Duration, i64) {
        let elapsed = later.at.saturating_duration_since(self.at);
        let ahead = later.now_ms.saturating_sub(self.now_ms).saturating_sub(milliseconds(elapsed));
        (elapsed, if ahead.saturating_abs() > SET { ahead } else { 0 })
    }
}

/// The clock of this process, ms since 1970.
pub(super) fn now_ms() -> i64 {
    i64::try_from(OffsetDateTime::now_utc().unix_timestamp_nanos() / 1_000_000).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROUND: i64 = 600_000;
    const YEAR: i64 = 365 * DAY_MS;

    /// Clocks after rounds of ten minutes; `ahead` gives how far the clock is ahead at each running time, ms.
    fn after(days: i64, ahead: impl Fn(i64) -> i64) -> (Clocks, i64) {
        let (mut clocks, mut now) = (Clocks::default(), 0);
        for round in 1..=days * DAY_MS / ROUND {
            now = 100 * YEAR + round * ROUND + ahead(round * ROUND);
            clocks = clocks.look(now, ROUND);
        }
        (clocks, now)
    }

    #[test]
    fn the_settled_clock_follows_within_two_days() {
        assert_eq!(after(1, |_| 0).0.settled_at, 0, "nothing is known in the first day");
        let (clocks, now) = after(30, |_| 0);
        let behind = now - clocks.settled_at;
        assert!((DAY_MS..=2 * DAY_MS).contains(&behind), "{behind}");
        assert_eq!(clocks.ran_ms, 30 * DAY_MS);
    }

    #[test]
    fn a_clock_that_is_ahead_at_some_looks_settles_nothing() {
        for (name, ahead) in [
            ("once", (|ran| i64::from(ran == 20 * DAY_MS) * 400 * DAY_MS) as fn(i64) -> i64),
            ("every day", |ran| i64::from(ran % DAY_MS == 0) * 400 * DAY_MS),
            ("every week", |ran| i64::from(ran % (7 * DAY_MS) == 0) * 400 * DAY_MS),
            ("at every second look", |ran| (ran / ROUND % 2) * 400 * DAY_MS),
            ("for twenty hours", |ran| i64::from((100..220).contains(&(ran / ROUND))) * 400 * DAY_MS),
        ] {
            let (clocks, _) = after(30, ahead);
            let true_now = 100 * YEAR + 30 * DAY_MS;
            assert!(clocks.settled_at <= true_now - DAY_MS, "{name}: {}", clocks.settled_at - true_now);
        }
    }

    #[test]
    fn a_clock_that_stays_ahead_settles_after_a_day_and_one_that_goes_back_at_once() {
        let jump = |ran: i64| i64::from(ran > 10 * DAY_MS) * YEAR;
        let (clocks, now) = after(11, jump);
        assert!(now - clocks.settled_at > YEAR, "a day has not passed yet");
        let (clocks, now) = after(13, jump);
        assert!(now - clocks.settled_at <= 2 * DAY_MS);
        assert_eq!(clocks.look(now - YEAR, ROUND).settled_at, now - YEAR);
    }

    #[test]
    fn ages_of_a_day_and_more_are_reckoned_from_the_settled_clock() {
        let look = Look { now_ms: 20 * DAY_MS, settled_ms: 18 * DAY_MS, ran_ms: 7, jumped_ms: 0, begins_day: false };
        assert_eq!(look.before(DAY), "1970-01-18T00:00:00.000Z");
        assert_eq!(look.before(Duration::from_secs(1)), "1970-01-20T23:59:59.000Z");
        assert_eq!(look.plainly_before(DAY), "1970-01-20T00:00:00.000Z");
        assert_eq!(look.before(Duration::MAX), "1970-01-01T00:00:00.000Z");
    }
}

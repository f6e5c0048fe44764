//! The state machine of a job as one pure function.

use prosopon_store::JobState;

/// Event that changes the state of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobEvent {
    /// A worker claims the job.
    Start,
    /// The work ended with a result.
    Succeed,
    /// The work ended with a problem.
    Fail,
    /// The job was cancelled.
    Cancel,
    /// The worker stopped, lost its lease or lost the store.
    Interrupt,
    /// An interrupted job gets another attempt.
    Requeue,
    /// An interrupted job has used all its attempts.
    GiveUp,
}

impl JobEvent {
    /// Every event.
    pub const ALL: [Self; 7] =
        [Self::Start, Self::Succeed, Self::Fail, Self::Cancel, Self::Interrupt, Self::Requeue, Self::GiveUp];
}

/// The event is not allowed in this state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a job that is {state} cannot {event:?}")]
pub struct Illegal {
    /// State of the job.
    pub state: JobState,
    /// Event that is not allowed.
    pub event: JobEvent,
}

/// The state after `event`.
///
/// # Errors
/// [`Illegal`] when the event is not allowed in this state.
pub fn next(state: JobState, event: JobEvent) -> Result<JobState, Illegal> {
    use JobEvent as E;
    use JobState as S;
    match (state, event) {
        (S::Accepted, E::Start) => Ok(S::Running),
        (S::Running, E::Succeed) => Ok(S::Succeeded),
        (S::Running, E::Fail) | (S::Interrupted, E::GiveUp) => Ok(S::Failed),
        (S::Accepted | S::Running | S::Interrupted, E::Cancel) => Ok(S::Cancelled),
        (S::Running, E::Interrupt) => Ok(S::Interrupted),
        (S::Interrupted, E::Requeue) => Ok(S::Accepted),
        (S::Accepted, E::Succeed | E::Fail | E::Interrupt | E::Requeue | E::GiveUp)
        | (S::Running, E::Start | E::Requeue | E::GiveUp)
        | (S::Interrupted, E::Start | E::Succeed | E::Fail | E::Interrupt)
        | (S::Succeeded | S::Failed | S::Cancelled, _) => Err(Illegal { state, event }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_pairs_of_state_and_event_do_what_the_table_says() {
        use JobEvent as E;
        use JobState as S;
        let allowed = [
            (S::Accepted, E::Start, S::Running),
            (S::Accepted, E::Cancel, S::Cancelled),
            (S::Running, E::Succeed, S::Succeeded),
            (S::Running, E::Fail, S::Failed),
            (S::Running, E::Cancel, S::Cancelled),
            (S::Running, E::Interrupt, S::Interrupted),
            (S::Interrupted, E::Requeue, S::Accepted),
            (S::Interrupted, E::GiveUp, S::Failed),
            (S::Interrupted, E::Cancel, S::Cancelled),
        ];
        for state in S::ALL {
            for event in E::ALL {
                let expected = allowed.iter().find(|(s, e, _)| (*s, *e) == (state, event)).map(|(_, _, to)| *to);
                assert_eq!(next(state, event).ok(), expected, "{state} {event:?}");
            }
        }
    }

    #[test]
    fn nothing_happens_to_a_job_that_has_ended() {
        for state in JobState::ALL.into_iter().filter(|s| s.has_ended()) {
            assert!(JobEvent::ALL.iter().all(|event| next(state, *event).is_err()));
        }
    }
}

use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use tokio_util::sync::CancellationToken;

/// Time between two looks at the files.
const LOOK_EVERY: Duration = Duration::from_secs(5);

/// Files that are read again when they change.
#[derive(Debug)]
pub(super) struct Watch {
    files: Vec<PathBuf>,
    /// Times of the content that was read.
    read: Vec<Option<SystemTime>>,
    found: Vec<Option<SystemTime>>,
}

impl Watch {
    /// Watches files that have just been read.
    pub(super) fn new(files: Vec<PathBuf>) -> Self {
        let found = times(&files);
        Self { files, read: found.clone(), found }
    }

    /// Waits until the files differ from what was read; false when the service stops.
    pub(super) async fn changed(&mut self, stop: &CancellationToken) -> bool {
        loop {
            tokio::select! {
                () = tokio::time::sleep(LOOK_EVERY) => {}
                () = stop.cancelled() => return false,
            }
            self.found = times(&self.files);
            if self.found != self.read {
                return true;
            }
        }
    }

    /// Notes that the changed files have been read; otherwise they count as changed.
    pub(super) fn was_read(&mut self) {
        self.read.clone_from(&self.found);
    }
}

fn times(files: &[PathBuf]) -> Vec<Option<SystemTime>> {
    files.iter().map(|file| std::fs::metadata(file).and_then(|m| m.modified()).ok()).collect()
}

use std::any::Any;
use std::sync::{Arc, Mutex, PoisonError};

/// Cache of intermediate results by kind and key, with one memory limit.
///
/// The least recently used are evicted first.
///
/// An evicted result is rebuilt identically from stored inputs. The lock is never held during a computation: a thread of the CPU
/// pool that waits inside one computation may start another on the same stack. Two callers may therefore build the same result
/// at once; they get equal ones.
#[derive(Debug)]
pub(super) struct Recent {
    /// Entries; the most recently used is the last.
    entries: Mutex<Vec<Entry>>,
    most_bytes: u64,
}

#[derive(Debug)]
struct Entry {
    kind: &'static str,
    key: String,
    value: Arc<dyn Any + Send + Sync>,
    bytes: u64,
}

impl Recent {
    pub(super) fn new(most_bytes: u64) -> Self {
        Self { entries: Mutex::default(), most_bytes }
    }

    /// The result under `key`, which becomes the most recently used.
    pub(super) fn get<T: Send + Sync + 'static>(&self, kind: &'static str, key: &str) -> Option<Arc<T>> {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        let index = entries.iter().position(|e| e.kind == kind && e.key == key);
        let outcome = if index.is_some() { "hit" } else { "miss" };
        metrics::counter!("prosopon_cache_requests_total", "kind" => kind, "outcome" => outcome).increment(1);
        let entry = entries.remove(index?);
        let value = Arc::clone(&entry.value);
        entries.push(entry);
        value.downcast().ok()
    }

    /// Whether there is a result under `key`.
    pub(super) fn contains(&self, kind: &'static str, key: &str) -> bool {
        let entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        entries.iter().any(|e| e.kind == kind && e.key == key)
    }

    /// Stores `value` of about `bytes` and evicts the least recently used results above the limit.
    ///
    /// The new result stays, however large it is, because it is in use.
    pub(super) fn put<T: Send + Sync + 'static>(&self, kind: &'static str, key: &str, value: Arc<T>, bytes: u64) {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        entries.retain(|e| e.kind != kind || e.key != key);
        entries.push(Entry { kind, key: key.to_owned(), value, bytes });
        while entries.len() > 1 && entries.iter().map(|e| e.bytes).sum::<u64>() > self.most_bytes {
            let gone = entries.remove(0);
            metrics::counter!("prosopon_cache_evictions_total", "kind" => gone.kind).increment(1);
        }
        metrics::gauge!("prosopon_cache_bytes").set(entries.iter().map(|e| e.bytes).sum::<u64>() as f64);
    }

    /// Evicts all results of a kind before another one is built, when two would take too much memory.
    pub(super) fn let_go(&self, kind: &'static str) {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner).retain(|e| e.kind != kind);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_used_goes_first_when_memory_is_full() {
        let recent = Recent::new(100);
        recent.put("a", "1", Arc::new(1u8), 40);
        recent.put("b", "1", Arc::new("two"), 40);
        assert_eq!(recent.get::<u8>("a", "1").as_deref(), Some(&1));
        recent.put("a", "2", Arc::new(3u8), 40);
        assert!(recent.get::<&str>("b", "1").is_none(), "another kind's, but the oldest");
        assert!(recent.get::<u8>("a", "1").is_some() && recent.get::<u8>("a", "2").is_some());
        recent.put("b", "2", Arc::new("huge"), 1000);
        assert_eq!(recent.get::<&str>("b", "2").as_deref(), Some(&"huge"), "the youngest stays");
        assert!(recent.get::<u8>("a", "2").is_none());
        recent.let_go("b");
        assert!(recent.get::<&str>("b", "2").is_none());
    }
}

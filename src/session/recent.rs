use std::sync::{Arc, Mutex, PoisonError};

/// The last few results by key.
///
/// The lock is never held while something is computed: a thread of the CPU pool that waits inside one computation may
/// start another on the same stack. Two callers may therefore build the same thing at once; they get equal results.
#[derive(Debug)]
pub(super) struct Recent<T> {
    entries: Mutex<Vec<(String, Arc<T>)>>,
    capacity: usize,
}

impl<T> Recent<T> {
    pub(super) fn new(capacity: usize) -> Self {
        Self { entries: Mutex::new(Vec::new()), capacity }
    }

    /// What is kept under `key`, now the youngest.
    pub(super) fn get(&self, key: &str) -> Option<Arc<T>> {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        let index = entries.iter().position(|(k, _)| k == key)?;
        let entry = entries.remove(index);
        let value = Arc::clone(&entry.1);
        entries.push(entry);
        Some(value)
    }

    /// Keeps `value`; the oldest goes when there are too many.
    pub(super) fn put(&self, key: &str, value: Arc<T>) {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        entries.retain(|(k, _)| k != key);
        if entries.len() >= self.capacity {
            entries.remove(0);
        }
        entries.push((key.to_owned(), value));
    }

    /// Lets the oldest go where there is no room for one more, before something large is built.
    pub(super) fn make_room(&self) {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        if entries.len() >= self.capacity {
            entries.remove(0);
        }
    }

    /// What is kept under `key`, else what `build` makes.
    pub(super) fn get_or<E>(&self, key: &str, build: impl FnOnce() -> Result<T, E>) -> Result<Arc<T>, E> {
        if let Some(found) = self.get(key) {
            return Ok(found);
        }
        let built = Arc::new(build()?);
        self.put(key, Arc::clone(&built));
        Ok(built)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_used_goes_first() {
        let recent = Recent::new(2);
        recent.put("a", Arc::new(1));
        recent.put("b", Arc::new(2));
        assert_eq!(recent.get("a").as_deref(), Some(&1));
        recent.put("c", Arc::new(3));
        assert!(recent.get("b").is_none());
        assert_eq!(recent.get_or("a", || Err("not built again")).as_deref(), Ok(&1));
        recent.make_room();
        assert!(recent.get("c").is_none() && recent.get("a").is_some());
        assert_eq!(recent.get_or("d", || Err("failed")).err(), Some("failed"));
    }
}

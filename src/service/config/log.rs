use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;

/// Checks a log filter.
///
/// A bare word must be a level: the filter itself would take `inof` for a module name.
pub(super) fn check(level: &str) -> Result<(), String> {
    if level.trim().is_empty() {
        return Err("is empty; use `off` to log nothing".to_owned());
    }
    for part in level.split(',').map(str::trim) {
        let named = part.rsplit_once('=').map_or(part, |(_, level)| level);
        // The filter itself would accept an empty text as a level.
        if named.is_empty() || named.parse::<LevelFilter>().is_err() {
            return Err(format!("`{part}` is neither off, error, warn, info, debug, trace nor MODULE=LEVEL"));
        }
    }
    EnvFilter::try_new(level).map(|_| ()).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_those_of_the_filter_and_no_other_words() {
        for fine in ["info", "info,sqlx=warn", "off", "WARN", "prosopon_jobs=debug, info"] {
            assert_eq!(check(fine), Ok(()), "{fine}");
        }
        for faulty in ["inof", "", "info,,warn", "sqlx=loud", "info,sqlx", "="] {
            assert!(check(faulty).is_err(), "{faulty}");
        }
    }
}

use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;

/// What is wrong with a choice of what is logged. A bare word must be a level: the filter itself would take `inof` for the name of a module.
pub(super) fn check(level: &str) -> Result<(), String> {
    if level.trim().is_empty() {
        return Err("is empty; `off` logs nothing".to_owned());
    }
    for part in level.split(',').map(str::trim) {
        let named = part.rsplit_once('=').map_or(part, |(_, level)| level);
        // The filter takes nothing for a level.
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

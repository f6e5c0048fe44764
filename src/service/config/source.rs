use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use figment::providers::{Env, Format, Serialized, Toml};
use figment::value::{Dict, Value};
use figment::{Figment, Metadata};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// `PROSOPON_…` variables that are not settings.
const NO_SETTINGS: [&str; 1] = ["config"];

/// Settings from a TOML file, `PROSOPON_…` variables and flags; later sources override earlier ones.
///
/// It collects all faults, and the settings that were used, for printing.
#[derive(Debug)]
pub(super) struct Source {
    figment: Figment,
    asked: BTreeSet<&'static str>,
    pub(super) faults: Vec<String>,
    /// Path and printed value of each setting, in the order of reading.
    pub(super) used: Vec<(&'static str, String)>,
}

impl Source {
    pub(super) fn new(file: Option<&Path>, flags: &BTreeMap<&'static str, Value>) -> Self {
        let mut figment = Figment::new();
        if let Some(file) = file {
            figment = figment.merge(Toml::file_exact(file));
        }
        let standard = Env::raw().only(&["OTEL_EXPORTER_OTLP_ENDPOINT"]);
        figment = figment.join(standard.map(|_| "otlp.endpoint".into()));
        figment = figment.merge(Env::prefixed("PROSOPON_").split("__").ignore(&NO_SETTINGS));
        for (path, value) in flags {
            figment = figment.merge(Serialized::default(path, value));
        }
        Self { figment, asked: BTreeSet::new(), faults: Vec::new(), used: Vec::new() }
    }

    /// The value at `path`, or `default`.
    pub(super) fn take<T: DeserializeOwned + Serialize>(&mut self, path: &'static str, default: T) -> T {
        let value = self.optional(path);
        let taken = value.unwrap_or(default);
        self.show(path, &taken);
        taken
    }

    /// The value at `path`, if there is one.
    pub(super) fn take_optional<T: DeserializeOwned + Serialize>(&mut self, path: &'static str) -> Option<T> {
        let taken = self.optional(path);
        if let Some(taken) = &taken {
            self.show(path, taken);
        }
        taken
    }

    /// The value at `path`, which contains secrets: it is not printed, and faults do not quote it.
    pub(super) fn take_hidden<T: DeserializeOwned>(&mut self, path: &'static str, expected: &str) -> Option<T> {
        self.asked.insert(path);
        let taken = self.figment.find_value(path).ok()?.deserialize().ok();
        if taken.is_none() {
            self.fault(path, &format!("is not {expected}"));
        }
        taken
    }

    /// Records a value for printing.
    ///
    /// Settings are numbers, texts and lists of texts, whose JSON form is valid TOML.
    pub(super) fn show(&mut self, path: &'static str, value: &impl Serialize) {
        self.used.push((path, serde_json::to_string(value).unwrap_or_else(|error| format!("# {error}"))));
    }

    fn optional<T: DeserializeOwned>(&mut self, path: &'static str) -> Option<T> {
        self.asked.insert(path);
        let value = self.figment.find_value(path).ok()?;
        match value.deserialize() {
            Ok(value) => Some(value),
            Err(error) => {
                self.fault(path, &error.kind.to_string());
                None
            }
        }
    }

    /// Adds a fault, with the source of the value.
    pub(super) fn fault(&mut self, path: &str, detail: &str) {
        let from = self.figment.find_metadata(path).map(origin).unwrap_or_default();
        self.faults.push(format!("{path}: {detail}{from}"));
    }

    /// The faults of a file that cannot be read; `None` if it can.
    pub(super) fn unreadable(&self) -> Option<Vec<String>> {
        let faults = self.figment.extract::<Dict>().err()?;
        let reported = |error: figment::Error| {
            let from = error.metadata.as_ref().map(origin).unwrap_or_default();
            format!("{}{from}", without_source(&error.kind.to_string()))
        };
        Some(faults.into_iter().map(reported).collect())
    }

    /// Adds a fault for every given value that is not a setting.
    pub(super) fn finish(&mut self) {
        let Ok(all) = self.figment.extract::<Dict>() else { return };
        let mut leaves = Vec::new();
        leaves_of(&all, "", &mut leaves);
        for leaf in leaves {
            let known = |asked: &&str| leaf == **asked || leaf.starts_with(&format!("{asked}."));
            if !self.asked.iter().any(known) {
                self.fault(&leaf, "is not a setting; check its spelling");
            }
        }
    }
}

/// A parser's message without the lines that it quotes, which can contain secrets.
///
/// Quoted lines have a `|` behind their number.
fn without_source(text: &str) -> String {
    let quotes =
        |line: &&str| line.trim_start().trim_start_matches(|c: char| c.is_ascii_digit()).trim_start().starts_with('|');
    text.lines().filter(|line| !quotes(line)).collect::<Vec<_>>().join(": ")
}

fn origin(metadata: &Metadata) -> String {
    match &metadata.source {
        // A location in the program's source code means that the value is a flag.
        Some(figment::Source::Code(_)) => " (command line)".to_owned(),
        Some(source) => format!(" ({} {source})", metadata.name),
        None => format!(" ({})", metadata.name),
    }
}

fn leaves_of(dict: &Dict, prefix: &str, leaves: &mut Vec<String>) {
    for (key, value) in dict {
        let path = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        if let Value::Dict(_, inner) = value {
            leaves_of(inner, &path, leaves);
        } else {
            leaves.push(path);
        }
    }
}

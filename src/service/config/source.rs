use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use figment::providers::{Env, Format, Serialized, Toml};
use figment::value::{Dict, Value};
use figment::{Figment, Metadata};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Values that are not settings although they begin like one.
const NO_SETTINGS: [&str; 1] = ["config"];

/// Settings from a TOML file, `PROSOPON_…` variables over it and flags over both. Every fault is collected; what was used can be printed.
#[derive(Debug)]
pub(super) struct Source {
    figment: Figment,
    asked: BTreeSet<&'static str>,
    pub(super) faults: Vec<String>,
    /// Path and value as printed, in the order of asking.
    pub(super) used: Vec<(&'static str, String)>,
}

impl Source {
    pub(super) fn new(file: Option<&Path>, flags: &BTreeMap<&'static str, Value>) -> Self {
        let mut figment = Figment::new();
        if let Some(file) = file {
            figment = figment.merge(Toml::file_exact(file));
        }
        if cfg!(feature = "otlp") {
            let standard = Env::raw().only(&["OTEL_EXPORTER_OTLP_ENDPOINT"]);
            figment = figment.join(standard.map(|_| "otlp.endpoint".into()));
        }
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

    /// The value at `path`, where there is one.
    pub(super) fn take_optional<T: DeserializeOwned + Serialize>(&mut self, path: &'static str) -> Option<T> {
        let taken = self.optional(path);
        if let Some(taken) = &taken {
            self.show(path, taken);
        }
        taken
    }

    /// The value at `path`, which holds secrets: it is not shown, and a fault does not quote it.
    pub(super) fn take_hidden<T: DeserializeOwned>(&mut self, path: &'static str, expected: &str) -> Option<T> {
        self.asked.insert(path);
        let taken = self.figment.find_value(path).ok()?.deserialize().ok();
        if taken.is_none() {
            self.fault(path, &format!("is not {expected}"));
        }
        taken
    }

    /// Settings are numbers, words and lists of words: as JSON they are TOML.
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

    /// A fault with where the value comes from.
    pub(super) fn fault(&mut self, path: &str, detail: &str) {
        let from = self.figment.find_metadata(path).map(origin).unwrap_or_default();
        self.faults.push(format!("{path}: {detail}{from}"));
    }

    /// What is wrong with a file that cannot be read.
    pub(super) fn unreadable(&self) -> Option<Vec<String>> {
        let faults = self.figment.extract::<Dict>().err()?;
        let told = |error: figment::Error| {
            let from = error.metadata.as_ref().map(origin).unwrap_or_default();
            format!("{}{from}", without_source(&error.kind.to_string()))
        };
        Some(faults.into_iter().map(told).collect())
    }

    /// Names what was given and never asked for.
    pub(super) fn finish(&mut self) {
        let Ok(all) = self.figment.extract::<Dict>() else { return };
        let mut leaves = Vec::new();
        leaves_of(&all, "", &mut leaves);
        for leaf in leaves {
            let known = |asked: &&str| leaf == **asked || leaf.starts_with(&format!("{asked}."));
            if !self.asked.iter().any(known) {
                self.fault(&leaf, "is not a setting");
            }
        }
    }
}

/// What a parser says without the line that it quotes, which may hold a secret: such lines have a `|` behind their number.
fn without_source(text: &str) -> String {
    let quotes =
        |line: &&str| line.trim_start().trim_start_matches(|c: char| c.is_ascii_digit()).trim_start().starts_with('|');
    text.lines().filter(|line| !quotes(line)).collect::<Vec<_>>().join(": ")
}

fn origin(metadata: &Metadata) -> String {
    match &metadata.source {
        // A place in this program's source.
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

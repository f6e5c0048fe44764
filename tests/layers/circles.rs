//! Circles of imports between the files of one package.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Path of a module from the package's root; the root is empty.
type Module = Vec<String>;

/// A path that a file names, and whether it is published with `pub use`.
struct Named {
    path: Vec<String>,
    published: bool,
}

fn module_of(file: &Path) -> Module {
    let mut names: Module =
        file.with_extension("").components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
    names.pop_if(|last| ["mod", "lib", "main"].contains(&last.as_str()));
    names
}

/// The paths of a use tree: `a::{b, c::d}` gives `a::b` and `a::c::d`.
fn leaves(tree: &str) -> Vec<Vec<String>> {
    let names = |text: &str| -> Vec<String> {
        let text = text.split(" as ").next().unwrap_or(text);
        text.split("::").map(|n| n.trim().to_owned()).filter(|n| !n.is_empty()).collect()
    };
    let Some((before, group)) = tree.split_once('{') else { return vec![names(tree)] };
    let group = group.rsplit_once('}').map_or(group, |(inside, _)| inside);
    let (mut found, mut depth, mut begin) = (Vec::new(), 0usize, 0);
    let ends = group.char_indices().chain([(group.len(), ',')]);
    for (at, c) in ends {
        match c {
            '{' => depth += 1,
            '}' => depth = depth.saturating_sub(1),
            ',' if depth == 0 => {
                let parts = leaves(group[begin..at].trim()).into_iter().filter(|p| !p.is_empty());
                found.extend(parts.map(|part| [names(before), part].concat()));
                begin = at + 1;
            }
            _ => {}
        }
    }
    found
}

/// Every path that begins with `crate`, `self` or `super`, in uses and elsewhere; without a leading `self`.
fn paths_named(text: &str) -> Vec<Named> {
    let mut found = Vec::new();
    for statement in text.split(';') {
        let Some((before, tree)) = statement.rsplit_once("use ") else { continue };
        let line = before.rsplit(['\n', '}']).next().unwrap_or("").trim();
        if line.is_empty() || line.starts_with("pub") {
            let published = line.starts_with("pub");
            found.extend(leaves(tree.trim()).into_iter().map(|path| Named { path, published }));
        }
    }
    for root in ["crate::", "self::", "super::"] {
        for (at, _) in text.match_indices(root) {
            let rest = &text[at..];
            let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_' && c != ':').unwrap_or(rest.len());
            // A group belongs to a use, which was read above.
            if rest[end..].starts_with('{') {
                continue;
            }
            found.extend(leaves(&rest[..end]).into_iter().map(|path| Named { path, published: false }));
        }
    }
    found
}

/// Where a path leads from `module`: the module's own path first, then the names below it.
fn absolute(module: &Module, path: &[String]) -> Module {
    let mut at = module.clone();
    let mut names = path;
    match names.first().map(String::as_str) {
        Some("crate") => (at, names) = (Module::new(), &names[1..]),
        Some("self") => names = &names[1..],
        _ => {}
    }
    while names.first().is_some_and(|n| n == "super") {
        at.pop();
        names = &names[1..];
    }
    [at, names.to_vec()].concat()
}

/// The files of a package with the files that each imports, both by module. A name that a module publishes counts for the file
/// that it comes from.
pub(crate) fn imports(files: &[(&Path, String)]) -> BTreeMap<Module, BTreeSet<Module>> {
    let named: BTreeMap<Module, Vec<Named>> =
        files.iter().map(|(file, text)| (module_of(file), paths_named(text))).collect();
    let owner = |path: &Module| (0..=path.len()).rev().map(|n| path[..n].to_vec()).find(|m| named.contains_key(m));
    let resolve = |module: &Module, path: &[String]| -> Option<Module> {
        let path = absolute(module, path);
        let found = owner(&path)?;
        let Some(name) = path.get(found.len()) else { return Some(found) };
        let mut published = named[&found].iter().filter(|n| n.published && n.path.last() == Some(name));
        published.next().and_then(|n| owner(&absolute(&found, &n.path))).or(Some(found))
    };
    let is_of_package = |n: &&Named| {
        let first = n.path.first().map(String::as_str);
        ["crate", "self", "super"].map(Some).contains(&first)
    };
    let edges = |module: &Module, paths: &[Named]| -> BTreeSet<Module> {
        let found = paths.iter().filter(is_of_package).filter_map(|n| resolve(module, &n.path));
        found.filter(|other| other != module).collect()
    };
    named.iter().map(|(module, paths)| (module.clone(), edges(module, paths))).collect()
}

/// The groups of files that import each other, directly or by others.
pub(crate) fn circles(imports: &BTreeMap<Module, BTreeSet<Module>>) -> Vec<Vec<String>> {
    let reach = |from: &Module| {
        let (mut seen, mut waiting) = (BTreeSet::new(), vec![from]);
        while let Some(module) = waiting.pop() {
            waiting.extend(imports.get(module).into_iter().flatten().filter(|next| seen.insert((*next).clone())));
        }
        seen
    };
    let reached: BTreeMap<&Module, BTreeSet<Module>> = imports.keys().map(|m| (m, reach(m))).collect();
    let mut found: BTreeSet<Vec<String>> = BTreeSet::new();
    for (module, seen) in &reached {
        if seen.contains(*module) {
            let group = seen.iter().filter(|other| reached.get(other).is_some_and(|s| s.contains(*module)));
            found.insert(group.map(|m| m.join("/")).collect());
        }
    }
    found.into_iter().collect()
}

/// The circles of a package whose files lie in `folder`.
pub(crate) fn circles_of(
    folder: &Path,
    files: &[std::path::PathBuf],
    production: impl Fn(&str) -> String,
) -> Vec<Vec<String>> {
    let read = |file: &std::path::PathBuf| production(&fs::read_to_string(folder.join(file)).unwrap());
    let texts: Vec<(&Path, String)> = files.iter().map(|f| (f.as_path(), read(f))).collect();
    circles(&imports(&texts))
}

#[test]
fn planted_circles_are_found_and_one_way_imports_are_none() {
    let of = |files: &[(&str, &str)]| {
        let files: Vec<(&Path, String)> = files.iter().map(|(f, t)| (Path::new(*f), (*t).to_owned())).collect();
        circles(&imports(&files))
    };
    let hub = ("room/mod.rs", "mod a;\nmod b;\npub use a::A;\npub use self::b::{B, C};\n");
    assert_eq!(of(&[hub, ("room/a.rs", "use super::b::B;"), ("room/b.rs", "pub struct B;")]), [[""; 0]; 0]);
    let circle = [["room/a", "room/b"]];
    assert_eq!(of(&[hub, ("room/a.rs", "use super::b::B;"), ("room/b.rs", "use super::a::{A};")]), circle);
    assert_eq!(of(&[hub, ("room/a.rs", "use crate::room::{b::B};"), ("room/b.rs", "fn f(a: super::A) {}")]), circle);
    assert_eq!(of(&[hub, ("room/a.rs", "use super::B;"), ("room/b.rs", "use super::A;")]), circle);
}

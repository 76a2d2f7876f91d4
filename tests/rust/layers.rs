//! The layers of `ekf_core`: what each module may import. A table is read from top to bottom: a module may import those
//! above it only, so that no circle can form; and no import may stand in it that the sources do not have.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

type Table = &'static [(&'static str, &'static [&'static str])];

/// Modules of the crate.
const CRATE: Table = &[
    ("chi2", &[]),
    ("error", &[]),
    ("stamps", &["error"]),
    ("math", &[]),
    ("performance", &[]),
    ("camera", &["error"]),
    ("settings", &["error"]),
    ("observe", &["math", "camera"]),
    ("graph", &["error", "math"]),
    ("gyroscope", &["math"]),
    ("submap_pnp", &["chi2", "error", "math", "camera"]),
    ("overlap", &["math", "camera", "settings"]),
    ("validate", &["chi2", "settings"]),
    ("nis_accumulator", &["error"]),
    ("map_frame", &["math", "observe"]),
    ("kernel", &["observe"]),
    ("state", &["error", "math", "observe", "kernel"]),
    ("scale", &["observe", "state"]),
    ("birth", &["math", "camera", "observe", "scale"]),
    ("gauge", &["math", "observe", "kernel", "state", "scale"]),
    ("local", &["error", "observe", "kernel", "state"]),
    (
        "view_planning",
        &["math", "camera", "observe", "state", "scale"],
    ),
    ("imu", &["error", "math", "stamps"]),
    ("predict", &["chi2", "math", "settings", "state", "imu"]),
    (
        "guard",
        &[
            "error", "math", "settings", "observe", "birth", "state", "predict",
        ],
    ),
    ("odometry", &["error", "math", "stamps", "predict", "guard"]),
    (
        "batch",
        &[
            "error", "observe", "validate", "kernel", "state", "gauge", "guard",
        ],
    ),
    (
        "filter",
        &[
            "error",
            "math",
            "camera",
            "settings",
            "observe",
            "overlap",
            "validate",
            "birth",
            "graph",
            "nis_accumulator",
            "map_frame",
            "kernel",
            "state",
            "gauge",
            "local",
            "scale",
            "view_planning",
            "predict",
            "guard",
            "batch",
            "odometry",
            "imu",
            "stamps",
            "chi2",
            "gyroscope",
        ],
    ),
];

/// Folders and files of the filter.
const FILTER: Table = &[
    ("input", &[]),
    ("memory", &[]),
    ("setup", &[]),
    ("workspace", &["input"]),
    ("ekf", &["memory", "setup", "workspace"]),
    ("checks", &["input", "ekf"]),
    ("predict", &["input", "memory", "ekf"]),
    ("worn", &["input", "memory", "ekf"]),
    ("births", &["input", "memory", "ekf"]),
    ("map", &["input", "memory", "ekf", "predict"]),
    ("persist", &["memory", "setup", "ekf"]),
    ("update", &["input", "ekf", "worn"]),
];

fn source(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(path)
}

/// Modules of a folder, each with its files.
fn modules(folder: &Path) -> BTreeMap<String, Vec<PathBuf>> {
    let mut found: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    for entry in fs::read_dir(folder).expect("a folder of the sources") {
        let path = entry.expect("an entry").path();
        let name = path.file_stem().expect("a name").to_string_lossy();
        if matches!(&*name, "lib" | "mod") {
            continue;
        }
        found
            .entry(name.into_owned())
            .or_default()
            .extend(files(&path));
    }
    found
}

fn files(path: &Path) -> Vec<PathBuf> {
    if !path.is_dir() {
        return vec![path.to_owned()];
    }
    let entries = fs::read_dir(path).expect("a folder of the sources");
    entries
        .flat_map(|entry| files(&entry.expect("an entry").path()))
        .filter(|path| path.file_name().is_some_and(|name| name != "tests.rs"))
        .collect()
}

/// The code of a file: without comments, and without its tests, which stand at the end.
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).expect("a source file");
    let code = text.split("#[cfg(test)]\nmod tests {").next();
    let lines = code.unwrap_or_default().lines();
    let lines = lines.map(|line| line.split("//").next().unwrap_or_default());
    lines.collect::<Vec<_>>().join("\n")
}

/// What follows `prefix::` in some code: `b` of `a::b::c`, `b` and `d` of `a::{b::c, d}`.
fn imports_after(code: &str, prefix: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (at, _) in code.match_indices(prefix) {
        let before = code[..at].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
            continue;
        }
        let rest = &code[at + prefix.len()..];
        let Some(list) = rest.strip_prefix('{') else {
            found.insert(name(rest));
            continue;
        };
        let (mut depth, mut start) = (1, 0);
        for (i, c) in list.char_indices() {
            depth += i32::from(c == '{') - i32::from(c == '}');
            if depth == 0 || (depth == 1 && c == ',') {
                found.insert(name(list[start..i].trim_start()));
                start = i + 1;
            }
            if depth == 0 {
                break;
            }
        }
    }
    found.remove("");
    found
}

fn name(text: &str) -> String {
    let end = text.find(|c: char| !(c.is_alphanumeric() || c == '_'));
    text[..end.unwrap_or(text.len())].into()
}

fn check(what: &str, table: Table, found: &BTreeMap<String, BTreeSet<String>>) {
    let known: BTreeSet<&str> = table.iter().map(|(module, _)| *module).collect();
    let modules: BTreeSet<&str> = found.keys().map(String::as_str).collect();
    assert_eq!(modules, known, "{what}: the modules and the table");
    for (k, (module, allowed)) in table.iter().enumerate() {
        for import in *allowed {
            let above = table[..k].iter().any(|(other, _)| other == import);
            assert!(above, "{what}: {import} must stand above {module}");
        }
        let imports: BTreeSet<&str> = found[*module].iter().map(String::as_str).collect();
        let allowed: BTreeSet<&str> = allowed.iter().copied().collect();
        assert_eq!(imports, allowed, "{what}: what {module} imports");
    }
}

#[test]
fn modules_import_what_is_below_them() {
    let modules = modules(&source(""));
    let imports = |(module, files): (&String, &Vec<PathBuf>)| {
        let all = files
            .iter()
            .flat_map(|file| imports_after(&code(file), "crate::"));
        let others = all.filter(|other| other != module);
        (module.clone(), others.collect())
    };
    check("ekf_core", CRATE, &modules.iter().map(imports).collect());
}

#[test]
fn folders_of_the_filter_import_what_is_below_them() {
    check("the filter", FILTER, &imports_among("ekf-core", "filter"));
    // The folder's own page re-exports and does nothing else, so that no import can go through it unseen.
    let page = code(&source("filter/mod.rs"));
    let statements = page.split(';').map(str::trim).filter(|s| !s.is_empty());
    for statement in statements {
        let kind = ["mod ", "pub mod ", "pub use "];
        assert!(kind.iter().any(|k| statement.starts_with(k)), "{statement}");
    }
}

/// What each module of a folder of a crate imports from the others there.
fn imports_among(krate: &str, folder: &str) -> BTreeMap<String, BTreeSet<String>> {
    let root = source("../..").join(krate).join("src");
    let modules = modules(&root.join(folder));
    let path: String = folder
        .split('/')
        .filter(|part| !part.is_empty())
        .fold(String::from("crate::"), |path, part| path + part + "::");
    let mut found = BTreeMap::new();
    for (module, files) in &modules {
        let mut imports = BTreeSet::new();
        for file in files {
            let code = code(file);
            imports.extend(imports_after(&code, &path));
            // From the folder itself, `super` is a module beside this one.
            if file.parent() == Some(&root.join(folder)) {
                imports.extend(imports_after(&code, "super::"));
            }
        }
        imports.retain(|import| import != module);
        found.insert(module.clone(), imports);
    }
    found
}

/// Folders of a crate that have modules, from its root on.
fn folders(krate: &str) -> Vec<String> {
    let root = source("../..").join(krate).join("src");
    let mut found = vec![String::new()];
    let mut k = 0;
    while k < found.len() {
        let entries = fs::read_dir(root.join(&found[k])).expect("a folder of the sources");
        let paths = entries.map(|entry| entry.expect("an entry").path());
        let mut inner: Vec<PathBuf> = paths.filter(|path| path.is_dir()).collect();
        inner.sort();
        let inner = inner.iter().map(|path| path.strip_prefix(&root));
        found.extend(inner.map(|path| path.expect("it is inside").display().to_string()));
        k += 1;
    }
    found
}

#[test]
fn no_modules_import_each_other_in_a_circle() {
    for krate in ["ekf-core", "frontend", "pycollab"] {
        for folder in folders(krate) {
            let mut open = imports_among(krate, &folder);
            // Modules that import nothing which is still open go, until all have gone or those of a circle are left.
            loop {
                let names: BTreeSet<String> = open.keys().cloned().collect();
                let before = open.len();
                open.retain(|_, imports| imports.iter().any(|import| names.contains(import)));
                if open.len() == before {
                    break;
                }
            }
            assert!(open.is_empty(), "{krate}/{folder}: in circles, {open:?}");
        }
    }
}

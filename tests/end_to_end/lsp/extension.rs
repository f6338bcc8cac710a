//! The extension for VS Code: its manifest, and its own tests where Node and its packages are installed.

use std::fs;
use std::process::Command;

use serde_json::Value as Json;

use crate::support::{skipped, succeed, workspace};

#[test]
fn the_manifest_has_version_and_license_of_depthloom() {
    let folder = workspace().join("editors/vscode");
    let text = |path: &str| fs::read_to_string(folder.join(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
    let version = env!("CARGO_PKG_VERSION");
    for file in ["package.json", "package-lock.json"] {
        let manifest: Json = serde_json::from_str(&text(file)).expect("JSON");
        assert_eq!(manifest["version"], version, "{file}");
    }
    let manifest: Json = serde_json::from_str(&text("package.json")).expect("JSON");
    assert_eq!(manifest["license"], "MIT OR Apache-2.0");
    let settings = manifest["contributes"]["configuration"]["properties"].as_object().expect("settings");
    let readme = text("README.md");
    let guide = fs::read_to_string(workspace().join("docs/how-to/editor.md")).expect("a page");
    for setting in settings.keys() {
        assert!(readme.contains(setting) && guide.contains(setting), "{setting} is not described");
    }
    for page in [&readme, &guide] {
        assert!(page.contains(&format!("depthloom-{version}.vsix")), "another version");
    }
    for license in ["LICENSE-MIT", "LICENSE-APACHE"] {
        assert_eq!(text(license), fs::read_to_string(workspace().join(license)).expect("a license"), "{license}");
    }
}

#[test]
fn the_extension_compiles_and_recognises_experiments() {
    let test = "lsp::extension::the_extension_compiles_and_recognises_experiments";
    let folder = workspace().join("editors/vscode");
    if !folder.join("node_modules/.bin/tsc").exists() {
        skipped(test, "the packages of editors/vscode are not installed (`npm ci` in that folder)");
        return;
    }
    succeed(Command::new("npm").args(["test", "--silent"]).current_dir(folder));
}

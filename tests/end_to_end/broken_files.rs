//! Broken experiment files: each has a snapshot of what the program prints. Files with errors of the language itself,
//! which need no node kinds of depthloom, are one folder above.

use crate::support::{depthloom, workspace};

#[test]
fn every_broken_file_is_explained() {
    let folder = workspace().join("tests/broken/program");
    let mut files: Vec<_> =
        std::fs::read_dir(&folder).expect("the folder").map(|e| e.expect("an entry").path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "yaml"));
    files.sort();
    assert!(files.len() >= 25, "{} broken files", files.len());
    for file in files {
        let name = file.file_stem().expect("a name").to_string_lossy().into_owned();
        // A line `# depthloom: ARGUMENTS` in the file adds arguments to the command.
        let text = std::fs::read_to_string(&file).unwrap_or_default();
        let arguments = text.lines().find_map(|line| line.strip_prefix("# depthloom: ")).unwrap_or_default();
        let output = depthloom()
            .current_dir(&folder)
            .arg("check")
            .arg(file.file_name().expect("a name"))
            .args(arguments.split_whitespace())
            .output()
            .expect("the binary starts");
        let stderr = String::from_utf8_lossy(&output.stderr).replace(&folder.display().to_string(), "<broken>");
        assert_eq!(output.status.code(), Some(2), "{name}: {stderr}");
        insta::with_settings!({ snapshot_path => "../broken/program", prepend_module_to_snapshot => false, omit_expression => true }, {
            insta::assert_snapshot!(name, stderr);
        });
    }
}

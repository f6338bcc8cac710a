//! The server in Neovim, without a screen.

use std::fs;
use std::path::Path;
use std::process::Command;

use super::EXPERIMENT;
use crate::support::{skipped, workspace};

/// Opens a file, and prints what the language server shows in it. From version 0.11 on, the lines of the guide start
/// the server.
const SCRIPT: &str = r#"
local file, guide = vim.env.EXPERIMENT, vim.env.GUIDE
local client
if vim.lsp.config then
  dofile(guide)
  vim.cmd("edit " .. vim.fn.fnameescape(file))
  assert(vim.wait(60000, function() return #vim.lsp.get_clients({ bufnr = 0 }) == 1 end, 20), "the server was not started")
  client = vim.lsp.get_clients({ bufnr = 0 })[1].id
  print("started by the lines of the guide")
else
  vim.cmd("edit " .. vim.fn.fnameescape(file))
  client = vim.lsp.start_client({ name = "depthloom", cmd = { "depthloom", "lsp" }, root_dir = vim.fn.fnamemodify(file, ":h") })
  vim.lsp.buf_attach_client(0, client)
end
assert(vim.wait(60000, function() return #vim.diagnostic.get(0) > 0 end, 20), "no diagnostics")
print("diagnostic: " .. vim.diagnostic.get(0)[1].message:match("[^\n]*"))

local function at(method, pattern, more)
  vim.fn.cursor(1, 1)
  assert(vim.fn.search(pattern, "c") > 0, pattern)
  local params = vim.tbl_extend("force", vim.lsp.util.make_position_params(0, "utf-16"), more or {})
  local responses = vim.lsp.buf_request_sync(0, method, params, 60000)
  return responses[client] and responses[client].result
end

-- The error is corrected in the buffer, and not saved.
vim.cmd([[%s/stereo\/sgmb/stereo\/sgbm/]])
assert(vim.wait(60000, function() return #vim.diagnostic.get(0) == 0 end, 20), "the diagnostic stays")
print("corrected")
print("hover: " .. at("textDocument/hover", "cap: 80").contents.value:match("[^\n]*"))
local labels = {}
for _, item in ipairs(at("textDocument/completion", "filter/median").items) do labels[item.label] = true end
print("completion: " .. tostring(labels["fusion/scale"]))
print("definition: line " .. at("textDocument/definition", "depth/depth }, with").range.start.line + 1)
local edit = at("textDocument/rename", "depth/depth }, with", { newName = "metres" })
vim.lsp.util.apply_workspace_edit(edit, "utf-16")
vim.cmd("write")
vim.cmd("qall!")
"#;

#[test]
fn neovim_shows_errors_completes_and_renames() {
    let test = "lsp::neovim::neovim_shows_errors_completes_and_renames";
    if !Command::new("nvim").arg("--version").output().is_ok_and(|output| output.status.success()) {
        skipped(test, "there is no nvim on the PATH");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let wrong = EXPERIMENT.replacen("      stereo: { kind: stereo/sgbm", "      stereo: { kind: stereo/sgmb", 1);
    fs::write(at("look.yaml"), wrong).expect("written");
    fs::write(at("script.lua"), SCRIPT).expect("written");
    let page = fs::read_to_string(workspace().join("docs/how-to/editor.md")).expect("a page");
    let (_, lines) = page.split_once("```lua\n").expect("lines for Neovim");
    fs::write(at("guide.lua"), lines.split_once("```").expect("their end").0).expect("written");
    let program = Path::new(env!("CARGO_BIN_EXE_depthloom")).parent().expect("a folder");
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::iter::once(program.to_owned()).chain(std::env::split_paths(&path));
    let mut neovim = Command::new("nvim");
    neovim.args(["--headless", "--clean", "-n", "-c"]).arg(format!("luafile {}", at("script.lua").display()));
    neovim.args(["-c", "cquit 1"]).env("EXPERIMENT", at("look.yaml")).env("GUIDE", at("guide.lua"));
    neovim.env("PATH", std::env::join_paths(folders).expect("folders"));
    let output = neovim.env("HOME", folder.path()).env("XDG_STATE_HOME", folder.path()).output().expect("it starts");
    let printed = String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{printed}");
    let line = EXPERIMENT.lines().position(|line| line == "      depth:").expect("a node") + 1;
    for expected in
        ["diagnostic: ", "corrected", "hover: **cap**: number", "completion: true", &format!("definition: line {line}")]
    {
        assert!(printed.contains(expected), "{expected}: {printed}");
    }
    let renamed = fs::read_to_string(at("look.yaml")).expect("written");
    assert!(renamed.contains("smooth: { kind: filter/median, inputs: { depth: metres/depth }"), "{renamed}");
    assert!(renamed.contains("far: { second.metres.with.cap: 120 }"), "{renamed}");
}

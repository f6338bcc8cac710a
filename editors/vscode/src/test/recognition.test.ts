import assert from "node:assert/strict";
import { test } from "node:test";
import { isExperiment, programOf } from "../recognition";

test("experiments are recognised by their first key or their schema", () => {
  const experiments = [
    "experiment: a\n",
    "\uFEFF# a comment\n\n---\nexperiment: a\n",
    "'experiment' : a",
    "# yaml-language-server: $schema=../experiment.schema.json\nextends: base.yaml\n",
    "# yaml-language-server: $schema=experiment.schema.json\r\nextends: base.yaml\r\n",
  ];
  for (const text of experiments) {
    assert.ok(isExperiment(text), text);
  }
  for (const text of ["", "name: ci\non: push\n", "a:\n  experiment: b\n", "experiments: []\n", "# experiment: a\nb: c\n"]) {
    assert.ok(!isExperiment(text), text);
  }
});

test("the home folder is replaced", () => {
  assert.equal(programOf("~/bin/depthloom", "/home/me"), "/home/me/bin/depthloom");
  assert.equal(programOf(" depthloom ", "/home/me"), "depthloom");
  assert.equal(programOf("", "/home/me"), "depthloom");
  assert.equal(programOf("~other/x", "/home/me"), "~other/x");
});

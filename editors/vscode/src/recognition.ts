// Which YAML files are experiments of depthloom.

/** The number of lines that are searched for the comment that names the schema. */
const FIRST_LINES = 10;

/** Whether a YAML text is an experiment: its first key is `experiment`, or its first lines name the schema. */
export function isExperiment(text: string): boolean {
  const lines = text.replace(/^\uFEFF/, "").split(/\r\n|\r|\n/);
  const names = lines.slice(0, FIRST_LINES).some((line) => /^#.*\$schema=.*\bexperiment\.schema\.json\b/.test(line));
  const first = lines.find((line) => line.trim() !== "" && !line.startsWith("#") && !line.startsWith("---"));
  return names || (first !== undefined && /^["']?experiment["']?\s*:/.test(first));
}

/** The program to start, with `~` replaced by the home folder. */
export function programOf(setting: string, home: string): string {
  const program = setting.trim();
  if (program === "") {
    return "depthloom";
  }
  return program === "~" || program.startsWith("~/") ? home + program.slice(1) : program;
}

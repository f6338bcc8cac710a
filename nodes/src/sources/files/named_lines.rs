//! Calibration texts: one name and its values per line.

use std::path::Path;

use depthloom_graphs::Fault;

use crate::sources::files::shortened;

pub(crate) struct NamedLines<'a> {
    path: &'a Path,
    /// Describes a correct file; the remedy of all faults.
    expected: &'static str,
    separator: char,
    /// Line number, name, values.
    lines: Vec<(usize, String, String)>,
}

impl<'a> NamedLines<'a> {
    /// Splits lines at their first separator; every line must have one if it is a colon.
    pub(crate) fn parse(path: &'a Path, text: &str, separator: char, expected: &'static str) -> Result<Self, Fault> {
        let mut found = Self { path, expected, separator, lines: Vec::new() };
        for (line, content) in (1..).zip(text.lines().map(str::trim)).filter(|(_, content)| !content.is_empty()) {
            match content.split_once(separator) {
                Some((name, values)) => found.lines.push((line, name.trim().to_owned(), values.trim().to_owned())),
                None if separator == ':' => {
                    let what = format!("`{}` has no `:` after a name", shortened(content));
                    return Err(found.fault(Some(line), what));
                }
                None => {}
            }
        }
        Ok(found)
    }

    pub(crate) fn fault(&self, line: Option<usize>, what: impl std::fmt::Display) -> Fault {
        let path = self.path.display();
        let place = line.map_or_else(|| path.to_string(), |line| format!("{path}:{line}"));
        Fault::new(format!("{place}: {what}")).remedy(self.expected)
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.lines.iter().any(|(_, other, _)| other == name)
    }

    /// The last line of that name, with its number.
    pub(crate) fn value(&self, name: &str) -> Result<(usize, &str), Fault> {
        let found = self.lines.iter().rev().find(|(_, other, _)| other == name);
        found.map(|(line, _, values)| (*line, values.as_str())).ok_or_else(|| {
            let equals = if self.separator == '=' { "=" } else { "" };
            self.fault(None, format!("there is no line `{name}{equals}`"))
        })
    }

    pub(crate) fn parse_number(&self, line: usize, name: &str, text: &str) -> Result<f64, Fault> {
        let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
        let text = shortened(text);
        number.ok_or_else(|| self.fault(Some(line), format!("{name} holds `{text}`, which is not a number")))
    }

    pub(crate) fn number(&self, name: &str) -> Result<(usize, f64), Fault> {
        let (line, text) = self.value(name)?;
        Ok((line, self.parse_number(line, name, text)?))
    }

    /// Exactly `N` numbers, with the line's number.
    pub(crate) fn numbers<const N: usize>(&self, name: &str) -> Result<(usize, [f64; N]), Fault> {
        let (line, values) = self.value(name)?;
        let numbers = values.split_whitespace().map(|text| self.parse_number(line, name, text));
        let numbers: Vec<f64> = numbers.collect::<Result<_, _>>()?;
        let count = numbers.len();
        let expected = if N == 12 { "the 12 of a 3x4 matrix".to_owned() } else { N.to_string() };
        let numbers = numbers.try_into();
        let wrong = |_| self.fault(Some(line), format!("{name} holds {count} numbers, expected {expected}"));
        Ok((line, numbers.map_err(wrong)?))
    }
}

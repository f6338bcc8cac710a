//! Numbers in free-form parameters of programs. They have no type, so those that would arrive as another value are
//! refused here.

use serde_json::Value as Json;

use super::schema_check::is_infinite;
use super::with_schema::property;
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::tree::{Node, Tree};

/// Reports numbers in free-form parameters (`additionalProperties: true`) that a program would read as another value.
pub(crate) fn check(node: &Node, schema: &Json, report: &mut Report) {
    match &node.value {
        Tree::Map(entries) => {
            for entry in entries {
                let schema = if is_free(schema) { schema } else { property(schema, &entry.key).unwrap_or(&Json::Null) };
                check(&entry.value, schema, report);
            }
        }
        Tree::List(items) if is_free(schema) => items.iter().for_each(|item| check(item, schema, report)),
        Tree::Number(_) | Tree::Text(_) if is_free(schema) => {
            let written = node.written.as_ref().map_or_else(|| node.place.text(), |written| written.value.as_str());
            if let Some((what, help)) = problem(written.trim(), &node.value) {
                report.push(Diagnostic::error(&node.place, format!("`{}` {what}", written.trim())).help(help));
            }
        }
        Tree::Null | Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) | Tree::List(_) => {}
    }
}

fn is_free(schema: &Json) -> bool {
    *schema == Json::Bool(true)
}

fn problem(written: &str, value: &Tree) -> Option<(&'static str, &'static str)> {
    const QUOTES: &str = "put it in quotes to pass it as text";
    let digits = written.strip_prefix(['+', '-']).unwrap_or(written);
    let is_number =
        digits.starts_with(|c: char| c.is_ascii_digit() || c == '.') && digits.contains(|c: char| c.is_ascii_digit());
    match value {
        Tree::Number(number) if number.is_f64() && digits.bytes().all(|byte| byte.is_ascii_digit()) => {
            Some(("is an integer beyond 64 bits", QUOTES))
        }
        Tree::Number(number)
            if number.as_f64() == Some(0.0) && mantissa(digits).contains(|c| ('1'..='9').contains(&c)) =>
        {
            Some(("is closer to 0 than any number of 64 bits", QUOTES))
        }
        Tree::Text(_) if is_infinite(written) => Some((
            "cannot be passed to a program: numbers are finite",
            "leave it out, or put it in quotes to pass it as text",
        )),
        Tree::Text(_) if is_number && written.parse().is_ok_and(f64::is_infinite) => {
            Some(("is beyond the largest number of 64 bits", QUOTES))
        }
        _ => None,
    }
}

/// The digits before the exponent; empty for hexadecimal numbers.
fn mantissa(digits: &str) -> &str {
    let is_decimal = digits.bytes().all(|byte| byte.is_ascii_digit() || b".eE+-".contains(&byte));
    if is_decimal { digits.split(['e', 'E']).next().unwrap_or_default() } else { "" }
}

#[cfg(test)]
mod tests {
    use serde_json::Number;

    use super::problem;
    use crate::language::text::tree::Tree;

    #[test]
    fn numbers_that_would_arrive_as_others_are_refused() {
        let number = |number: f64| Tree::Number(Number::from_f64(number).expect("finite"));
        let text = |text: &str| Tree::Text(text.to_owned());
        let refused = [
            ("18446744073709551616", number(18_446_744_073_709_551_616.0), "beyond 64 bits"),
            ("-99999999999999999999", number(-1e20), "beyond 64 bits"),
            ("1e400", text(".inf"), "beyond the largest"),
            ("-1.5e999", text("-1.5e999"), "beyond the largest"),
            (".nan", text(".nan"), "numbers are finite"),
            ("-.INF", text("-.inf"), "numbers are finite"),
            ("1e-400", number(0.0), "closer to 0"),
        ];
        for (written, value, expected) in refused {
            let (what, _) = problem(written, &value).unwrap_or_else(|| panic!("{written} is allowed"));
            assert!(what.contains(expected), "{written}: {what}");
        }
        let allowed = [
            ("1e20", number(1e20)),
            ("18446744073709551615", Tree::Number(u64::MAX.into())),
            ("-9223372036854775808", Tree::Number(i64::MIN.into())),
            ("0.0", number(0.0)),
            ("-0e5", number(0.0)),
            ("\".nan\"", text(".nan")),
            ("'1e400'", text("1e400")),
            ("inf", text("inf")),
            ("nano", text("nano")),
            ("1e400x", text("1e400x")),
        ];
        for (written, value) in allowed {
            assert_eq!(problem(written, &value), None, "{written}");
        }
    }
}

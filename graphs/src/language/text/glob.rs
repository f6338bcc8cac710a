//! Patterns with `*`.

/// Whether a text matches a pattern, in which `*` stands for any characters.
pub fn glob(pattern: &str, text: &str) -> bool {
    let Some((first, rest)) = pattern.split_once('*') else { return pattern == text };
    let Some(mut text) = text.strip_prefix(first) else { return false };
    let mut parts: Vec<&str> = rest.split('*').collect();
    let last = parts.pop().unwrap_or_default();
    for part in parts {
        // The earliest place leaves the most for what follows.
        let Some(at) = text.find(part) else { return false };
        text = &text[at + part.len()..];
    }
    text.ends_with(last)
}

#[cfg(test)]
mod tests {
    use super::glob;

    #[test]
    fn stars_stand_for_any_run_of_characters() {
        for (pattern, text) in
            [("*", "depth"), ("de*", "depth"), ("*th", "depth"), ("d*p*h", "depth"), ("depth", "depth"), ("**", "")]
        {
            assert!(glob(pattern, text), "{pattern} {text}");
        }
        for (pattern, text) in [("d", "depth"), ("*x", "depth"), ("dep*pth", "depth"), ("", "depth")] {
            assert!(!glob(pattern, text), "{pattern} {text}");
        }
    }
}

//! `file:` addresses and paths.

use std::path::{Path, PathBuf};

use gen_lsp_types::Uri;

const FILE: &str = "file://";

/// The path of a document. A document without a file (`untitled:`) has its address as its path.
pub(crate) fn path(uri: &Uri) -> PathBuf {
    match uri.0.strip_prefix(FILE) {
        Some(rest) => PathBuf::from(decoded(&rest[rest.find('/').unwrap_or(0)..])),
        None => PathBuf::from(&uri.0),
    }
}

/// The address of a file.
pub(crate) fn uri(path: &Path) -> Uri {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut text = FILE.to_owned();
    for byte in absolute.as_os_str().as_encoded_bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'/' | b'-' | b'_' | b'.' | b'~' => text.push(char::from(*byte)),
            other => text.push_str(&format!("%{other:02X}")),
        }
    }
    Uri(text)
}

fn decoded(text: &str) -> String {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((first, after)) = rest.split_first() {
        let code = after.get(..2).and_then(|code| u8::from_str_radix(std::str::from_utf8(code).ok()?, 16).ok());
        match code.filter(|_| *first == b'%') {
            Some(code) => {
                bytes.push(code);
                rest = &after[2..];
            }
            None => {
                bytes.push(*first);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use gen_lsp_types::Uri;

    use super::{path, uri};

    #[test]
    fn paths_survive_the_way_to_an_address_and_back() {
        for written in ["/data/a b.yaml", "/data/ä%25.yaml", "/x/100%.yaml"] {
            assert_eq!(path(&uri(Path::new(written))), PathBuf::from(written));
        }
        assert_eq!(uri(Path::new("/a b/ä.yaml")), Uri("file:///a%20b/%C3%A4.yaml".to_owned()));
        assert_eq!(path(&Uri("file://localhost/a%20b.yaml".to_owned())), PathBuf::from("/a b.yaml"));
        assert_eq!(path(&Uri("untitled:Untitled-1".to_owned())), PathBuf::from("untitled:Untitled-1"));
    }
}

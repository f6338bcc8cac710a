//! Messages on the streams. A broken message is reported, and the next one is read.

use std::io::{self, BufRead, Read as _};

use lsp_server::Message;

/// The largest message that is read, in bytes. An experiment has at most 4 MiB.
const LARGEST: u64 = 64 << 20;
const LONGEST_LINE: u64 = 4096;

/// What the client sent.
#[derive(Debug)]
pub(crate) enum Incoming {
    Message(Message),
    /// Why it is not a message.
    Broken(String),
}

/// The next message; `None` after the last one.
///
/// # Errors
/// If the stream cannot be read.
pub(crate) fn read(input: &mut impl BufRead) -> io::Result<Option<Incoming>> {
    let mut length = None;
    let mut has_header = false;
    loop {
        let mut line = Vec::new();
        if input.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut line)? == 0 {
            return Ok(None);
        }
        let line = String::from_utf8_lossy(&line);
        let line = line.trim();
        if line.is_empty() {
            if has_header {
                break;
            }
            continue;
        }
        has_header = true;
        if let Some((name, value)) = line.split_once(':')
            && name.trim().eq_ignore_ascii_case("content-length")
        {
            length = value.trim().parse::<u64>().ok();
        }
    }
    let Some(length) = length else {
        return Ok(Some(Incoming::Broken("a message without the header `Content-Length`".to_owned())));
    };
    if length > LARGEST {
        io::copy(&mut input.take(length), &mut io::sink())?;
        let what = format!("a message of {length} bytes; at most {LARGEST} are read");
        return Ok(Some(Incoming::Broken(what)));
    }
    let mut body = Vec::new();
    if input.take(length).read_to_end(&mut body)? as u64 != length {
        return Ok(None);
    }
    Ok(Some(match serde_json::from_slice(&body) {
        Ok(message) => Incoming::Message(message),
        Err(error) => Incoming::Broken(format!("a message that is not JSON-RPC: {error}")),
    }))
}

#[cfg(test)]
mod tests {
    use super::{Incoming, read};

    #[test]
    fn a_broken_message_does_not_hide_the_next() {
        let good = r#"{"jsonrpc":"2.0","method":"exit"}"#;
        let framed = |body: &str| format!("Content-Length: {}\r\n\r\n{body}", body.len());
        for bad in [
            framed("{not json"),
            framed("[1, 2]"),
            framed("\u{fffd}"),
            "Content-Type: text\r\n\r\n".to_owned(),
            "Content-Length: many\r\n\r\n".to_owned(),
            "nonsense\n\n".to_owned(),
        ] {
            let stream = format!("{bad}{}", framed(good));
            let mut input = stream.as_bytes();
            assert!(matches!(read(&mut input), Ok(Some(Incoming::Broken(_)))), "{bad:?}");
            assert!(matches!(read(&mut input), Ok(Some(Incoming::Message(_)))), "{bad:?}");
            assert!(matches!(read(&mut input), Ok(None)), "{bad:?}");
        }
    }

    #[test]
    fn the_end_of_the_stream_within_a_message_is_the_end() {
        assert!(matches!(read(&mut "Content-Length: 100\r\n\r\n{}".as_bytes()), Ok(None)));
        assert!(matches!(read(&mut "Content-Len".as_bytes()), Ok(None)));
    }
}

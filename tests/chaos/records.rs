//! The records of an MCAP file, read by its specification alone: independent of what is tested.

/// A record.
pub(crate) struct Record<'a> {
    pub opcode: u8,
    pub body: &'a [u8],
    /// Where the next one begins.
    pub end: usize,
}

const MAGIC: usize = 8;
const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const ATTACHMENT: u8 = 9;
const METADATA: u8 = 0x0c;
const DATA_END: u8 = 0x0f;

/// The whole records of the data section.
pub(crate) fn records(file: &[u8]) -> Vec<Record<'_>> {
    let mut found = Vec::new();
    let mut at = MAGIC;
    while let Some(header) = file.get(at..at + 9) {
        let length = u64::from_le_bytes(header[1..].try_into().expect("eight bytes"));
        let Some(end) = usize::try_from(length).ok().and_then(|length| (at + 9).checked_add(length)) else { break };
        let Some(body) = file.get(at + 9..end) else { break };
        found.push(Record { opcode: header[0], body, end });
        if header[0] == DATA_END {
            break;
        }
        at = end;
    }
    found
}

/// A text with its length before it, and what follows.
fn text(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    let (text, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    Some((std::str::from_utf8(text).ok()?, rest))
}

fn number(bytes: &[u8]) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.first_chunk()?))
}

/// Where each whole frame ends: behind the chunk with its commit. The index behind it adds nothing that is not in it.
pub(crate) fn commits(file: &[u8]) -> Vec<usize> {
    let (mut schema, mut channels, mut ends) = (None, Vec::new(), Vec::new());
    for record in records(file) {
        match record.opcode {
            SCHEMA if record.body.get(2..).and_then(text).is_some_and(|(name, _)| name == "depthloom.Commit") => {
                schema = number(record.body);
            }
            CHANNEL if schema.is_some() && record.body.get(2..).and_then(number) == schema => {
                channels.extend(number(record.body));
            }
            CHUNK if first_channel(record.body).is_some_and(|channel| channels.contains(&channel)) => {
                ends.push(record.end);
            }
            _ => {}
        }
    }
    ends
}

/// The channel of the first message of an uncompressed chunk.
fn first_channel(chunk: &[u8]) -> Option<u16> {
    // Behind two times, a size and a checksum; before the messages, how long they are.
    let ("", rest) = text(chunk.get(28..)?)? else { return None };
    let message = rest.get(8..)?;
    (*message.first()? == MESSAGE).then(|| number(message.get(9..)?)).flatten()
}

/// Where what a report shows may change: behind the frames, and behind what stands outside them.
pub(crate) fn steps(file: &[u8]) -> Vec<usize> {
    let outside = records(file).into_iter().filter(|record| matches!(record.opcode, METADATA | ATTACHMENT));
    let mut ends: Vec<usize> = outside.map(|record| record.end).chain(commits(file)).collect();
    ends.sort_unstable();
    ends
}

/// The content of the first attachment of a media type.
pub(crate) fn attachment<'a>(file: &'a [u8], media_type: &str) -> Option<&'a [u8]> {
    records(file).into_iter().filter(|record| record.opcode == ATTACHMENT).find_map(|record| {
        let (_, rest) = text(record.body.get(16..)?)?;
        let (found, rest) = text(rest)?;
        let (length, rest) = rest.split_first_chunk::<8>()?;
        (found == media_type).then(|| rest.get(..u64::from_le_bytes(*length) as usize)).flatten()
    })
}

//! A record of an MCAP file, once its texts are seen to end within it: the crate `mcap` takes as much memory for a text as its length says.

use mcap::records::{Record, op};

/// A field of a record, as far as it must be stepped over.
#[derive(Clone, Copy)]
enum Field {
    /// So many bytes.
    Fixed(usize),
    /// Four bytes that say how many follow: a text, or a map without texts.
    Counted,
    /// Likewise, of texts by twos.
    Texts,
}

/// The record of these bytes, behind opcode and length; `None` if it is none.
pub fn parse(opcode: u8, body: &[u8]) -> Option<Record<'_>> {
    use Field::{Counted, Fixed, Texts};
    let fields: &[Field] = match opcode {
        op::HEADER => &[Counted, Counted],
        op::SCHEMA => &[Fixed(2), Counted, Counted, Counted],
        op::CHANNEL => &[Fixed(4), Counted, Counted, Texts],
        op::CHUNK => &[Fixed(28), Counted, Fixed(8)],
        op::MESSAGE_INDEX => &[Fixed(2), Counted],
        op::CHUNK_INDEX => &[Fixed(32), Counted, Fixed(8), Counted, Fixed(16)],
        op::STATISTICS => &[Fixed(42), Counted],
        _ => return None,
    };
    let mut rest = body;
    for field in fields {
        let content = step(&mut rest, *field)?;
        if matches!(field, Texts) {
            let mut texts = content;
            while !texts.is_empty() {
                step(&mut texts, Counted)?;
            }
        }
    }
    mcap::parse_record(opcode, body).ok()
}

/// Steps over a field, and gives what it holds.
fn step<'a>(rest: &mut &'a [u8], field: Field) -> Option<&'a [u8]> {
    let length = match field {
        Field::Fixed(length) => length,
        Field::Counted | Field::Texts => {
            let (length, behind) = rest.split_first_chunk()?;
            *rest = behind;
            usize::try_from(u32::from_le_bytes(*length)).ok()?
        }
    };
    let (content, behind) = rest.split_at_checked(length)?;
    *rest = behind;
    Some(content)
}

#[cfg(test)]
mod tests {
    use mcap::records::{Record, op};

    use super::parse;

    fn text(text: &str) -> Vec<u8> {
        [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
    }

    #[test]
    fn a_text_that_ends_behind_its_record_is_refused_before_it_is_made() {
        let schema = [&[7, 0][..], &text("std_msgs/msg/String"), &text("ros2msg"), &text("string data")].concat();
        assert!(matches!(parse(op::SCHEMA, &schema), Some(Record::Schema { header, .. }) if header.id == 7));
        let mut lying = schema;
        lying[2..6].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(parse(op::SCHEMA, &lying).is_none());
        let pairs = [text("a"), text("b")].concat();
        let map = [&(pairs.len() as u32).to_le_bytes()[..], &pairs].concat();
        let channel = [&[1, 0, 7, 0][..], &text("/chatter"), &text("cdr"), &map].concat();
        assert!(matches!(parse(op::CHANNEL, &channel), Some(Record::Channel(_))));
        let mut lying = channel;
        let last = lying.len() - 5;
        lying[last..last + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(parse(op::CHANNEL, &lying).is_none());
    }
}

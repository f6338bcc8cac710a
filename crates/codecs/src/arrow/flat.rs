//! FlatBuffers, as much of them as Arrow's messages take: tables, strings, vectors of tables, vectors of pairs.
//!
//! Written from front to back: every offset leads forward but the one to the table of fields (vtable), which is before
//! its table. Every position is checked when read: the bytes are not trusted.

/// What a table holds at a field; all numbers little endian.
#[derive(Clone, Copy)]
pub(super) enum Slot {
    /// Nothing: the default.
    None,
    /// A byte, or a boolean.
    U8(u8),
    I16(i16),
    I32(i32),
    I64(i64),
    /// Stored elsewhere; see [`Writer::point`].
    Offset,
}

impl Slot {
    const fn size(self) -> usize {
        match self {
            Self::None => 0,
            Self::U8(_) => 1,
            Self::I16(_) => 2,
            Self::I32(_) | Self::Offset => 4,
            Self::I64(_) => 8,
        }
    }
}

pub(super) struct Writer(Vec<u8>);

impl Writer {
    /// A buffer, and the place of the offset to its root.
    pub(super) fn new() -> (Self, usize) {
        (Self(vec![0; 4]), 0)
    }

    pub(super) fn finish(mut self) -> Vec<u8> {
        self.align(8, 0);
        self.0
    }

    /// Pads so that the position `behind` bytes farther on is a multiple of `to`.
    fn align(&mut self, to: usize, behind: usize) {
        let over = (self.0.len() + behind) % to;
        if over > 0 {
            self.0.resize(self.0.len() + to - over, 0);
        }
    }

    /// Points the offset at a place to what is written next.
    fn point(&mut self, at: usize) {
        let distance = (self.0.len() - at) as u32;
        self.0[at..at + 4].copy_from_slice(&distance.to_le_bytes());
    }

    /// Writes a table that an offset leads to; returns the places of its own offsets, in their order.
    pub(super) fn table(&mut self, at: usize, slots: &[Slot]) -> Vec<usize> {
        let (mut end, mut places) = (4, Vec::with_capacity(slots.len()));
        for slot in slots {
            let size = slot.size();
            end = if size > 0 { usize::next_multiple_of(end, size) } else { end };
            places.push(if size > 0 { end } else { 0 });
            end += size;
        }
        let fields = 4 + 2 * slots.len();
        self.align(8, fields);
        let vtable = self.0.len();
        for entry in [fields, end].into_iter().chain(places.iter().copied()) {
            self.0.extend((entry as u16).to_le_bytes());
        }
        self.point(at);
        let table = self.0.len();
        self.0.extend(((table - vtable) as i32).to_le_bytes());
        self.0.resize(table + end, 0);
        let mut offsets = Vec::new();
        for (slot, place) in slots.iter().zip(places) {
            let place = table + place;
            let mut put = |bytes: &[u8]| self.0[place..place + bytes.len()].copy_from_slice(bytes);
            match slot {
                Slot::None => {}
                Slot::U8(value) => put(&[*value]),
                Slot::I16(value) => put(&value.to_le_bytes()),
                Slot::I32(value) => put(&value.to_le_bytes()),
                Slot::I64(value) => put(&value.to_le_bytes()),
                Slot::Offset => offsets.push(place),
            }
        }
        offsets
    }

    pub(super) fn text(&mut self, at: usize, text: &str) {
        self.align(4, 0);
        self.point(at);
        self.0.extend((text.len() as u32).to_le_bytes());
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }

    /// Writes a vector of offsets; gives their places.
    pub(super) fn vector(&mut self, at: usize, length: usize) -> Vec<usize> {
        self.align(4, 0);
        self.point(at);
        self.0.extend((length as u32).to_le_bytes());
        let first = self.0.len();
        self.0.resize(first + 4 * length, 0);
        (0..length).map(|item| first + 4 * item).collect()
    }

    pub(super) fn pairs(&mut self, at: usize, pairs: &[[i64; 2]]) {
        self.align(8, 4);
        self.point(at);
        self.0.extend((pairs.len() as u32).to_le_bytes());
        self.0.extend(pairs.iter().flatten().flat_map(|number| number.to_le_bytes()));
    }
}

/// Why bytes are not a FlatBuffer.
pub(super) type Broken = &'static str;

const CUT: Broken = "an offset leads out of the message";

#[derive(Clone, Copy)]
pub(super) struct Table<'a> {
    bytes: &'a [u8],
    at: usize,
    /// The offsets of its fields, two bytes each.
    fields: &'a [u8],
}

fn array<const N: usize>(bytes: &[u8], at: usize) -> Result<[u8; N], Broken> {
    bytes.get(at..).and_then(|rest| rest.first_chunk()).copied().ok_or(CUT)
}

fn u32_at(bytes: &[u8], at: usize) -> Result<usize, Broken> {
    array(bytes, at).map(|bytes| u32::from_le_bytes(bytes) as usize)
}

impl<'a> Table<'a> {
    pub(super) fn root(bytes: &'a [u8]) -> Result<Self, Broken> {
        Self::at(bytes, u32_at(bytes, 0)?)
    }

    fn at(bytes: &'a [u8], at: usize) -> Result<Self, Broken> {
        let back = i64::from(i32::from_le_bytes(array(bytes, at)?));
        let vtable = usize::try_from(at as i64 - back).map_err(|_| CUT)?;
        let size = usize::from(u16::from_le_bytes(array(bytes, vtable)?));
        let fields = bytes.get(vtable..).and_then(|rest| rest.get(4..size)).ok_or(CUT)?;
        Ok(Self { bytes, at, fields })
    }

    /// The place of a field; `None` if it has its default.
    fn place(&self, field: usize) -> Option<usize> {
        let offset = u16::from_le_bytes(*self.fields.get(2 * field..)?.first_chunk()?);
        (offset > 0).then_some(self.at + usize::from(offset))
    }

    /// A number; its bytes are zero by default.
    fn number<const N: usize>(&self, field: usize) -> Result<[u8; N], Broken> {
        self.place(field).map_or(Ok([0; N]), |place| array(self.bytes, place))
    }

    pub(super) fn u8(&self, field: usize) -> Result<u8, Broken> {
        self.number(field).map(|[byte]: [u8; 1]| byte)
    }

    pub(super) fn i16(&self, field: usize) -> Result<i16, Broken> {
        self.number(field).map(i16::from_le_bytes)
    }

    pub(super) fn i32(&self, field: usize) -> Result<i32, Broken> {
        self.number(field).map(i32::from_le_bytes)
    }

    pub(super) fn i64(&self, field: usize) -> Result<i64, Broken> {
        self.number(field).map(i64::from_le_bytes)
    }

    /// Where what a field's offset leads to begins.
    fn target(&self, field: usize) -> Result<Option<usize>, Broken> {
        let Some(place) = self.place(field) else { return Ok(None) };
        Ok(Some(place + u32_at(self.bytes, place)?))
    }

    pub(super) fn has(&self, field: usize) -> bool {
        self.place(field).is_some()
    }

    pub(super) fn table(&self, field: usize) -> Result<Option<Self>, Broken> {
        self.target(field)?.map(|at| Self::at(self.bytes, at)).transpose()
    }

    /// The elements of a vector, `size` bytes each, and where they begin; none by default.
    fn elements(&self, field: usize, size: usize) -> Result<(usize, &'a [u8]), Broken> {
        let Some(at) = self.target(field)? else { return Ok((0, &[])) };
        let length = u32_at(self.bytes, at)?.checked_mul(size).ok_or(CUT)?;
        let elements = self.bytes.get(at + 4..).and_then(|rest| rest.get(..length));
        Ok((at + 4, elements.ok_or(CUT)?))
    }

    pub(super) fn text(&self, field: usize) -> Result<&'a str, Broken> {
        let (_, bytes) = self.elements(field, 1)?;
        str::from_utf8(bytes).map_err(|_| "a name is not UTF-8")
    }

    pub(super) fn tables(&self, field: usize) -> Result<Vec<Self>, Broken> {
        let (first, elements) = self.elements(field, 4)?;
        let at = |(index, offset): (usize, &[u8; 4])| {
            let place = first + 4 * index;
            Self::at(self.bytes, place + u32::from_le_bytes(*offset) as usize)
        };
        elements.as_chunks().0.iter().enumerate().map(at).collect()
    }

    pub(super) fn pairs(&self, field: usize) -> Result<Vec<[i64; 2]>, Broken> {
        let (_, elements) = self.elements(field, 16)?;
        let number = |bytes: &[u8]| i64::from_le_bytes(bytes.first_chunk().copied().unwrap_or_default());
        Ok(elements.as_chunks::<16>().0.iter().map(|pair| [number(&pair[..8]), number(&pair[8..])]).collect())
    }
}

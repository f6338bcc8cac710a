//! CDR, as ROS 2 writes its messages: XCDR version 1, of either byte order (OMG DDS-XTypes 1.3, 7.4; RTPS 2.5, 10).
//!
//! A reader of our own: the published ones decode through serde into values of their own, an image's bytes copied, and
//! trust the lengths they meet. Here bytes and texts are borrowed from the message, and no length is believed before
//! the bytes are there.

use depthloom_graphs::ErrorMessage;

/// Bytes before the content: what representation it is in, and options.
const HEADER: usize = 4;

/// A message read from its beginning. Every value is named, so that errors state where the message ended.
pub(crate) struct Cdr<'a> {
    /// Behind the header: alignment counts from here.
    bytes: &'a [u8],
    at: usize,
    is_big_endian: bool,
}

impl<'a> Cdr<'a> {
    pub(crate) fn new(message: &'a [u8]) -> Result<Self, ErrorMessage> {
        let Some((header, bytes)) = message.split_first_chunk::<HEADER>() else {
            return Err(ErrorMessage::new(format!(
                "{} bytes are too few for CDR, whose header has {HEADER}",
                message.len()
            )));
        };
        let is_big_endian = match header[..2] {
            [0, 0] => true,
            [0, 1] => false,
            [first, second] => {
                let what =
                    format!("its CDR header says representation {first:#04x} {second:#04x}, which is not supported");
                return Err(ErrorMessage::new(what).remedy(
                    "plain CDR (XCDR1: 0x00 0x00 or 0x00 0x01) is what ROS 2 writes; `ros2 bag convert` with a `cdr` output writes it again",
                ));
            }
            _ => unreachable!("two bytes"),
        };
        Ok(Self { bytes, at: 0, is_big_endian })
    }

    fn take(&mut self, length: usize, name: &str) -> Result<&'a [u8], ErrorMessage> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let Some(taken) = rest.get(..length) else {
            let (at, whole) = (self.at + HEADER, self.bytes.len() + HEADER);
            return Err(ErrorMessage::new(format!(
                "`{name}` has {length} bytes from byte {at} on, and the message has {whole}"
            )));
        };
        self.at += length;
        Ok(taken)
    }

    fn number<const N: usize>(&mut self, name: &str) -> Result<[u8; N], ErrorMessage> {
        self.at = self.at.next_multiple_of(N);
        let taken = self.take(N, name)?;
        let mut array: [u8; N] = taken.try_into().expect("N bytes were taken");
        if self.is_big_endian {
            array.reverse();
        }
        Ok(array)
    }

    pub(crate) fn u8(&mut self, name: &str) -> Result<u8, ErrorMessage> {
        self.number(name).map(u8::from_le_bytes)
    }

    pub(crate) fn u32(&mut self, name: &str) -> Result<u32, ErrorMessage> {
        self.number(name).map(u32::from_le_bytes)
    }

    pub(crate) fn i32(&mut self, name: &str) -> Result<i32, ErrorMessage> {
        self.number(name).map(i32::from_le_bytes)
    }

    pub(crate) fn f64(&mut self, name: &str) -> Result<f64, ErrorMessage> {
        self.number(name).map(f64::from_le_bytes)
    }

    /// `N` numbers, without a length before them.
    pub(crate) fn f64s<const N: usize>(&mut self, name: &str) -> Result<[f64; N], ErrorMessage> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.f64(name)?;
        }
        Ok(numbers)
    }

    /// `sequence<double>`.
    pub(crate) fn f64_sequence(&mut self, name: &str) -> Result<Vec<f64>, ErrorMessage> {
        let count = self.count(8, name)?;
        (0..count).map(|_| self.f64(name)).collect()
    }

    /// The length of a sequence; the message must have `least` bytes for each element.
    pub(crate) fn count(&mut self, least: usize, name: &str) -> Result<usize, ErrorMessage> {
        let count = self.u32(name)? as usize;
        let left = self.bytes.len().saturating_sub(self.at);
        if count.saturating_mul(least) > left {
            let (at, whole) = (self.at + HEADER, self.bytes.len() + HEADER);
            let what = format!(
                "`{name}` states {count} elements of at least {least} bytes from byte {at} on, but the message has {whole}"
            );
            return Err(ErrorMessage::new(what));
        }
        Ok(count)
    }

    /// `sequence<octet>`.
    pub(crate) fn bytes(&mut self, name: &str) -> Result<&'a [u8], ErrorMessage> {
        let length = self.u32(name)? as usize;
        self.take(length, name)
    }

    /// A string: its length counts the zero at its end.
    pub(crate) fn text(&mut self, name: &str) -> Result<&'a str, ErrorMessage> {
        let bytes = self.bytes(name)?;
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        std::str::from_utf8(bytes).map_err(|_| ErrorMessage::new(format!("`{name}` is not UTF-8")))
    }
}

#[cfg(test)]
mod tests {
    use super::Cdr;

    /// `uint8 a`, `string s`, `float64 x`, `sequence<octet> d`, aligned as CDR requires: a number is at a multiple of
    /// its size.
    fn message(big: bool) -> Vec<u8> {
        let order = |mut bytes: Vec<u8>| {
            if big {
                bytes.reverse();
            }
            bytes
        };
        let mut out = vec![0, u8::from(!big), 0, 0, 7, 0, 0, 0];
        out.extend(order(3_u32.to_le_bytes().to_vec()));
        out.extend(b"ab\0\0\0\0\0\0");
        out.extend(order(2.5_f64.to_le_bytes().to_vec()));
        out.extend(order(2_u32.to_le_bytes().to_vec()));
        out.extend([8, 9]);
        out
    }

    #[test]
    fn numbers_lie_at_multiples_of_their_size_in_either_order() {
        for big in [false, true] {
            let message = message(big);
            let mut cdr = Cdr::new(&message).unwrap();
            assert_eq!(cdr.u8("a").unwrap(), 7);
            assert_eq!(cdr.text("s").unwrap(), "ab");
            assert_eq!(cdr.f64("x").unwrap(), 2.5);
            assert_eq!(cdr.bytes("d").unwrap(), &[8, 9][..]);
            assert!(cdr.u8("more").is_err());
        }
    }

    #[test]
    fn lengths_that_lie_are_refused_with_name_and_place() {
        let mut message = message(false);
        message[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
        let mut cdr = Cdr::new(&message).unwrap();
        cdr.u8("a").unwrap();
        let error = cdr.text("frame_id").unwrap_err().to_string();
        assert_eq!(error, "`frame_id` has 4294967295 bytes from byte 12 on, and the message has 34");
        let mut cdr = Cdr::new(&message).unwrap();
        cdr.u8("a").unwrap();
        assert!(cdr.f64_sequence("d").unwrap_err().to_string().contains("4294967295 elements of at least 8 bytes"));
        assert!(Cdr::new(&[0, 1]).is_err());
        let mutable = Cdr::new(&[0, 3, 0, 0]).err().unwrap().to_string();
        assert!(mutable.contains("0x00 0x03"), "{mutable}");
    }
}

//! zstd, with a new context for each call, so that earlier calls have no effect; without memory an error, not a
//! panic.

use std::io;

use zstd::zstd_safe::{CCtx, CParameter, DCtx, WriteBuf, get_error_name};

/// Fast enough not to hold up a run; higher levels gain a few percent on maps (measured: see `benches/encode.rs`).
const LEVEL: i32 = 1;

/// The most bytes that `bytes` may be compressed to.
#[must_use]
pub fn bound(bytes: usize) -> usize {
    zstd::zstd_safe::compress_bound(bytes)
}

/// Compresses into the room there is.
pub fn compress(from: &[u8], into: &mut (impl WriteBuf + ?Sized)) -> io::Result<usize> {
    compress_with(&[CParameter::CompressionLevel(LEVEL)], from, into)
}

/// As [`compress`], for bytes of which few repeat: only longer matches are looked for, in a small table. This takes
/// half the time on the codes of maps, for a few percent more bytes.
pub fn compress_sparse(from: &[u8], into: &mut (impl WriteBuf + ?Sized)) -> io::Result<usize> {
    let parameters = [
        CParameter::CompressionLevel(LEVEL),
        CParameter::WindowLog(17),
        CParameter::HashLog(11),
        CParameter::MinMatch(6),
    ];
    compress_with(&parameters, from, into)
}

fn compress_with(parameters: &[CParameter], from: &[u8], into: &mut (impl WriteBuf + ?Sized)) -> io::Result<usize> {
    let mut context = CCtx::try_create().ok_or(io::ErrorKind::OutOfMemory)?;
    for parameter in parameters {
        context.set_parameter(*parameter).map_err(failed)?;
    }
    context.compress2(into, from).map_err(failed)
}

/// Decompresses into the room there is.
pub fn decompress(from: &[u8], into: &mut (impl WriteBuf + ?Sized)) -> io::Result<usize> {
    DCtx::try_create().ok_or(io::ErrorKind::OutOfMemory)?.decompress(into, from).map_err(failed)
}

fn failed(code: usize) -> io::Error {
    io::Error::other(get_error_name(code))
}

#[cfg(test)]
mod tests {
    use super::{bound, compress, compress_sparse, decompress};

    #[test]
    fn the_bytes_are_those_of_the_librarys_own_interface() {
        let bytes: Vec<u8> = (0..100_000_u32).map(|n| (n.wrapping_mul(n) / 977) as u8).collect();
        let mut packed = Vec::with_capacity(bound(bytes.len()));
        compress(&bytes, &mut packed).unwrap();
        assert!(packed == zstd::bulk::compress(&bytes, super::LEVEL).unwrap());
        let mut sparse = Vec::with_capacity(bound(bytes.len()));
        compress_sparse(&bytes, &mut sparse).unwrap();
        assert!(zstd::bulk::decompress(&sparse, bytes.len()).unwrap() == bytes);
        let mut unpacked = Vec::with_capacity(bytes.len());
        decompress(&packed, &mut unpacked).unwrap();
        assert!(unpacked == bytes);
        assert!(decompress(&packed, &mut Vec::with_capacity(bytes.len() - 1)).is_err());
    }
}

//! zstd, with a new context for each call, so that earlier calls have no effect; without memory an error, not a
//! panic.

use std::io;

use zstd::zstd_safe::zstd_sys::ZSTD_EndDirective;
use zstd::zstd_safe::{CCtx, CParameter, DCtx, InBuffer, OutBuffer, ParamSwitch, WriteBuf, get_error_name};

/// Fast enough not to hold up a run; higher levels gain a few percent on maps (measured: see
/// `recording/benches/encode.rs`).
const LEVEL: i32 = 1;

/// The most bytes that `bytes` may be compressed to.
#[must_use]
pub fn bound(bytes: usize) -> usize {
    zstd::zstd_safe::compress_bound(bytes)
}

/// Compresses into the room there is.
pub fn compress(from: &[u8], into: &mut (impl WriteBuf + ?Sized)) -> io::Result<usize> {
    context(&[CParameter::CompressionLevel(LEVEL)])?.compress2(into, from).map_err(failed)
}

/// Compresses sections of unlike bytes, of which few repeat, into one frame: each section has blocks of its own, so
/// that no two share a Huffman table. Matches are looked for at fewer places the longer none is found. This takes half
/// the time of [`compress`] on the codes of maps (0.27 instead of 0.53 ms, KITTI on an EPYC), for as many bytes.
pub fn compress_sections(sections: &[&[u8]]) -> io::Result<Vec<u8>> {
    let parameters = [
        CParameter::CompressionLevel(LEVEL),
        CParameter::WindowLog(17),
        CParameter::HashLog(11),
        CParameter::MinMatch(7),
        CParameter::TargetLength(16),
        CParameter::LiteralCompressionMode(ParamSwitch::Enable),
    ];
    let mut context = context(&parameters)?;
    let length = sections.iter().map(|section| section.len()).sum();
    context.set_pledged_src_size(Some(length as u64)).map_err(failed)?;
    // A section's end adds a block's header and a Huffman table that does not pay.
    let mut packed = Vec::with_capacity(bound(length) + sections.len() * bound(0));
    let mut into = OutBuffer::around(&mut packed);
    for section in sections {
        finish(&mut context, &mut into, section, ZSTD_EndDirective::ZSTD_e_flush)?;
    }
    finish(&mut context, &mut into, &[], ZSTD_EndDirective::ZSTD_e_end)?;
    Ok(packed)
}

/// Compresses bytes up to the end of a block, or of the frame.
fn finish(
    context: &mut CCtx<'_>,
    into: &mut OutBuffer<'_, Vec<u8>>,
    from: &[u8],
    until: ZSTD_EndDirective,
) -> io::Result<()> {
    let mut from = InBuffer::around(from);
    while context.compress_stream2(into, &mut from, until).map_err(failed)? > 0 {
        if into.pos() == into.capacity() {
            return Err(io::Error::other("the compressed bytes are more than their bound"));
        }
    }
    Ok(())
}

fn context<'a>(parameters: &[CParameter]) -> io::Result<CCtx<'a>> {
    let mut context = CCtx::try_create().ok_or(io::ErrorKind::OutOfMemory)?;
    for parameter in parameters {
        context.set_parameter(*parameter).map_err(failed)?;
    }
    Ok(context)
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
    use depthloom_random::SplitMix64;

    use super::{LEVEL, bound, compress, compress_sections, decompress};

    #[test]
    fn the_bytes_are_those_of_the_librarys_own_interface() {
        let bytes: Vec<u8> = (0..100_000_u32).map(|n| (n.wrapping_mul(n) / 977) as u8).collect();
        let mut packed = Vec::with_capacity(bound(bytes.len()));
        compress(&bytes, &mut packed).unwrap();
        assert!(packed == zstd::bulk::compress(&bytes, LEVEL).unwrap());
        let mut unpacked = Vec::with_capacity(bytes.len());
        decompress(&packed, &mut unpacked).unwrap();
        assert!(unpacked == bytes);
        assert!(decompress(&packed, &mut Vec::with_capacity(bytes.len() - 1)).is_err());
    }

    #[test]
    fn sections_are_one_frame_in_their_order() {
        let mut random = SplitMix64::new(5);
        let noise: Vec<u8> = (0..300_000).map(|_| random.next() as u8).collect();
        let few: Vec<u8> = noise.iter().map(|byte| byte % 3).collect();
        let equal = [7; 200_000];
        for sections in [&[&noise[..], &few, &equal, &noise[..1]][..], &[&[], &few, &[]], &[&[], &[]], &[&noise[..]; 4]]
        {
            let all = sections.concat();
            let packed = compress_sections(sections).unwrap();
            assert_eq!(zstd::zstd_safe::get_frame_content_size(&packed).ok().flatten(), Some(all.len() as u64));
            assert_eq!(zstd::zstd_safe::find_frame_compressed_size(&packed), Ok(packed.len()));
            assert!(zstd::bulk::decompress(&packed, all.len()).unwrap() == all);
        }
        let alone = |section: &[u8]| zstd::bulk::compress(section, LEVEL).unwrap().len();
        assert!(compress_sections(&[&few, &equal]).unwrap().len() < (alone(&few) + alone(&equal)) * 101 / 100);
    }
}

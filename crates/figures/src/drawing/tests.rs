use super::*;
use crate::colours::colour;

/// One of each mark.
fn drawing() -> Drawing {
    let mut drawing = Drawing { width_pt: 72.0, height_pt: 36.0, marks: Vec::new() };
    drawing.line(vec![(0.0, 0.0), (72.0, 36.0)], Stroke::new(colour("#0077bb"), 1.0).dashed(&[2.0, 1.0]).faint(0.5));
    drawing.rectangle((10.0, 10.0), (20.0, 10.0), Fill::new([255, 0, 0], 1.0));
    drawing.marks.push(Mark::Clip { at: (0.0, 0.0), size: (36.0, 36.0) });
    drawing.marks.push(Mark::Dot { at: (36.0, 18.0), radius: 6.0, fill: Fill::new([0, 0, 255], 1.0) });
    drawing.marks.push(Mark::Unclip);
    drawing.text((36.0, 30.0), "fused & α", 8.0, Anchor::Middle);
    let picture = Picture { width: 2, height: 1, rgb: vec![0, 255, 0, 255, 255, 0] };
    drawing.marks.push(Mark::Picture { at: (60.0, 0.0), size: (12.0, 6.0), picture });
    drawing
}

#[test]
fn a_png_has_the_requested_size() {
    let bytes = drawing().png(144.0).unwrap();
    let mut reader = ::png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    let info = reader.info();
    assert_eq!((info.width, info.height), (144, 72));
    assert_eq!(info.pixel_dims.map(|dims| dims.xppu), Some(5669), "144 an inch are 5669 a metre");
    let at = |x: usize, y: usize| &pixels[3 * (144 * y + x)..][..3];
    assert_eq!(at(30, 22), [255, 0, 0], "the rectangle");
    assert_eq!(at(66, 36), [0, 0, 255], "the dot, inside of the clip");
    assert_eq!(at(79, 36), [255; 3], "nothing outside of it");
    assert_eq!(at(122, 6), [0, 255, 0], "the picture's left pixel");
}

#[test]
fn equal_drawings_are_equal_bytes_of_stated_sizes() {
    assert_eq!(drawing().svg(), drawing().svg());
    assert_eq!(drawing().pdf("t"), drawing().pdf("t"));
    assert!(drawing().svg().contains("width=\"25.4mm\" height=\"12.7mm\" viewBox=\"0 0 72 36\""));
    assert!(drawing().svg().contains(">fused &amp; α</text>"));
    let pdf = drawing().pdf("t");
    assert!(pdf.starts_with(b"%PDF-1.") && pdf.len() < 60_000, "{} bytes", pdf.len());
}

#[test]
fn a_picture_too_large_is_refused_in_words() {
    let error = drawing().png(1e6).unwrap_err();
    assert!(error.contains("too large"), "{error}");
}

#[test]
fn words_have_the_widths_of_their_font() {
    assert!(width("0", 10.0) > 6.0 && width("0", 10.0) < 6.5, "DejaVu's digits are 0.636 em wide");
    assert_eq!(width("", 10.0), 0.0);
    assert!(width("日", 10.0) > 0.0, "what the font lacks is a box");
}

#!/usr/bin/env python3
"""Reads figures of `depthloom figure` with other people's readers: check_figures.py PATH:HEIGHT_MM:WORDS..., each PATH.svg and PATH.pdf, 88 mm wide."""
import sys
import xml.etree.ElementTree as tree

import pypdf

SVG = "{http://www.w3.org/2000/svg}"


def main():
    for argument in sys.argv[1:]:
        path, height, words = argument.split(":", 2)
        height = float(height)
        root = tree.parse(f"{path}.svg").getroot()
        assert root.tag == f"{SVG}svg" and root.attrib["width"] == "88mm", root.attrib
        assert abs(float(root.attrib["height"].removesuffix("mm")) - height) < 1e-3, root.attrib
        texts = [of.text or "" for of in root.iter(f"{SVG}text")]
        assert any(words in text for text in texts), (path, texts)
        (page,) = pypdf.PdfReader(f"{path}.pdf").pages
        size = [float(side) / 72 * 25.4 for side in (page.mediabox.width, page.mediabox.height)]
        assert abs(size[0] - 88) < 0.01 and abs(size[1] - height) < 0.01, (path, size)
        # Words are words, in a font that the file has with it.
        told = page.extract_text()
        assert words in told, (path, told)
        (font,) = page["/Resources"]["/Font"].values()
        (descendant,) = font.get_object()["/DescendantFonts"]
        descriptor = descendant.get_object()["/FontDescriptor"].get_object()
        assert len(descriptor["/FontFile2"].get_object().get_data()) > 10_000, path
        if path.endswith("panels"):
            pictures = [of.get_object() for of in page["/Resources"]["/XObject"].values()]
            assert len(pictures) == 2 * 7, len(pictures)
            assert all(len(of.get_data()) == 3 * of["/Width"] * of["/Height"] > 10_000 for of in pictures), path
    print(len(sys.argv) - 1)


main()
